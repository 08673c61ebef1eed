"""Writing a figure's files; PDF with matplotlib, which is optional and never part of the extension."""

from __future__ import annotations

from importlib.util import find_spec
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..figure.files import CONTENTS, PageCanvas, check_suffix
from ..figure.page import MM_PER_POINT, Fill, Page, Stroke, Text, Tile
from ..figure.raster import HALO
from ..scene import RleSplatError
from ..scene.checks import check_first
from ..scene.display import encode_srgb, to_bytes
from .images import write_whole, writer_for
from .rows import ExrRows

if TYPE_CHECKING:
    from ..figure.make import MadeFigure

PDF_FONT, PDF_FONT_SCALE = "DejaVu Sans", 0.88  # comes with matplotlib; it is wider than the lettering of the layout
ALIGNMENTS = {"start": "left", "middle": "center", "end": "right"}
PDF_NEEDS = "Writing .pdf needs matplotlib; install it with pip install rle-splat[plots], or choose .svg."


def check_figure_file(path) -> None:
    """Refuse a figure's file whose format is unknown, or needs a package that is not installed."""
    suffix = check_suffix(path, tuple(FURTHER))
    if suffix == ".pdf" and find_spec("matplotlib") is None:
        raise RleSplatError(PDF_NEEDS)
    if suffix == ".exr":
        writer_for(path)


def write_figure(figure: MadeFigure, path: str | PathLike) -> None:
    """Write a figure to a file.

    Parameters
    ----------
    figure : MadeFigure
        That of ``make_figure``.
    path : str or Path
        Its suffix is that of a format: .svg (letters and lines can be edited), .png, .pdf (needs matplotlib) or .exr
        (needs OpenEXR).

    Raises
    ------
    RleSplatError
        If the suffix is unknown, or a package is missing.
    """
    from ..figure.make import MadeFigure

    check_first(figure, MadeFigure, "write_figure(figure, path)")
    check_figure_file(path)
    write_page(path, Path(path).suffix.lower(), figure.page, PageCanvas(figure.page))


def write_page(path, suffix: str, page: Page, canvas) -> None:
    """Write one file of a figure.

    Parameters
    ----------
    path : path-like
    suffix : str
        Its format.
    canvas : callable
        Returns the drawn page, a (H, W, 4) ndarray of float32.
    """
    if suffix in CONTENTS:
        with open(path, "wb") as file:
            file.write(CONTENTS[suffix](page, canvas))
    else:
        FURTHER[suffix](path, page, canvas)


def _write_exr(path, page: Page, canvas) -> None:
    write_whole(ExrRows, path, canvas(), None)


def _write_pdf(path, page: Page, canvas) -> None:
    """Write the page as vectors, its pictures as images of their own pixels; without a date, so equal pages agree."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_pdf import FigureCanvasPdf
    from matplotlib.figure import Figure

    figure = Figure(figsize=(page.width / page.dpi, page.height / page.dpi), dpi=page.dpi)
    canvas_pdf = FigureCanvasPdf(figure)
    figure.patch.set_alpha(0.0)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    wide, tall = page.size_mm
    axes.set(xlim=(0.0, wide), ylim=(tall, 0.0))
    axes.axis("off")
    if page.background is not None:
        axes.fill((0.0, wide, wide, 0.0), (0.0, 0.0, tall, tall), color=_color(page.background), lw=0, zorder=0)
    for order, item in enumerate(page.items, 1):
        PDF_DRAWERS[type(item)](axes, item, page, order)
    # Fonts as TrueType, so that lettering can be edited; this setting counts within the block alone.
    with rc_context({"pdf.fonttype": 42}):
        canvas_pdf.print_pdf(path, metadata={"CreationDate": None, "ModDate": None})


def _color(color) -> tuple:
    return tuple(float(c) for c in encode_srgb(np.array(color)))


def _pdf_text(axes, text: Text, page: Page, order: int) -> None:
    from matplotlib.patheffects import Normal, withStroke

    effects = None
    if text.halo is not None:
        wide = 2.0 * HALO * text.size / MM_PER_POINT
        effects = [withStroke(linewidth=wide, foreground=_color(text.halo)), Normal()]
    axes.text(
        text.x, text.y, text.text, fontsize=PDF_FONT_SCALE * text.size / MM_PER_POINT, family=PDF_FONT,
        color=_color(text.color), ha=ALIGNMENTS[text.anchor], va="baseline", weight="bold" if text.bold else "normal",
        zorder=order, path_effects=effects, parse_math=False,
    )  # fmt: skip


def _pdf_stroke(axes, stroke: Stroke, page: Page, order: int) -> None:
    x, y = zip(*stroke.points)
    axes.plot(
        x, y, color=_color(stroke.color), lw=stroke.width / MM_PER_POINT, zorder=order, solid_capstyle="round",
        solid_joinstyle="round", clip_on=False,
    )  # fmt: skip


def _pdf_fill(axes, fill: Fill, page: Page, order: int) -> None:
    x, y = zip(*fill.points)
    axes.fill(x, y, color=_color(fill.color), lw=0, zorder=order)


def _pdf_tile(axes, tile: Tile, page: Page, order: int) -> None:
    height, width = (side / page.pixels_per_mm for side in tile.rgba.shape[:2])
    extent = (tile.x, tile.x + width, tile.y + height, tile.y)
    pixels = to_bytes(tile.rgba, page.background)
    axes.imshow(pixels, extent=extent, interpolation="none", zorder=order, aspect="auto")
    wide, tall = page.size_mm
    axes.set(xlim=(0.0, wide), ylim=(tall, 0.0))


PDF_DRAWERS = {Text: _pdf_text, Stroke: _pdf_stroke, Fill: _pdf_fill, Tile: _pdf_tile}
FURTHER = {".exr": _write_exr, ".pdf": _write_pdf}
