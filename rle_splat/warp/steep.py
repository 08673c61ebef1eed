"""Steep pixels of a picture: those that differ most from their neighbors, where sheets and warp have the largest error.

The silhouette of an opaque object is a step between two sheet pixels, and no filter knows its exact position.
Silhouettes are lines, but noise is steep everywhere, so only a limited number of pixels per tile of the frame counts. A
tile depends only on its pixels and their neighbors, so a crop has the same steep pixels as the whole frame.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import kernel, run_either
from ..runtime.parallel import share_out
from . import reference

CHANNELS = 4
TILE = 16  # pixels along each side
# Steep pixels of a tile that always count, and how many a whole frame may have if that is more. Measured at 512 x 512:
# scans at the qualities fine and strict had at most 66 in a tile. A ray took 5 to 19 microseconds on two threads, so
# ENOUGH rays take about a second. Of larger frames at most a quarter of the pixels is traced.
ALWAYS, ENOUGH = 64, 1 << 16
UNLIMITED = 0.02  # thresholds up to this, five levels, call for a ray wherever something is seen


def most_in_tile(width: int, height: int, threshold: float) -> int:
    """Largest number of steep pixels of a tile, in a frame of ``width`` x ``height`` pixels."""
    return TILE**2 if threshold <= UNLIMITED else max(ALWAYS, ENOUGH * TILE**2 // (width * height))


def steep_pixels(
    rgba: np.ndarray, threshold: float, most: int = TILE**2, first_pixel=(0, 0), threads: int = 0
) -> np.ndarray:
    """Find the steep pixels of a picture.

    Parameters
    ----------
    rgba : (H, W, 4) ndarray of float32
    threshold : float
        A pixel is steep if any channel differs by at least this much among the pixel and its neighbors. Up to
        UNLIMITED all pixels are steep that are seen, or that have a neighbor that is.
    most : int
        Largest number of steep pixels per tile; those with the largest differences count, ties go to the first.
    first_pixel : (column, row)
        Number of the first pixel in the frame. In a tile of which the picture has only a part, the result may differ
        from that of the whole frame.
    threads : int
        0 for one per core.

    Returns
    -------
    (H, W) ndarray of bool
    """
    spread = np.empty(rgba.shape[:2], np.float32)
    run_either(threads, _spread, reference.find_spread, rgba.reshape(len(rgba), -1), spread)
    steep = (spread > 0.0) | (rgba[..., 3] > 0.0) if threshold <= UNLIMITED else spread >= np.float32(threshold)
    _leave_the_steepest(steep, spread, most, first_pixel)
    return steep


def _leave_the_steepest(steep, spread, most: int, first_pixel) -> None:
    """Remove from ``steep`` (H, W) all but the ``most`` steepest pixels of each tile."""
    height, width = steep.shape
    left, top = (first % TILE for first in first_pixel)
    tiles = -(-(left + width) // TILE)
    for first in range(-top, height, TILE):  # one row of tiles at a time
        rows = slice(max(first, 0), first + TILE)
        if np.count_nonzero(steep[rows]) <= most:
            continue
        padded = np.full((TILE, tiles * TILE), -1.0, np.float32)
        part = slice(rows.start - first, rows.start - first + len(steep[rows])), slice(left, left + width)
        padded[part] = np.where(steep[rows], spread[rows], -1.0)
        by_tile = padded.reshape(TILE, tiles, TILE).swapaxes(0, 1).reshape(tiles, -1)
        kept = np.zeros(by_tile.shape, bool)
        np.put_along_axis(kept, np.argsort(-by_tile, axis=1, kind="stable")[:, :most], True, axis=1)
        steep[rows] &= kept.reshape(tiles, TILE, TILE).swapaxes(0, 1).reshape(padded.shape)[part]


@kernel
def _spread(picture, spread):
    """Largest difference of any channel around each pixel: ``picture`` (H, 4 W) float32 -> ``spread`` (H, W)."""
    share_out(_spread_rows, spread.shape[0], (picture, spread))


@kernel(inner=True)
def _spread_rows(begin, end, picture, spread):
    """``_spread`` for rows [begin, end)."""
    height, width = spread.shape
    wide = width * CHANNELS
    # Padded by one pixel at either end, which repeats the border, so that whole rows are processed by wide loops.
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
            a, b, c, d = apart[at], apart[at + 1], apart[at + 2], apart[at + 3]
            a, b = a if a > b else b, c if c > d else d
            spread[row, column] = a if a > b else b
