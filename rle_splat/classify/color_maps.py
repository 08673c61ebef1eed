"""Color maps of niivue and of FSL.

Facts:

- niivue (``colortables.ts``): JSON with lists R, G, B, A of 0 to 255 at the positions I, 0 to 255.  Between them colors
  are interpolated.  Without A, alpha is 64, and 0 at the first; without I, positions are even.  ``min`` and ``max`` are
  the values at positions 0 and 255; where they are equal or left out, the positions span the volume's own window.
  Its shader takes alpha per voxel.
- FSL (FSLeyes' ``colourmaps.py``): text with one color a line, three numbers from 0 to 1; the first is at the low end
  of the window, the last at the high end.  ``#`` begins a comment.  There is no opacity.
"""

from ..scene import RleSplatError
from .foreign import FileFunction, display_color, number, scene_linear_points
from .presets import RELATIVE
from .transfer_function import Shade, TransferFunction

LARGEST = 255.0
FAINT = 64.0  # niivue's alpha where a color map has none
MOST_OPAQUE = 0.5  # at the high end, where a file has no opacities
NO_OPACITY_REMARK = f"A color map has no opacities; a ramp from 0 to {MOST_OPAQUE:g} over its values was taken."


def read_niivue(mapping: dict, name: str, what: str) -> list[FileFunction]:
    """Read a color map of niivue; RleSplatError if a list is missing, of another length or out of range.

    Parameters
    ----------
    mapping : dict
        With R, G and B.
    name : str
        Of the transfer function.
    what : str
        Names the file in messages.

    Returns
    -------
    list of FileFunction
        Of one; its unit is RELATIVE without ``min`` and ``max``.
    """
    red = _levels(mapping, "R", what)
    count = len(red)
    last = max(count - 1, 1)
    even = [LARGEST * i / last for i in range(count)]
    lists = [red] + [
        _levels(mapping, key, what, default)
        for key, default in (("G", None), ("B", None), ("A", [0.0, *[FAINT] * (count - 1)]), ("I", even))
    ]
    if any(len(one) != count for one in lists):
        raise RleSplatError(f"{what}: R, G, B, A and I must be of equal length; correct the file.")
    *colors, alphas, positions = lists
    if positions != sorted(positions) or positions[0] != 0.0:
        raise RleSplatError(f"{what}: the positions I must ascend from 0; correct the file.")
    positions[-1] = LARGEST if count > 1 else 0.0  # niivue takes the last one for 255, whatever it is
    low, high = (number(mapping.get(key, 0.0), f"{what}: {key}") for key in ("min", "max"))
    if low > high:
        raise RleSplatError(f"{what}: min ({low:g}) is above max ({high:g}); correct the file.")
    unit = None
    if low == high:
        low, high, unit = 0.0, 1.0, RELATIVE
    values = [low + (high - low) * position / LARGEST for position in positions]
    points = [(value, *(c / LARGEST for c in rgb)) for value, *rgb in zip(values, *colors)]
    opacity = tuple((value, alpha / LARGEST) for value, alpha in zip(values, alphas))
    return [FileFunction(TransferFunction(name, unit, opacity, tuple(scene_linear_points(points)), None, Shade()))]


def _levels(mapping: dict, key: str, what: str, default=None) -> list[float]:
    """A list of numbers from 0 to 255."""
    given = mapping.get(key, default)
    if not isinstance(given, list) or not given:
        raise RleSplatError(f"{what}: {key} must be a list of numbers; correct the file.")
    levels = [number(one, f"{what}: each number of {key}") for one in given]
    if min(levels) < 0.0 or max(levels) > LARGEST:
        raise RleSplatError(
            f"{what}: {key} must be from 0 to {LARGEST:g}; a table of labels is no color map of values."
        )
    return levels


def read_rows(lines: list[str], name: str, what: str) -> list[FileFunction]:
    """Read a color map of FSL; RleSplatError if a line is not three numbers from 0 to 1.

    Parameters
    ----------
    name : str
        Of the transfer function.
    what : str
        Names the file in messages.

    Returns
    -------
    list of FileFunction
        Of one, whose unit is RELATIVE.
    """
    colors = []
    for i, line in enumerate(lines, start=1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if len(words) != 3:
            raise RleSplatError(
                f"{what}: line {i} has {len(words)} words, but a color map has red, green and blue on each line; "
                "choose a transfer function or a color map."
            )
        rgb = [number(word, f"{what}: each word of line {i}") for word in words]
        colors.append(display_color(rgb, f"{what}: the colors of line {i}"))
    if not colors:
        raise RleSplatError(f"{what} has no colors; choose a transfer function or a color map.")
    last = max(len(colors) - 1, 1)
    points = scene_linear_points([(i / last, *rgb) for i, rgb in enumerate(colors)])
    function = TransferFunction(name, RELATIVE, ((0.0, 0.0), (1.0, MOST_OPAQUE)), tuple(points), None, Shade())
    return [FileFunction(function, (NO_OPACITY_REMARK,))]
