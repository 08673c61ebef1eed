"""Slabs between two sheets that a ray's interval cuts: the values of the scalar at the ray's ends inside them.

The scalar is linear from sheet to sheet, so a cut slab is classified by the values where the ray begins and ends in it.
Otherwise an oblique cut through dense material would show the steps of the sheets.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import inner_loop
from .pixel_block import BLOCK

_ONE = np.float32(1.0)


@inner_loop
def cut_ends(
    intervals, v, first_pixel, count, begin, end, sheet, upper, lower, down, before, upper_before, lower_before,
    down_before, least, ends,
):  # fmt: skip
    """Whether any ray of a block is cut inside the slab from ``begin`` to ``end``; then ``ends`` (2, BLOCK), flat, has
    the values of the scalar where the rays begin in it and where they end.

    ``intervals``: of ``arguments.Rays``, for ``count`` pixels of row ``v`` from ``first_pixel`` on.  ``sheet``: blocks
    of the scanlines at ``upper`` and ``lower``, ``down`` the fraction towards the latter; ``before`` the sheet before,
    likewise.  ``least``: what is below is no sample, and is left as it is.
    """
    cut = False
    for i in range(count):
        u = first_pixel + i
        from_, to = intervals[0, v, u], intervals[1, v, u]
        inside = from_ < end and to > begin
        cut |= inside and (from_ > begin or to < end)
        for hole in range(2, intervals.shape[0], 2):
            cut |= inside and intervals[hole, v, u] < end and intervals[hole + 1, v, u] > begin
    if not cut:
        return False
    for i in range(BLOCK):
        here = sheet[upper + i] * (_ONE - down) + sheet[lower + i] * down
        there = before[upper_before + i] * (_ONE - down_before) + before[lower_before + i] * down_before
        ends[i], ends[BLOCK + i] = there, here
        if i >= count or here < least or there < least:
            continue
        u = first_pixel + i
        from_, to = max(begin, intervals[0, v, u]), min(end, intervals[1, v, u])
        for hole in range(2, intervals.shape[0], 2):
            into, out = intervals[hole, v, u], intervals[hole + 1, v, u]
            if into <= from_ < out:
                from_ = min(out, to)
            elif into < to <= out:
                to = max(into, from_)
        if from_ < to:
            ends[i] = there + (here - there) * np.float32((from_ - begin) / (end - begin))
            ends[BLOCK + i] = there + (here - there) * np.float32((to - begin) / (end - begin))
    return True
