"""Where a picture is steep: the pixels that differ most from those around them, at which sheets and warp err most.

A silhouette of opaque matter is a step, which lies somewhere between two sheet pixels, and no filter knows where.
"""

from __future__ import annotations

import numpy as np

from ..jit import compiled, kernel, parallel_call
from ..parallel import share_out

AROUND = 1  # pixels to every side that a pixel is compared with
CHANNELS = 4


def steep_pixels(rgba: np.ndarray, threshold: float, backend: str = "auto", threads: int = 0) -> np.ndarray:
    """(H, W) uint8: 1 where a channel of ``rgba``, (H, W, 4) float32, takes values at least ``threshold`` apart in the
    pixel and its eight neighbours, those that there are."""
    found = np.zeros(rgba.shape[:2], np.uint8)
    threshold = np.float32(threshold)
    if not compiled(backend):
        spread = _extreme(rgba, np.maximum) - _extreme(rgba, np.minimum)
        found[...] = (spread >= threshold).any(axis=-1)
        return found
    flat = rgba.reshape(len(rgba), -1)
    with parallel_call(threads):
        _mark_steep(flat, threshold, found)
    return found


def _extreme(rgba, choose):
    for axis in (0, 1):
        widths = [(0, 0)] * 3
        widths[axis] = (AROUND, AROUND)
        padded = np.moveaxis(np.pad(rgba, widths, mode="edge"), axis, 0)
        rgba = np.moveaxis(choose(choose(padded[:-2], padded[1:-1]), padded[2:]), 0, axis)
    return rgba


@kernel
def _mark_steep(picture, threshold, found):
    """``picture``: (H, 4 W) float32; see ``steep_pixels``."""
    share_out(_mark_rows, found.shape[0], (picture, threshold, found))


@kernel(inner=True)
def _mark_rows(begin, end, picture, threshold, found):
    height, width = found.shape
    wide = width * CHANNELS
    # One pixel more at either end, as those beside it: rows are looked at as wholes, by wide loops.
    least, most = np.empty(wide + 2 * CHANNELS, np.float32), np.empty(wide + 2 * CHANNELS, np.float32)
    apart = np.empty(wide, np.float32)
    for row in range(begin, end):
        here, above, below = picture[row], picture[max(row - 1, 0)], picture[min(row + 1, height - 1)]
        for i in range(wide):
            a, b, c = above[i], here[i], below[i]
            low, high = (a, b) if a < b else (b, a)
            least[i + CHANNELS] = c if c < low else low
            most[i + CHANNELS] = c if c > high else high
        for i in range(CHANNELS):
            least[i], most[i] = least[i + CHANNELS], most[i + CHANNELS]
            least[wide + CHANNELS + i], most[wide + CHANNELS + i] = least[wide + i], most[wide + i]
        for i in range(wide):
            a, b, c = least[i], least[i + CHANNELS], least[i + 2 * CHANNELS]
            low = a if a < b else b
            low = c if c < low else low
            a, b, c = most[i], most[i + CHANNELS], most[i + 2 * CHANNELS]
            high = a if a > b else b
            high = c if c > high else high
            apart[i] = high - low
        for column in range(width):
            at = CHANNELS * column
            steep = (apart[at] >= threshold) | (apart[at + 1] >= threshold)
            steep |= (apart[at + 2] >= threshold) | (apart[at + 3] >= threshold)
            found[row, column] = np.uint8(steep)
