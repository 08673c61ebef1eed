"""The content of figure files that are written the same way everywhere, and of which a figure may have several."""

from pathlib import Path

import numpy as np

from ..scene import RleSplatError
from ..scene.png import png_bytes
from .page import Page
from .raster import draw
from .svg import svg_text

SIDECAR_SUFFIX = ".figure.json"


def sidecar_path(path) -> Path:
    """The sidecar of a figure's file: fig.figure.json beside fig.svg."""
    path = Path(path)
    return path.with_name(path.stem + SIDECAR_SUFFIX)


def svg_content(page: Page, canvas) -> bytes:
    """The page as an SVG file."""
    return svg_text(page).encode("utf-8")


def png_content(page: Page, canvas) -> bytes:
    """The page as a PNG file; ``canvas()`` is the drawn page."""
    return png_bytes(canvas(), page.dpi, page.background)


CONTENTS = {".svg": svg_content, ".png": png_content}


class PageCanvas:
    """Draws a page when its pixels are first asked for: ``canvas()`` is a (H, W, 4) array of float32."""

    def __init__(self, page: Page):
        self._page, self._drawn = page, None

    def __call__(self) -> np.ndarray:
        if self._drawn is None:
            self._drawn = draw(self._page)
        return self._drawn


def check_suffix(path, further: tuple = ()) -> str:
    """The suffix of a figure's file, lower case; RleSplatError for a format that is not written.

    ``further``: suffixes that the caller writes beside CONTENTS.
    """
    suffix, known = Path(path).suffix.lower(), (*CONTENTS, *further)
    if suffix not in known:
        raise RleSplatError(f"{path} has no suffix of a format of figures; use {', '.join(known)}.")
    return suffix
