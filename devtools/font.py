"""The letters of figures: outlines of a font, written to rle_splat/figure/font.json.

``python -m devtools.font LiberationSans-Regular.ttf`` with fontTools, which matplotlib brings; the file is in Debian's
package fonts-liberation2.  Liberation Sans has the widths of Arial, the font of figures in SVG.
"""

from __future__ import annotations

import json
import sys

from .places import ROOT

FONT = ROOT / "rle_splat" / "figure" / "font.json"
# Latin with its accents, Greek, Cyrillic, and signs.
RANGES = (
    (0x20, 0x7E), (0xA0, 0xAC), (0xAE, 0x17F), (0x386, 0x3CE), (0x400, 0x45F), (0x490, 0x491), (0x1E00, 0x1EF9),
    (0x2010, 0x2026), (0x2030, 0x2030), (0x2032, 0x2033), (0x2039, 0x203A), (0x20AC, 0x20AC), (0x2122, 0x2122),
    (0x2190, 0x2193), (0x2212, 0x2212), (0x221E, 0x221E), (0x2248, 0x2248), (0x2260, 0x2260), (0x2264, 0x2265),
)  # fmt: skip
ABOUT = "Outlines of Liberation Sans 2.1.5, in another format and with fewer letters. x to the right, y up."


def read_font(path) -> dict:
    """A font as font.json has it: see ``rle_splat.figure.lettering``."""
    from fontTools.ttLib import TTFont

    font = TTFont(path)
    names, outlines, widths = font.getBestCmap(), font["glyf"], font["hmtx"]
    wanted = {name: chr(code) for first, last in RANGES for code in range(first, last + 1) if (name := names.get(code))}
    texts = {record.nameID: " ".join(str(record).split()) for record in font["name"].names}
    glyphs, parts = {}, {}

    def key(name: str) -> str:
        """What a part of other glyphs is called; it is added where it is no letter itself."""
        if name not in wanted:
            parts[name] = outline(outlines[name])
        return wanted.get(name, name)

    def outline(glyph):
        if glyph.isComposite():
            return [[key(one.glyphName), one.x, one.y] for one in glyph.components]
        return [] if glyph.numberOfContours < 1 else _contours(glyph)

    for name, character in sorted(wanted.items(), key=lambda pair: pair[1]):
        glyphs[character] = [widths[name][0], outline(outlines[name])]
    return {
        "about": ABOUT, "copyright": texts[0], "license": texts[13], "em": font["head"].unitsPerEm,
        "glyphs": glyphs, "parts": parts,
    }  # fmt: skip


def _contours(glyph) -> str:
    """Outlines as text, a contour after the other: see ``rle_splat.figure.lettering``."""
    found, first = [], 0
    for end in glyph.endPtsOfContours:
        points, x, y = [], 0, 0
        for at in range(first, end + 1):
            (next_x, next_y), on = glyph.coordinates[at], glyph.flags[at] & 1
            points.append(f"{'' if on else '~'}{next_x - x},{next_y - y}")
            x, y = next_x, next_y
        found.append(" ".join(points))
        first = end + 1
    return " | ".join(found)


def write_font(path) -> None:
    """Write font.json, a glyph per line."""
    font = read_font(path)
    lines = []
    for name, value in font.items():
        if isinstance(value, dict):
            rows = [f"{_json(key)}: {_json(one)}" for key, one in value.items()]
            value = "{\n" + ",\n".join(rows) + "\n}"
        else:
            value = _json(value)
        lines.append(f"{_json(name)}: {value}")
    FONT.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8", newline="\n")


def _json(value) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))


if __name__ == "__main__":
    write_font(sys.argv[1])
