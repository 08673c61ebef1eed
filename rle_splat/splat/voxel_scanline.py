"""The voxel scanline: runs of non-transparent voxels added into the scanline of a sheet.

Only runs inside the spans of the row that are not yet opaque are touched, so both coherences of the paper meet
here: the volume's (runs) and the image's (live spans).
"""

from __future__ import annotations

from ..jit import kernel
from ..lanes import add4, add_coded

VOXEL_BLOCK = 8  # voxels of a scanline that share one "touched" mark


@kernel
def add_runs(
    lines, line, touched, mark, reach, margin, weight, runs, run, voxels, decoding, voxel, width, live, live_count
):
    """Add ``weight`` times the voxels of one scanline that lie in live spans to one line of the sheet.

    ``lines[line:]``: flat float32, four channels a voxel, index 0 is voxel ``-margin``.  ``touched[mark:]``: uint8
    mark per VOXEL_BLOCK of shifted voxels.  ``reach``: (2,) first and last shifted voxel touched, widened.
    ``runs[run:]``: transparent, non-transparent, ... run lengths that sum to ``width``.  ``voxels``: flat
    records, float32 or, with a ``decoding``, codes; the first of this scanline is number ``voxel``.  ``live``: (n, 2)
    half-open voxel intervals, ascending.
    """
    x = 0
    span = 0
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
            for i in range(first, last):
                if decoding is None:
                    add4(voxels, 4 * source, weight, lines, line + 4 * (i + margin))
                else:
                    add_coded(voxels, source, decoding, weight, lines, line + 4 * (i + margin))
                source += 1
            reach[0] = min(reach[0], first + margin)
            reach[1] = max(reach[1], last - 1 + margin)
            for block in range((first + margin) // VOXEL_BLOCK, (last - 1 + margin) // VOXEL_BLOCK + 1):
                touched[mark + block] = 1
            s += 1
        voxel += end - x
        x = end


@kernel
def clear_touched(lines, line, touched, mark, blocks):
    """Zero what ``add_runs`` wrote to one line, and its marks."""
    for block in range(blocks):
        if touched[mark + block] != 0:
            touched[mark + block] = 0
            first = line + 4 * VOXEL_BLOCK * block
            for i in range(first, first + 4 * VOXEL_BLOCK):
                lines[i] = 0.0
