"""The voxel scanline of a sheet of the scalar: voxels kept in both slices, interpolated, and the blocks they reach.

A sample that needs a voxel which is not kept is transparent.  So only the intersection of the runs of both slices
counts, whereas classified voxels add up over the union.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import inner_loop
from ..runtime.prefetch import fetch_ahead
from ..shade.sample_light import NORMAL
from ..volume.stored_scalars import by_type
from .pixel_block import BLOCK
from .voxel_groups import (
    FEW,
    MANY,
    MIX_CODES,
    MIX_NORMALS,
    MIX_SHADOWED,
    mix_few_scalars,
    mix_many_scalars,
    mix_one_scalar,
)
from .voxel_scanline import BEFORE, BLOCK_BITS, SLACK, mark_blocks

# Stands for a voxel that is not kept: whatever share of it a sample holds, it is below every value.
NOT_KEPT = np.float32(-3e38)


@inner_loop
def put_scanline(
    line, stride, reach, marks, slot, scale, shift, overhang, runs, scalars, codes, values, lamps, weight, run, voxel,
    far_weight, far_run, far_voxel, width, live, live_count,
):  # fmt: skip
    """Put scalar and codes of one scanline's voxels that lie in live spans on ``line``.

    ``line``: flat float32, planes of ``stride`` voxels, scalar first.  ``weight``, ``run``, ``voxel``: of the nearer
    slice, its scanline's first run and voxel; likewise the farther one, left out where its weight is 0.  ``scalars``:
    StoredScalars.  ``codes``: (m, channels) int16.  ``values``: (m, channels) float32 of further channels, whose planes
    follow, or None.  ``lamps``: None where codes are not lit.  ``overhang``: voxels beyond the first and the last from
    which samples are taken back to them.  The others: see ``voxel_scanline.add_runs``.
    """
    left = shift + (1.0 - SLACK) + BEFORE * BLOCK
    right = shift - scale + SLACK + BEFORE * BLOCK
    pair = far_weight != np.float32(0.0)
    begin = end = far_begin = 0
    far_end = 0 if pair else width
    span = 0
    reach[2] += 1
    while True:
        if end <= far_end:  # the one that ends first goes on
            if end >= width:
                break
            voxel += end - begin
            begin = end + int(runs[run])
            if begin >= width:
                break
            end = begin + int(runs[run + 1])
            run += 2
        else:
            if far_end >= width:
                break
            far_voxel += far_end - far_begin
            far_begin = far_end + int(runs[far_run])
            if far_begin >= width:
                break
            far_end = far_begin + int(runs[far_run + 1])
            far_run += 2
        first, last = max(begin, far_begin), min(end, far_end)
        if first >= last:
            continue
        while span < live_count and live[span, 1] <= first:
            span += 1
        if span == live_count:
            break
        s = span
        while s < live_count and live[s, 0] < last:
            low, high = max(first, live[s, 0]), min(last, live[s, 1])
            at = voxel + low - begin
            far_at = far_voxel + low - far_begin if pair else at
            reach[3] += high - low
            _put_scalars(scalars, line, low, high - low, weight, at, far_weight, far_at, pair)
            put_codes(lamps, codes, line, stride, low, high - low, weight, at, far_weight, far_at, pair)
            put_values(values, codes, line, stride, low, high - low, weight, at, far_weight, far_at, pair)
            reach[0], reach[1] = min(reach[0], low), max(reach[1], high)
            from_pixel, to_pixel = low * scale + left, high * scale + right
            if low == 0:
                from_pixel -= overhang * scale
            if high == width:
                to_pixel += overhang * scale
            mark_blocks(marks, slot, (int(from_pixel) >> BLOCK_BITS) - BEFORE, (int(to_pixel) >> BLOCK_BITS) - BEFORE)
            s += 1


@inner_loop
def _put_stored(stored, line, to, count, weight, voxel, far_weight, far_voxel, pair):
    """``count`` voxels of a scanline from number ``to`` on; see ``put_scanline``."""
    size = MANY if count >= MANY else FEW if count >= FEW else 1
    i = 0
    while i < count:
        i = min(i, count - size)
        if size == MANY:
            mix_many_scalars(line, to + i, stored, voxel + i, far_voxel + i, weight, far_weight, pair)
        elif size == FEW:
            mix_few_scalars(line, to + i, stored, voxel + i, far_voxel + i, weight, far_weight, pair)
        else:
            mix_one_scalar(line, to + i, stored, voxel + i, far_voxel + i, weight, far_weight, pair)
        i += size


_put_scalars, fetch_scalars = by_type(_put_stored), by_type(fetch_ahead)


def _putter(many, few, one):
    @inner_loop
    def put(codes, channel, line, stride, to, count, weight, voxel, far_weight, far_voxel, pair):
        size = MANY if count >= MANY else FEW if count >= FEW else 1
        stored, i = codes.shape[1], 0
        while i < count:
            i = min(i, count - size)
            at, near, far = to + i, voxel + i, far_voxel + i
            if size == MANY:
                many(line, stride, at, codes, stored, channel, near, far, weight, far_weight, pair)
            elif size == FEW:
                few(line, stride, at, codes, stored, channel, near, far, weight, far_weight, pair)
            else:
                one(line, stride, at, codes, stored, channel, near, far, weight, far_weight, pair)
            i += size

    return put


_put_code, _put_normals, _put_shadowed = _putter(*MIX_CODES), _putter(*MIX_NORMALS), _putter(*MIX_SHADOWED)


@inner_loop
def put_codes(lamps, codes, line, stride, to, count, weight, voxel, far_weight, far_voxel, pair):
    """The planes of codes of the same voxels, if there are any."""
    if lamps is not None:
        if codes.shape[1] == NORMAL:
            _put_normals(codes, 0, line, stride, to, count, weight, voxel, far_weight, far_voxel, pair)
            return
        if codes.shape[1] == NORMAL + 1:
            _put_shadowed(codes, 0, line, stride, to, count, weight, voxel, far_weight, far_voxel, pair)
            return
    for channel in range(codes.shape[1]):
        _put_code(codes, channel, line, stride, to, count, weight, voxel, far_weight, far_voxel, pair)


@inner_loop
def put_values(values, codes, line, stride, to, count, weight, voxel, far_weight, far_voxel, pair):
    """The planes of further channels of the same voxels, behind those of their codes, if there are any."""
    if values is not None:
        behind = line[stride * codes.shape[1] :]
        for channel in range(values.shape[1]):
            _put_code(values, channel, behind, stride, to, count, weight, voxel, far_weight, far_voxel, pair)
