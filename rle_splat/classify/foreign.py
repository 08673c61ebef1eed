"""What readers of other programs' transfer functions share: what they return, numbers, and display colors.

Colors in these files are those of a display, between whose points the other program interpolates.  Ours are
scene-linear.  So points are added where straight lines between converted colors would be seen to differ.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from reprlib import repr as short

import numpy as np

from ..scene import RleSplatError, as_float
from ..scene.color import linear, to_display
from .transfer_function import TransferFunction

SEEN = 2.0 / 255.0  # difference of a display color that is worth a point
MOST_HALVINGS = 5  # of one interval between points; 32 parts at most
BETWEEN = np.linspace(0.0, 1.0, 9)[1:-1]  # where an interval is compared


@dataclass(frozen=True)
class FileFunction:
    """One transfer function of a file.

    Attributes
    ----------
    function : TransferFunction
        Its name is that in the file, or else the name of the file.
    remarks : tuple of str
        Sentences on what the file holds and was left out.
    """

    function: TransferFunction
    remarks: tuple[str, ...] = ()


def number(value, what: str) -> float:
    """A finite float from a text or a JSON number; RleSplatError for anything else.

    Parameters
    ----------
    value : object
    what : str
        Names it in messages.
    """
    found = math.nan if isinstance(value, bool) else as_float(value)
    if not math.isfinite(found):
        raise RleSplatError(f"{what} must be a finite number, not {short(value)}; correct the file.")
    return found


def display_color(rgb, what: str) -> tuple:
    """Check a display color, three numbers from 0 to 1; ``what`` names it in messages."""
    if min(rgb) < 0.0 or max(rgb) > 1.0:
        raise RleSplatError(f"{what} must be from 0 to 1, not {short(tuple(rgb))}; correct the file.")
    return tuple(rgb)


def scene_linear_points(points) -> list[tuple]:
    """Convert points of display colors.

    Parameters
    ----------
    points : sequence of (value, r, g, b)
        Ascending values; display colors from 0 to 1, interpolated linearly as such.

    Returns
    -------
    list of (value, r, g, b)
        Scene-linear.  Interpolated linearly as such, they differ from the given ones by at most SEEN on a display.
    """
    converted = [(points[0][0], *linear(points[0][1:]))]
    for (low, *first), (high, *last) in pairwise(points):
        converted += [(value, *linear(rgb)) for value, rgb in _insert((low, first), (high, last), MOST_HALVINGS)]
    return converted


def _insert(begin, end, halvings: int) -> list[tuple]:
    """The points (value, display color) after ``begin`` up to ``end`` that keep between them close to a line."""
    first, last = np.array(begin[1]), np.array(end[1])
    wanted = first + (last - first) * BETWEEN[:, None]
    ends = np.array(linear(first)), np.array(linear(last))
    shown = to_display(ends[0] + (ends[1] - ends[0]) * BETWEEN[:, None])
    if halvings == 0 or begin[0] == end[0] or np.abs(shown - wanted).max() <= SEEN:
        return [end]
    middle = (0.5 * (begin[0] + end[0]), tuple((0.5 * (first + last)).tolist()))
    return [*_insert(begin, middle, halvings - 1), *_insert(middle, end, halvings - 1)]
