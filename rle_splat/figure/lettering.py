"""Lettering: a line of text as strokes, the same on every machine."""

import unicodedata
from functools import cache

import numpy as np

from ..scene import RleSplatError
from .glyphs import ALIKE, CAPITAL, EM, GAP, GLYPHS, MARKS

STROKE, BOLD_STROKE = 0.84, 1.3  # of the font's units
ARC_STEP = 12.0  # degrees between points of an arc
SMALL = 5.0  # height of small letters, about which marks are placed


@cache
def _strokes(text: str) -> tuple:
    """The strokes of one glyph's description, (n, 2) arrays of the font's units."""
    found = []
    for stroke in filter(None, text.split(" | ")):
        points = []
        for word in stroke.split():
            numbers = [float(number) for number in word.strip("()").split(",")]
            points += [numbers] if len(numbers) == 2 else _arc(*numbers)
        found.append(np.array(points))
    return tuple(found)


def _arc(x, y, across, up, begin, end) -> list:
    """Points of an arc of an ellipse; angles in degrees."""
    count = max(int(np.ceil(abs(end - begin) / ARC_STEP)), 1) + 1
    angles = np.radians(np.linspace(begin, end, count))
    return np.stack((x + across * np.cos(angles), y + up * np.sin(angles)), axis=1).tolist()


def _draw(text: str) -> str:
    """The characters that are drawn for a text: letters and, after each, its combining marks."""
    alike = "".join(ALIKE.get(character, character) for character in text)
    kept = (one if one in GLYPHS else unicodedata.normalize("NFKD", one).replace("\u03bc", "µ") for one in alike)
    return "".join(kept)


def check_text(text: str, what: str) -> str:
    """Check that a text can be drawn; ``what`` names it in the message of the RleSplatError otherwise."""
    missing = next((one for one in _draw(text) if one not in GLYPHS and one not in MARKS), None)
    if missing is not None:
        raise RleSplatError(
            f"{what} has the character {missing!r}, which the lettering of figures does not have; use Latin letters, "
            "digits and common signs."
        )
    return text


def strokes_of(text: str, size: float) -> tuple[list, float]:
    """A line of text as strokes.

    Parameters
    ----------
    text : str
        Characters without a glyph are left out; see ``check_text``.
    size : float
        Font size.

    Returns
    -------
    strokes : list of (n, 2) ndarray of float64
        x to the right and y up from the begin of the baseline, in the unit of ``size``.
    width : float
        From the left edge of the first stroke to the right edge of the last one.
    """
    found, x, before = [], 0.5 * STROKE, None
    for character in _draw(text):
        if character in GLYPHS:
            width, strokes = GLYPHS[character]
            found += [stroke + (x, 0.0) for stroke in _strokes(strokes)]
            before, x = (x, width, character), x + width + GAP
        elif character in MARKS and before is not None:
            left, width, letter = before
            raised = CAPITAL - SMALL if letter.isupper() and character != "\u0327" else 0.0
            found += [stroke + (left + 0.5 * width, raised) for stroke in _strokes(MARKS[character])]
    scale = size / EM
    return [scale * stroke for stroke in found], scale * max(x - GAP + 0.5 * STROKE, 0.0)


def stroke_width(size: float, bold: bool) -> float:
    """Width of the strokes of a text, in the unit of its font size."""
    return (BOLD_STROKE if bold else STROKE) * size / EM


def text_width(text: str, size: float) -> float:
    """Width of a line of text, in the unit of its font size."""
    return strokes_of(text, size)[1]


def wrap(text: str, size: float, width: float) -> list[str]:
    """Break a text into lines at most ``width`` wide, at spaces; a longer word has a line of its own.

    Lines are not broken at no-break spaces.
    """
    lines: list[str] = []
    for word in filter(None, text.replace("\n", " ").split(" ")):
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and text_width(longer, size) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines
