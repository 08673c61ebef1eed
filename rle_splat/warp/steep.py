"""Where a picture is steep: the pixels that differ most from those around them, at which sheets and warp err most.

A silhouette of opaque matter is a step, which lies somewhere between two sheet pixels, and no filter knows where.
Silhouettes are lines, but noise is steep all over; so of each tile of the frame only so many pixels count.  A tile
depends on nothing but what is in it and beside it, so that a crop has the same steep pixels as the whole frame.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import compiled, kernel, parallel_call
from ..runtime.parallel import share_out

AROUND = 1  # pixels to every side that a pixel is compared with
CHANNELS = 4
TILE = 16  # pixels along each side
# Steep pixels of a tile that always count, and how many there may be in a whole frame, where that is more.  (Measured,
# 512 x 512: of scans at fine and strict no tile had more than 66.  A ray took 5 to 19 microseconds on two threads, so
# ENOUGH of them are a second or so, and of larger frames a quarter of the pixels are traced at most.)
ALWAYS, ENOUGH = 64, 1 << 16


def most_in_tile(width: int, height: int) -> int:
    """How many pixels of a tile may be steep in a frame of so many pixels."""
    return max(ALWAYS, ENOUGH * TILE**2 // (width * height))


def steep_pixels(
    rgba: np.ndarray, threshold: float, most: int = TILE**2, first_pixel=(0, 0), backend: str = "auto", threads: int = 0
) -> np.ndarray:
    """(H, W) bool: where a channel of ``rgba``, (H, W, 4) float32, takes values at least ``threshold`` apart in the
    pixel and its eight neighbours, those that there are; of each tile the ``most`` with the largest differences, of
    equal ones the first.

    ``first_pixel``: column and row in the frame of the first.  Where the picture ends in the midst of a tile of which
    the frame has more, that tile's steep pixels are not those of the whole frame.
    """
    spread = np.empty(rgba.shape[:2], np.float32)
    if compiled(backend):
        with parallel_call(threads):
            _spread(rgba.reshape(len(rgba), -1), spread)
    else:
        spread[...] = (_extreme(rgba, np.maximum) - _extreme(rgba, np.minimum)).max(axis=-1)
    steep = spread >= np.float32(threshold)
    _leave_the_steepest(steep, spread, most, first_pixel)
    return steep


def _leave_the_steepest(steep, spread, most: int, first_pixel) -> None:
    """Take from ``steep`` (H, W) what is beyond the ``most`` of each tile."""
    height, width = steep.shape
    left, top = (first % TILE for first in first_pixel)
    tiles = -(-(left + width) // TILE)
    for first in range(-top, height, TILE):  # a row of tiles at a time
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


def _extreme(rgba, choose):
    for axis in (0, 1):
        widths = [(0, 0)] * 3
        widths[axis] = (AROUND, AROUND)
        padded = np.moveaxis(np.pad(rgba, widths, mode="edge"), axis, 0)
        rgba = np.moveaxis(choose(choose(padded[:-2], padded[1:-1]), padded[2:]), 0, axis)
    return rgba


@kernel
def _spread(picture, spread):
    """How far apart the values of a channel are around each pixel, of all channels the furthest.  ``picture``: (H, 4 W)
    float32; ``spread``: (H, W) float32, written."""
    share_out(_spread_rows, spread.shape[0], (picture, spread))


@kernel(inner=True)
def _spread_rows(begin, end, picture, spread):
    height, width = spread.shape
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
            a, b, c, d = apart[at], apart[at + 1], apart[at + 2], apart[at + 3]
            a, b = a if a > b else b, c if c > d else d
            spread[row, column] = a if a > b else b
