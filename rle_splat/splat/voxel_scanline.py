"""The voxel scanline: runs of non-transparent voxels added to a scanline of voxels, and marked in the sheet's.

Only runs inside the spans of the rows that are not yet opaque are touched, so both coherences of the paper meet
here: the volume's (runs) and the image's (live spans).
"""

from __future__ import annotations

import numpy as np

from ..jit import inner_loop
from ..lanes import add4, add_coded
from .pixel_block import BLOCK

WORD = 64  # blocks of a scanline that share one word of marks
ONE_BIT, ALL_BITS = np.uint64(1), np.uint64(2**64 - 1)
BLOCK_BITS = BLOCK.bit_length() - 1
BEFORE = 1 << 20  # blocks added before a position is cut to a whole number, so that cutting rounds down
SLACK = 1e-6  # pixels by which a footprint is taken to reach further, so that no rounding decides who is reached


@inner_loop(forceinline=True)
def mark_blocks(marks, row, first, last):
    """Set the marks, a bit each, of blocks ``first`` to ``last`` (inclusive) in ``marks[row]`` (words,) uint64."""
    first, last = max(first, 0), min(last, marks.shape[1] * WORD - 1)
    while first <= last:
        word = first // WORD
        end = min(last, word * WORD + WORD - 1)
        marks[row, word] |= (ALL_BITS >> np.uint64(WORD - 1 - (end - first))) << np.uint64(first - word * WORD)
        first = end + 1


@inner_loop(forceinline=True)
def add_runs(
    line, reach, margin, marks, slot, scale, shift, radius, weight, runs, run, voxels, decoding, voxel, width, live,
    live_count,
):
    """Add ``weight`` times the voxels of one scanline that lie in live spans to ``line``.

    ``line``: flat float32, four channels a voxel, index 0 is voxel ``-margin``.  ``reach``: (2,) first voxel of the
    line touched and the one behind the last, widened.  ``marks[slot]``: (words,) uint64, a bit for each block of
    sheet pixels u = ``scale`` * voxel + ``shift`` that a footprint of ``radius`` voxels around a touched one can reach.
    ``runs[run:]``: transparent, non-transparent, ... run lengths that sum to ``width``.  ``voxels``: flat
    records, float32 or, with a ``decoding``, codes; the first of this scanline is number ``voxel``.  ``live``: (n, 2)
    half-open voxel intervals, ascending.
    """
    left = shift - radius * scale + (1.0 - SLACK) + BEFORE * BLOCK
    right = shift + (radius - 1.0) * scale + SLACK + BEFORE * BLOCK
    x = 0
    span = 0
    touched_first, touched_last = width, 0
    reach[2] += 1
    while x < width:
        x += int(runs[run])
        if x >= width:
            break
        end = x + int(runs[run + 1])
        run += 2
        while span < live_count and live[span, 1] <= x:
            span += 1
        if span == live_count:
            break
        s = span
        while s < live_count and live[s, 0] < end:
            first = max(x, live[s, 0])
            last = min(end, live[s, 1])
            source = voxel + first - x
            reach[3] += last - first
            for i in range(first + margin, last + margin):
                if decoding is None:
                    add4(voxels, 4 * source, weight, line, 4 * i)
                else:
                    add_coded(voxels, source, decoding, weight, line, 4 * i)
                source += 1
            touched_first, touched_last = min(touched_first, first), last
            mark_blocks(
                marks, slot, (int(first * scale + left) >> BLOCK_BITS) - BEFORE,
                (int(last * scale + right) >> BLOCK_BITS) - BEFORE,
            )
            s += 1
        voxel += end - x
        x = end
    reach[0] = min(reach[0], touched_first + margin)
    reach[1] = max(reach[1], touched_last + margin if touched_last > 0 else 0)
