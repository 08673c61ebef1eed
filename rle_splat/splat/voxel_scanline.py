"""The voxel scanline: runs of non-transparent voxels added to a scanline of voxels, and marked in the sheet's.

Only runs inside the spans of the rows that are not yet opaque are touched, so both coherences of the paper meet
here: the volume's (runs) and the image's (live spans).
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import inner_loop
from ..runtime.lanes import GROUP, add4, add_coded, clear_group, put_group
from ..runtime.prefetch import fetch_ahead
from .pixel_block import BLOCK

WORD = 64  # blocks of a scanline that share one word of marks
NO_BITS, ONE_BIT, ALL_BITS = np.uint64(0), np.uint64(1), np.uint64(2**64 - 1)
BLOCK_BITS = BLOCK.bit_length() - 1
BEFORE = 1 << 20  # blocks added before a position is cut to a whole number, so that cutting rounds down
SLACK = 1e-6  # pixels by which a footprint is taken to reach further, so that no rounding decides who is reached


@inner_loop
def mark_blocks(marks, row, first, last):
    """Set the marks, a bit each, of blocks ``first`` to ``last`` (inclusive) in ``marks[row]`` (words,) uint64."""
    first, last = max(first, 0), min(last, marks.shape[1] * WORD - 1)
    while first <= last:
        word = first // WORD
        end = min(last, word * WORD + WORD - 1)
        marks[row, word] |= (ALL_BITS >> np.uint64(WORD - 1 - (end - first))) << np.uint64(first - word * WORD)
        first = end + 1


@inner_loop
def _mark_reached(marks, slot, first, last, scale, shift, radius):
    """Set the marks of the blocks of pixels that footprints around voxels [first, last) reach; see ``add_runs``."""
    left = shift - radius * scale + (1.0 - SLACK) + BEFORE * BLOCK
    right = shift + (radius - 1.0) * scale + SLACK + BEFORE * BLOCK
    mark_blocks(
        marks, slot, (int(first * scale + left) >> BLOCK_BITS) - BEFORE,
        (int(last * scale + right) >> BLOCK_BITS) - BEFORE,
    )  # fmt: skip


@inner_loop
def _add_run(voxels, is_first, source, weight, line, to, stop):
    """Add ``weight`` times the float32 records from number ``source`` on to voxels [to, stop) of the line.

    ``is_first``: nothing is added to, so that a run is put there in whole groups of voxels, however long it is, and
    what lies behind it is cleared again.  (Most runs are shorter than a group: a loop over their voxels is over before
    the processor has learned for how long it goes.)
    """
    if is_first:
        last_group = voxels.size // 4 - GROUP
        while to < stop and source <= last_group:
            put_group(voxels, 4 * source, weight, line, 4 * to)
            source += GROUP
            to += GROUP
        clear_group(line, 4 * stop)
    for i in range(to, stop):
        add4(voxels, 4 * source, weight, line, 4 * i)
        source += 1


@inner_loop
def _add_coded_run(voxels, source, weight, line, to, stop):
    """As ``_add_run``, of coded records."""
    ahead = source - to
    for i in range(to, stop):
        add_coded(voxels.bytes8, ahead + i, voxels.decoding, weight, line, 4 * i)


@inner_loop
def fetch_records(voxels, first, count):
    """Ask for the memory of ``count`` records from number ``first`` on."""
    if voxels.decoding.size == 0:
        fetch_ahead(voxels.bytes16, 4 * first, 4 * count)
    else:
        fetch_ahead(voxels.bytes8, first, count)


@inner_loop
def add_runs(
    line, reach, margin, marks, slot, scale, shift, radius, weight, runs, run, voxels, voxel, width, live,
    live_count,
):  # fmt: skip
    """Add ``weight`` times the voxels of one scanline that lie in live spans to ``line``.

    ``line``: flat float32, four channels a voxel, index 0 is voxel ``-margin``; behind the last voxel there is room for
    GROUP more.  ``reach``: (2,) first voxel of the line touched and the one behind the last, widened; where the last is
    0, the line is all zero.  ``marks[slot]``: (words,) uint64, a bit for each block of sheet pixels u = ``scale`` *
    voxel + ``shift`` that a footprint of ``radius`` voxels around a touched one can reach.
    ``runs[run:]``: transparent, non-transparent, ... run lengths that sum to ``width``.  ``voxels``:
    Records; the first of this scanline is number ``voxel``.  ``live``: (n, 2)
    half-open voxel intervals, ascending, at least one.
    """
    # Runs that are no further apart have hardly a whole block of pixels between them, and are marked together.
    near = int(min(BLOCK / scale, width))
    is_first = reach[1] == 0
    span, low, high = 0, live[0, 0], live[0, 1]
    begun, touched_last, count = -1, 0, 0
    x = 0
    reach[2] += 1
    while x < width:
        x += int(runs[run])
        if x >= width:
            break
        end = x + int(runs[run + 1])
        run += 2
        while high <= x and span + 1 < live_count:
            span += 1
            low, high = live[span, 0], live[span, 1]
        if high <= x:
            break
        first = max(x, low)
        while first < end:
            last = min(end, high)
            if begun < 0:
                begun = first
                reach[0] = min(reach[0], first + margin)
            elif first - touched_last > near:
                _mark_reached(marks, slot, begun, touched_last, scale, shift, radius)
                begun = first
            touched_last = last
            count += last - first
            source, to, stop = voxel + first - x, first + margin, last + margin
            if voxels.decoding.size == 0:
                _add_run(voxels.bytes16, is_first, source, weight, line, to, stop)
            else:
                _add_coded_run(voxels, source, weight, line, to, stop)
            if end <= high or span + 1 == live_count:
                break
            span += 1
            low, high = live[span, 0], live[span, 1]
            first = low
        voxel += end - x
        x = end
    reach[3] += count
    if begun >= 0:
        _mark_reached(marks, slot, begun, touched_last, scale, shift, radius)
        reach[1] = max(reach[1], touched_last + margin)
