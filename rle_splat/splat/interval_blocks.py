"""Which blocks of pixels have a ray interval that meets a slab: no other block of the sheet is computed.

Clip objects leave short intervals of few rays.  The intervals of a band's blocks give, sheet by sheet, the blocks to
splat, and these the voxels of each scanline that they read, before any run of voxels is walked.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import inner_loop
from .pixel_block import BLOCK, TRANSMITTANCE
from .scratch import BAND
from .voxel_scanline import NO_BITS, ONE_BIT, WORD

MOST = np.float32(np.finfo(np.float32).max)
# Bounds of the ray intervals of a block: least begin and largest end of the intervals that are not empty; largest begin
# and least end of all; and from where to where there are holes, or, of a whole band's block, a hole common to all.
FIRST, LAST, ALL_BEGUN, NONE_ENDED, HOLE, HOLE_END = range(6)
NONE, SOME, NO_MORE = range(3)


@inner_loop
def bound_blocks(intervals, top_row, rows, bounds):
    """Bound the ray intervals of each block of each row of a band, and of the whole band, which is the last row.

    ``intervals``: of ``arguments.Rays``; where rays are whole, nothing is written.
    Out: ``bounds`` (BAND + 1, 6, blocks) float32, voxels along the viewing direction, by the numbers above.
    """
    if intervals.size == 0:
        return
    width = intervals.shape[2]
    for b in range(bounds.shape[2]):
        pixels = range(b * BLOCK, min(b * BLOCK + BLOCK, width))
        band_first, band_last = MOST, -MOST
        for r in range(rows):
            v = top_row + r
            first, last, all_begun, none_ended = MOST, -MOST, -MOST, MOST
            for u in pixels:
                begin, end = intervals[0, v, u], intervals[1, v, u]
                if begin < end:
                    first, last = min(first, begin), max(last, end)
                all_begun, none_ended = max(all_begun, begin), min(none_ended, end)
            hole, hole_end = MOST, -MOST
            for number in range(2, intervals.shape[0], 2):
                for u in pixels:
                    if intervals[number, v, u] < intervals[number + 1, v, u]:
                        hole, hole_end = min(hole, intervals[number, v, u]), max(hole_end, intervals[number + 1, v, u])
            bounds[r, FIRST, b], bounds[r, LAST, b] = first, last
            bounds[r, ALL_BEGUN, b], bounds[r, NONE_ENDED, b] = all_begun, none_ended
            bounds[r, HOLE, b], bounds[r, HOLE_END, b] = hole, hole_end
            band_first, band_last = min(band_first, first), max(band_last, last)
        bounds[BAND, FIRST, b], bounds[BAND, LAST, b] = band_first, band_last
        bounds[BAND, HOLE, b], bounds[BAND, HOLE_END, b] = MOST, -MOST
        for number in range(2, intervals.shape[0], 2):
            hole, hole_end = -MOST, MOST
            for v in range(top_row, top_row + rows):
                for u in pixels:
                    if intervals[0, v, u] < intervals[1, v, u]:
                        hole, hole_end = max(hole, intervals[number, v, u]), min(hole_end, intervals[number + 1, v, u])
            if hole_end - hole > bounds[BAND, HOLE_END, b] - bounds[BAND, HOLE, b]:
                bounds[BAND, HOLE, b], bounds[BAND, HOLE_END, b] = hole, hole_end


@inner_loop
def find_reached_blocks(bounds, begin, far, alive, reached):
    """The blocks of a band with a ray within its interval somewhere between ``begin`` and ``far``.

    ``bounds``: of ``bound_blocks``.  ``alive``: (words,) a bit for each block that is not opaque yet.  Out:
    ``reached``, likewise, those of them that are reached.  Returns NONE or SOME, or NO_MORE where no block ever will.
    """
    found = NO_MORE
    reached[:] = NO_BITS
    for b in range(bounds.shape[2]):
        bit = ONE_BIT << np.uint64(b % WORD)
        if alive[b // WORD] & bit == NO_BITS or bounds[BAND, LAST, b] <= begin:
            continue
        if found == NO_MORE:
            found = NONE
        in_hole = begin >= bounds[BAND, HOLE, b] and far <= bounds[BAND, HOLE_END, b]
        if bounds[BAND, FIRST, b] < far and not in_hole:
            reached[b // WORD] |= bit
            found = SOME
    return found


@inner_loop
def is_outside(bounds, r, b, begin, end):
    """Whether no ray of a block of a row is within its interval anywhere in a slab."""
    return bounds.size > 0 and (end <= bounds[r, FIRST, b] or begin >= bounds[r, LAST, b])


@inner_loop
def is_shortened(bounds, r, b, begin, end):
    """Whether any ray of a block of a row is outside its interval somewhere in a slab."""
    if bounds.size == 0:
        return False
    inside = begin >= bounds[r, ALL_BEGUN, b] and end <= bounds[r, NONE_ENDED, b]
    return not inside or (bounds[r, HOLE, b] < end and bounds[r, HOLE_END, b] > begin)


@inner_loop
def count_live(intervals, live, bounds, r, b, end, state, at, least, v, first_pixel, count):
    """How many pixels of a block go on behind a slab: those that are not opaque and whose ray has not ended.

    ``live``: how many are not opaque.  ``state[at:]``: the block; ``least``: transmittance at which a pixel is opaque.
    ``end``: of the slab.  ``intervals``, ``bounds``: see ``bound_blocks``.
    """
    if intervals is None:
        return live
    if bounds.size == 0 or bounds[r, NONE_ENDED, b] > end:
        return live
    live = 0
    for i in range(count):
        live += state[at + TRANSMITTANCE + i] >= least and intervals[1, v, first_pixel + i] > end
    return live
