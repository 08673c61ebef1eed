"""What a figure shows: its panels and its style, as plain data."""

import math
from dataclasses import dataclass, field
from reprlib import repr as short
from typing import Literal, get_args

from ..scene import Background, RleSplatError, Scene, as_background, as_float
from ..scene.checks import is_finite_number
from .lettering import check_text
from .page import MM_PER_INCH

Sides = Literal["auto", "letters", "cube", "off"]
SIDES = get_args(Sides)
AUTO, OFF, CENTER = "auto", "off", "center"
CM_TO_MM = 10.0
MARGIN, GUTTER = 1.0, 4.0  # mm around the page, and between panels
LEAST_TILE = 16  # pixels
MOST_PIXELS = 200_000_000  # of a page
LIMITS = {"width_cm": (1.0, 200.0), "dpi": (20.0, 2400.0), "font_size": (3.0, 72.0), "aspect": (0.05, 20.0)}


@dataclass(frozen=True)
class FigureStyle:
    """How a figure looks; RleSplatError if a value is out of range.

    Parameters
    ----------
    width_cm : float
        Width of the page.
    dpi : float
        Pixels per inch.
    columns : int
        Panels side by side; 0 chooses.
    background : {"white", "black", "transparent"} or (3,) sequence of float
        Color of the page, by name or as scene-linear RGB. Lettering is white on dark colors, else black.
    font_size : float
        Points.
    aspect : float or None
        Width of a panel's picture over its height; None for the shape of what is visible where that fills the pictures,
        and else 1.
    caption : str or None
        Below the panels; "" for none, None for one that says what is seen.
    scale_bar : float or {"auto", "off"}
        Length of the scale bar in mm, or in the volume's unit if that is no metric one.
    scale_depth : float, "center" or None
        At which distance along the camera's axis, in world units, the scale bar of a perspective view holds; "center"
        is the middle of the volume.
    sides : {"auto", "letters", "cube", "off"}
        The patient's sides: letters at the edges, or a cube. "auto" is letters where the file knows the sides.
    color_bar : bool
        Whether colors and opacity over the values are shown.
    """

    width_cm: float = 17.0
    dpi: float = 300.0
    columns: int = 0
    background: Background = "white"
    font_size: float = 8.0
    aspect: float | None = None
    caption: str | None = None
    scale_bar: float | str = AUTO
    scale_depth: float | str | None = None
    sides: Sides = AUTO
    color_bar: bool = True

    def __post_init__(self):
        for name, (least, most) in LIMITS.items():
            value = getattr(self, name)
            if name == "aspect" and value is None:
                continue
            if not (is_finite_number(value) and least <= value <= most):
                what = name.replace("_", " ")
                raise RleSplatError(f"The figure's {what} must be from {least:g} to {most:g}, not {short(value)}.")
        if not isinstance(self.columns, int) or not 0 <= self.columns <= 100:
            raise RleSplatError(
                f"The figure's columns must be a whole number from 0 to 100, not {short(self.columns)}."
            )
        background = as_background(self.background, "The figure's background")
        if not isinstance(self.background, str):
            object.__setattr__(self, "background", background)
        if self.sides not in SIDES:
            raise RleSplatError(f"The figure's sides must be {', '.join(SIDES)}, not {short(self.sides)}.")
        _check_length(self.scale_bar, (AUTO, OFF), "scale bar")
        if self.scale_depth is not None:
            _check_length(self.scale_depth, (CENTER,), "scale depth")
        if not isinstance(self.color_bar, bool):
            raise RleSplatError(f"The figure's color bar must be true or false, not {short(self.color_bar)}.")
        if self.caption is not None:
            if not isinstance(self.caption, str):
                raise RleSplatError("The figure's caption must be text, or left out for one that says what is seen.")
            check_text(" ".join(self.caption.split()), "The figure's caption")

    @property
    def pixels_per_mm(self) -> float:
        """Pixels of the page per millimeter."""
        return self.dpi / MM_PER_INCH

    @property
    def width(self) -> int:
        """Width of the page in pixels."""
        return round(self.width_cm * CM_TO_MM * self.pixels_per_mm)


def _check_length(value, words: tuple, what: str) -> None:
    if value in words:
        return
    if isinstance(value, bool) or not (is_finite_number(value) and value > 0.0):
        choices = " or ".join(repr(word) for word in words)
        raise RleSplatError(f"The figure's {what} must be a length above zero, or {choices}, not {short(value)}.")


@dataclass(frozen=True)
class Name:
    """A name in a picture.

    Attributes
    ----------
    text : str
    label : int or None
        The segment that it names.
    point : (3,) tuple of float or None
        The place that it names, in world units, if it is not that of a segment.
    """

    text: str
    label: int | None = None
    point: tuple | None = None

    def __post_init__(self):
        if not isinstance(self.text, str) or (self.label is None) == (self.point is None):
            raise RleSplatError("A name in a figure must have a text, and either a segment or a point.")
        if self.point is not None:
            object.__setattr__(self, "point", tuple(map(as_float, self.point)))

    @property
    def key(self):
        """What tells names from one another."""
        return self.label if self.point is None else self.point


@dataclass(frozen=True, eq=False)
class Panel:
    """One picture of a figure.

    Attributes
    ----------
    scene : Scene
        Its size in pixels is that of the tile.
    title : str
        "" for none.
    names : tuple of Name
        Of segments and points, written at both sides with lines to them.
    """

    scene: Scene
    title: str = ""
    names: tuple[Name, ...] = ()


@dataclass(frozen=True, eq=False)
class Figure:
    """A figure.

    Parameters
    ----------
    panels : tuple of Panel
        Row by row. All pictures have the same size.

    Raises
    ------
    RleSplatError
        Without panels, for pictures of several sizes, or a title that cannot be drawn.
    """

    panels: tuple
    style: FigureStyle = field(default_factory=FigureStyle)

    def __post_init__(self):
        if not self.panels:
            raise RleSplatError("A figure needs at least one panel.")
        if len({(panel.scene.width, panel.scene.height) for panel in self.panels}) > 1:
            raise RleSplatError("The pictures of a figure must all have the same size in pixels.")
        for panel in self.panels:
            check_text(panel.title, "A title of the figure")
            check_text("".join(one.text for one in panel.names), "A name in the figure")
            if panel.scene.camera.pixel_aspect[0] != panel.scene.camera.pixel_aspect[1]:
                raise RleSplatError("The pixels of a figure are square; set the camera's pixel aspect to 1 to 1.")

    @property
    def columns(self) -> int:
        """Panels side by side."""
        return columns_of(self.style, len(self.panels))


def columns_of(style: FigureStyle, count: int) -> int:
    """How many of ``count`` panels stand side by side."""
    chosen = style.columns or math.ceil(math.sqrt(count))
    return min(chosen, count)


def tile_size(style: FigureStyle, count: int) -> tuple[int, int]:
    """Width and height in pixels of each of ``count`` pictures of a figure.

    Returns
    -------
    (width, height) : tuple of int

    Raises
    ------
    RleSplatError
        If too little, or more than can be drawn, is left for each picture.
    """
    columns = columns_of(style, count)
    gaps = round(GUTTER * style.pixels_per_mm) * (columns - 1) + 2 * round(MARGIN * style.pixels_per_mm)
    width = (style.width - gaps) // columns
    height = round(width / (style.aspect or 1.0))
    if min(width, height) < LEAST_TILE:
        raise RleSplatError(
            f"{columns} panels side by side leave {max(width, 0)} x {max(height, 0)} pixels for each; make the figure "
            "wider, raise its dpi, or use fewer columns."
        )
    if style.width * height * math.ceil(count / columns) > MOST_PIXELS:
        raise RleSplatError(f"The figure has more than {MOST_PIXELS:,} pixels; make it narrower, or lower its dpi.")
    return width, height
