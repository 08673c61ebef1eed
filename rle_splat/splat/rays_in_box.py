"""Which part of a slab the rays of a block of pixels cross inside the box, and where a block's samples are."""

from __future__ import annotations

import numpy as np

from ..runtime.jit import inner_loop
from .pixel_block import BLOCK
from .voxel_scanline import NO_BITS, ONE_BIT, WORD

NO_ROW = -1  # slot of a row whose rays are outside the box in this sheet's slab


@inner_loop
def interval_in_box(box_columns, box_rows, intervals, v, first_pixel, i):
    """Where the ray of pixel ``first_pixel + i`` of row ``v`` begins and ends, along the viewing direction."""
    u = first_pixel + i
    enter, leave = max(box_columns[0, u], box_rows[0, v]), min(box_columns[1, u], box_rows[1, v])
    if intervals is not None:
        if intervals.size > 0:
            enter, leave = max(enter, intervals[0, v, u]), min(leave, intervals[1, v, u])
    return enter, leave


@inner_loop
def inside_box(box_columns, box_rows, intervals, v, first_pixel, count, begin, end, lengths, deep, length_inside):
    """Shorten the rays of one block to the part of a slab that lies in the box and within their intervals."""
    length_inside[:] = np.float32(0.0)
    for i in range(count):
        enter, leave = interval_in_box(box_columns, box_rows, intervals, v, first_pixel, i)
        from_, to = max(begin, enter), min(end, leave)
        left = to - from_
        if intervals is not None:
            for hole in range(2, intervals.shape[0], 2):
                into, out = intervals[hole, v, first_pixel + i], intervals[hole + 1, v, first_pixel + i]
                gone = min(to, out) - max(from_, into)
                left -= max(gone, 0.0)  # of a hole that has all of it nothing is left, not even a rounding
        length_inside[i] = lengths[deep + i] * np.float32(min(max(left / (end - begin), 0.0), 1.0))


@inner_loop
def block_at(marks, slot, b, planes, blocks, absent):
    """Where block ``b`` of a slot's scanline begins; ``absent`` where it holds nothing."""
    if (marks[slot, b // WORD] >> np.uint64(b % WORD)) & ONE_BIT == NO_BITS:
        return absent
    return planes * BLOCK * (slot * blocks + b)
