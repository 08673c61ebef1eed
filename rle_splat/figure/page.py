"""A page as plain data: what is drawn where, in millimeters from the page's top left corner, y downward.

Every writer (``raster``, ``svg``, ``cli.figure_pdf``) draws the same page.
"""

from dataclasses import dataclass

import numpy as np

MM_PER_INCH = 25.4
MM_PER_POINT = MM_PER_INCH / 72.0


@dataclass(frozen=True)
class Text:
    """A line of text.

    Attributes
    ----------
    x, y : float
        The end of the baseline that ``anchor`` names, mm.
    size : float
        Font size in mm.
    color : (3,) tuple of float
        Scene-linear RGB.
    anchor : {"start", "middle", "end"}
    halo : (3,) tuple of float or None
        Color of an outline that sets the text off from a picture below it.
    """

    x: float
    y: float
    text: str
    size: float
    color: tuple
    anchor: str = "start"
    bold: bool = False
    halo: tuple | None = None


@dataclass(frozen=True)
class Stroke:
    """A line through ``points``, ((x, y), ...) in mm, ``width`` mm wide, with round ends, in a scene-linear color."""

    points: tuple
    width: float
    color: tuple


@dataclass(frozen=True)
class Fill:
    """A filled polygon through ``points``, ((x, y), ...) in mm, in a scene-linear color."""

    points: tuple
    color: tuple


@dataclass(frozen=True, eq=False)
class Tile:
    """A picture.

    Attributes
    ----------
    x, y : float
        Its top left corner in mm, on a whole pixel of the page.
    rgba : (H, W, 4) ndarray of float32
        Scene-linear, premultiplied, in pixels of the page.
    """

    x: float
    y: float
    rgba: np.ndarray


@dataclass(frozen=True, eq=False)
class Page:
    """A page.

    Attributes
    ----------
    width, height : int
        Pixels.
    dpi : float
        Pixels per inch.
    background : (3,) tuple of float or None
        Scene-linear RGB; None for a transparent page.
    items : tuple
        Text, Stroke, Fill and Tile, in the order in which they are drawn.
    """

    width: int
    height: int
    dpi: float
    background: tuple | None
    items: tuple

    @property
    def pixels_per_mm(self) -> float:
        """Pixels of the page per millimeter."""
        return self.dpi / MM_PER_INCH

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height in mm."""
        return self.width / self.pixels_per_mm, self.height / self.pixels_per_mm
