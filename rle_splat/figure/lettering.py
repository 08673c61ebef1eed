"""Lettering: a line of text as outlines, the same on every machine.

The outlines are those of Liberation Sans, whose letters are as wide as those of Arial, the font of figures in SVG.
``font.json`` has for each character its advance and either its contours or the glyphs of which it is put together,
[key, x, y] each, in units of which an em has ``em``.  Contours are separated by " | ".  The points of a contour are
"x,y", relative to the point before, on the curve, or "~x,y", control points of quadratic curves as in TrueType: in the
middle of two of them is a point on the curve.  ``devtools/font.py`` writes the file.
"""

import json
import unicodedata
from functools import cache
from pathlib import Path

import numpy as np

from ..scene import RleSplatError

FONT = Path(__file__).with_name("font.json")
CURVE_POINTS = 6  # into which a quadratic curve is divided
ALIKE = {"\u202f": " ", "\u2009": " ", "\u03bc": "µ"}  # characters that are drawn as others


@cache
def _font() -> dict:
    return json.loads(FONT.read_text(encoding="utf-8"))


@cache
def _outline(key: str) -> tuple:
    """The contours of a glyph or a part of glyphs, closed polygons of (n, 2) float64 in ems."""
    font = _font()
    content = font["glyphs"][key][1] if key in font["glyphs"] else font["parts"][key]
    if isinstance(content, str):
        return tuple(_contour(text) / font["em"] for text in content.split(" | "))
    return tuple(part + np.array(shift) / font["em"] for name, *shift in content for part in _outline(name))


def _contour(text: str) -> np.ndarray:
    words = text.split()
    on = np.array([not word.startswith("~") for word in words])
    points = np.cumsum([[float(number) for number in word.strip("~").split(",")] for word in words], axis=0)
    found = []
    share = np.arange(CURVE_POINTS)[:, None] / CURVE_POINTS
    for n in range(len(points)):
        before, here, after = points[n - 1], points[n], points[(n + 1) % len(points)]
        if on[n]:
            found.append(points[n : n + 1])
            continue
        begin = before if on[n - 1] else 0.5 * (before + here)
        end = after if on[(n + 1) % len(points)] else 0.5 * (here + after)
        curve = (1.0 - share) ** 2 * begin + 2.0 * share * (1.0 - share) * here + share**2 * end
        found.append(curve[1:] if on[n - 1] else curve)
    return np.concatenate(found)


def _glyphs(text: str) -> list[str]:
    """The characters that are drawn for a text; letters and their marks become one character where there is one."""
    composed = unicodedata.normalize("NFC", text)
    return [ALIKE.get(character, character) for character in composed]


def check_text(text: str, what: str) -> str:
    """Check that a text can be drawn; ``what`` names it in the message of the RleSplatError otherwise."""
    missing = next((one for one in _glyphs(text) if one not in _font()["glyphs"]), None)
    if missing is not None:
        raise RleSplatError(
            f"{what} has the character {missing!r}, which the lettering of figures does not have; use Latin, Greek or "
            "Cyrillic letters, digits and common signs."
        )
    return text


def outlines_of(text: str, size: float) -> tuple[list, float]:
    """A line of text as outlines.

    Parameters
    ----------
    text : str
        Characters without a glyph are left out; see ``check_text``.
    size : float
        Font size.

    Returns
    -------
    outlines : list of (n, 2) ndarray of float64
        Closed polygons; those within others, turned around, are holes. x to the right and y up from the begin of the
        baseline, in the unit of ``size``.
    width : float
        From the begin of the line to its end.
    """
    glyphs, em = _font()["glyphs"], _font()["em"]
    found, x = [], 0.0
    for character in _glyphs(text):
        if character in glyphs:
            found += [size * (contour + (x, 0.0)) for contour in _outline(character)]
            x += glyphs[character][0] / em
    return found, size * x


def text_width(text: str, size: float) -> float:
    """Width of a line of text, in the unit of its font size."""
    return outlines_of(text, size)[1]


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
