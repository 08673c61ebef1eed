"""A color bar: the colors and the opacity of a transfer function over the values, with ticks and unit."""

import math
from dataclasses import dataclass

import numpy as np

from ..classify.transfer_function import TransferFunction
from .lettering import text_width
from .page import Stroke, Text, Tile

CURVE, STRIP, TICK = 6.0, 2.2, 0.8  # mm: height of the opacity curve and of the strip of colors, length of ticks
LINE = 0.18  # mm
CURVE_LINE = 0.3  # mm
ROOM = 1.6  # least distance of the middles of tick labels, in widths of the widest one
MOST_TICKS = 8
STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
AXIS = 2.2  # font sizes left of the bar, for the labels of the opacity


@dataclass(frozen=True)
class Lines:
    """Heights that a bar's lines of text take, for a font size in mm."""

    size: float

    @property
    def above(self) -> float:
        """From the bar's top to the curve: a line of text."""
        return 1.4 * self.size

    @property
    def height(self) -> float:
        """The whole bar."""
        return self.above + CURVE + STRIP + TICK + 1.3 * self.size


def ticks(low: float, high: float, most: int) -> list[float]:
    """Round values from ``low`` to ``high``, at equal distances, at most ``most`` of them.

    Parameters
    ----------
    low, high : float
        ``low`` is below ``high``.
    most : int
        At least 2.

    Returns
    -------
    list of float
        Multiples of 1, 2, 2.5 or 5 times a power of ten.
    """
    power = 10.0 ** math.floor(math.log10((high - low) / most))
    for step in (times * scale * power for scale in (1.0, 10.0) for times in STEPS):
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        if last - first + 1 <= most:
            return [float(f"{n * step:.12g}") + 0.0 for n in range(first, last + 1)]
    return [low, high]


def value_text(value: float) -> str:
    """A tick's label, with a minus sign."""
    return f"{value:.6g}".replace("-", "−")


def bar_range(function: TransferFunction) -> tuple[float, float]:
    """The values of a color bar: those that the transfer function shows, between the outermost of its points with an
    opacity and their neighbors; about a single value where there is but one."""
    low, high = function.span
    shown = [n for n, (_, alpha) in enumerate(function.opacity) if alpha > 0.0]
    if shown and shown[0] > 0:
        low = function.opacity[shown[0] - 1][0]
    if shown and shown[-1] < len(function.opacity) - 1:
        high = function.opacity[shown[-1] + 1][0]
    if high > low:
        return low, high
    around = max(abs(low), 1.0) * 0.5
    return low - around, high + around


def column_values(function: TransferFunction, columns: int) -> np.ndarray:
    """(columns,) float64: the values at the middles of a bar's columns of pixels."""
    low, high = bar_range(function)
    return low + (high - low) * (np.arange(columns) + 0.5) / columns


def strip_picture(function: TransferFunction, columns: int, rows: int) -> np.ndarray:
    """(rows, columns, 4) float32: the colors over the values, opaque, scene-linear."""
    colors = np.clip(function.color_at(column_values(function, columns)), 0.0, 1.0)
    picture = np.ones((rows, columns, 4), np.float32)
    picture[..., :3] = colors
    return picture


def curve_picture(function: TransferFunction, columns: int, rows: int) -> np.ndarray:
    """(rows, columns, 4) float32: the colors below the opacity curve, which reaches the top at 1; premultiplied."""
    heights = rows * function.alpha_at(column_values(function, columns))
    cover = np.clip(heights - np.arange(rows)[::-1, None], 0.0, 1.0).astype(np.float32)
    return strip_picture(function, columns, rows) * cover[..., None]


def shown_picture(function: TransferFunction, columns: int, rows: int) -> np.ndarray:
    """(rows, columns, 4) float32: what a picture shows of each value alone, its color by its opacity; premultiplied."""
    opacity = function.alpha_at(column_values(function, columns)).astype(np.float32)
    return strip_picture(function, columns, rows) * opacity[:, None]


def color_bar(
    function: TransferFunction, distance: str | None, unit: str | None, box: tuple, size: float, pixels_per_mm: float,
    ink: tuple,
) -> list:  # fmt: skip
    """The items of a color bar.

    Parameters
    ----------
    distance : str or None
        To what length the opacities refer, such as "1 mm"; None where a pixel shows one value of its ray: the bar then
        has what is shown of each value, in place of colors and a curve.
    unit : str or None
        Of the values.
    box : (x, y, width) of float
        Top left corner, on a whole pixel, and width, mm. Its height is ``Lines(size).height``.
    size : float
        Font size, mm.
    ink : (3,) tuple of float
        Color of lines and lettering, scene-linear.

    Returns
    -------
    list
        Tile, Stroke and Text.
    """
    x, y, width = box
    left = _snap(x + AXIS * size, pixels_per_mm)
    top = _snap(y + Lines(size).above, pixels_per_mm)
    right_room = 1.2 * size  # half a tick's label may reach beyond the bar
    columns = max(round((x + width - right_room - left) * pixels_per_mm), 2)
    curve_rows, strip_rows = (max(round(part * pixels_per_mm), 2) for part in (CURVE, STRIP))
    wide, curve, strip = (count / pixels_per_mm for count in (columns, curve_rows, strip_rows))
    base = top + curve
    items = [
        Stroke(((left, base + strip), (left + wide, base + strip), (left + wide, base)), LINE, ink),
        Text(left + wide, y + size, f"Values in {unit}" if unit else "Values without unit", size, ink, anchor="end"),
        *_value_ticks(function, left, base + strip, wide, size, ink),
    ]
    if distance is None:
        frame = Stroke(((left + wide, base), (left + wide, top), (left, top), (left, base + strip)), LINE, ink)
        return [Tile(left, top, shown_picture(function, columns, curve_rows + strip_rows)), frame, *items]
    items = [
        Tile(left, top, curve_picture(function, columns, curve_rows)),
        Tile(left, base, strip_picture(function, columns, strip_rows)),
        Stroke(_curve_points(function, left, base, wide, curve), CURVE_LINE, ink),
        Stroke(((left, top), (left, base + strip)), LINE, ink),
        Stroke(((left, base), (left + wide, base)), LINE, ink),
        Text(left, y + size, f"Opacity per {distance}", size, ink),
        *items,
    ]
    for height, label in ((base, "0"), (top, "1")):
        items.append(Stroke(((left - TICK, height), (left, height)), LINE, ink))
        items.append(Text(left - 1.6 * TICK, height + 0.36 * size, label, size, ink, anchor="end"))
    return items


def _snap(place: float, pixels_per_mm: float) -> float:
    """The nearest whole pixel, in mm."""
    return round(place * pixels_per_mm) / pixels_per_mm


def _curve_points(function: TransferFunction, left: float, base: float, width: float, height: float) -> tuple:
    """The opacity curve in mm: its points, with the ends of the bar."""
    low, high = bar_range(function)
    ends = [(low, float(function.alpha_at(low))), (high, float(function.opacity[-1][1]))]
    inner = [(value, alpha) for value, alpha in function.opacity if low <= value <= high]
    first = [ends[0]] if inner[0][0] > low else []
    last = [ends[1]] if inner[-1][0] < high else []
    return tuple(
        (left + width * (value - low) / (high - low), base - height * alpha) for value, alpha in (*first, *inner, *last)
    )


def _value_ticks(function: TransferFunction, left: float, y: float, width: float, size: float, ink) -> list:
    """Ticks below a bar and their labels; as many as have room."""
    low, high = bar_range(function)
    most = MOST_TICKS
    while most > 2:
        found = ticks(low, high, most)
        widest = max((text_width(value_text(value), size) for value in found), default=0.0)
        if len(found) < 2 or ROOM * widest <= width * (found[1] - found[0]) / (high - low):
            break
        most -= 1
    items = []
    for value in ticks(low, high, most):
        x = left + width * (value - low) / (high - low)
        items.append(Stroke(((x, y), (x, y + TICK)), LINE, ink))
        items.append(Text(x, y + TICK + 1.1 * size, value_text(value), size, ink, anchor="middle"))
    return items
