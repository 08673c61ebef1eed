"""A page as SVG: lettering, lines and fills as vectors, pictures as embedded PNG files."""

from base64 import b64encode
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from ..scene.display import encode_srgb
from ..scene.png import png_bytes
from .page import Fill, Page, Stroke, Text, Tile
from .raster import HALO

FONT = "Arial, Helvetica, 'Liberation Sans', sans-serif"
HEADER = '<?xml version="1.0" encoding="UTF-8"?>\n'


def svg_text(page: Page) -> str:
    """A page as the content of an SVG 1.1 file, in mm.

    Returns
    -------
    str
        Lettering is text that can be edited. Pictures of a page with a background are opaque; those of a transparent
        page have straight alpha, which programs mix with what is below as they see fit.
    """
    width, height = (_number(side) for side in page.size_mm)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" width="{width}mm" '
        f'height="{height}mm" viewBox="0 0 {width} {height}" font-family={quoteattr(FONT)}>'
    ]
    if page.background is not None:
        lines.append(f'<rect width="{width}" height="{height}" fill="{_hex(page.background)}"/>')
    lines += [WRITERS[type(item)](item, page) for item in page.items]
    return HEADER + "\n".join([*lines, "</svg>"]) + "\n"


def _number(value: float) -> str:
    """Millimeters with four decimals at most, a tenth of a micrometer."""
    return f"{value:.4f}".rstrip("0").rstrip(".")


def _hex(color) -> str:
    return "#" + "".join(f"{round(255.0 * float(c)):02x}" for c in encode_srgb(np.array(color)))


def _points(points) -> str:
    return " ".join(f"{_number(x)},{_number(y)}" for x, y in points)


def _text(text: Text, page: Page) -> str:
    words = [f'x="{_number(text.x)}" y="{_number(text.y)}" font-size="{_number(text.size)}" fill="{_hex(text.color)}"']
    if text.anchor != "start":
        words.append(f'text-anchor="{text.anchor}"')
    if text.bold:
        words.append('font-weight="bold"')
    if text.halo is not None:
        wide = _number(2.0 * HALO * text.size)
        words.append(f'stroke="{_hex(text.halo)}" stroke-width="{wide}" stroke-linejoin="round" paint-order="stroke"')
    return f"<text {' '.join(words)}>{escape(text.text)}</text>"


def _stroke(stroke: Stroke, page: Page) -> str:
    return (
        f'<polyline points="{_points(stroke.points)}" fill="none" stroke="{_hex(stroke.color)}" '
        f'stroke-width="{_number(stroke.width)}" stroke-linecap="round" stroke-linejoin="round"/>'
    )


def _fill(fill: Fill, page: Page) -> str:
    return f'<polygon points="{_points(fill.points)}" fill="{_hex(fill.color)}"/>'


def _tile(tile: Tile, page: Page) -> str:
    height, width = (_number(side / page.pixels_per_mm) for side in tile.rgba.shape[:2])
    content = b64encode(png_bytes(tile.rgba, page.dpi, page.background)).decode("ascii")
    return (
        f'<image x="{_number(tile.x)}" y="{_number(tile.y)}" width="{width}" height="{height}" '
        f'preserveAspectRatio="none" xlink:href="data:image/png;base64,{content}"/>'
    )


WRITERS = {Text: _text, Stroke: _stroke, Fill: _fill, Tile: _tile}
