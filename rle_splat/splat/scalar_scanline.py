"""The voxel scanline of a sheet of the scalar: what two slices both keep, mixed, and marked in the sheet's scanline.

A sample that needs a voxel which is not kept is transparent.  So, other than where opacities are added, it is the
intersection of the runs of all taps that counts, and nothing else is ever looked at.
"""

from __future__ import annotations

import numpy as np

from ..jit import inner_loop
from .pixel_block import BLOCK
from .voxel_scanline import BEFORE, BLOCK_BITS, SLACK, mark_blocks

# Stands for a voxel that is not kept: whatever share of it a sample holds, it is below every value.
NOT_KEPT = np.float32(-3e38)
CODE_BITS = np.uint32(12)  # a 16-bit code of light becomes float32 by a shift and a product: encode/records.py


@inner_loop(forceinline=True)
def put_scanline(
    line, stride, reach, marks, slot, scale, shift, overhang, runs, scalars, lights, light_unit, weight, run, voxel,
    far_weight, far_run, far_voxel, width, live, live_count,
):
    """Put scalar and light of one scanline's voxels that lie in live spans on ``line``.

    ``line``: flat float32, planes of ``stride`` voxels, scalar first.  ``weight``, ``run``, ``voxel``: of the nearer
    slice, its scanline's first run and voxel; likewise the farther one, left out where its weight is 0.  ``lights``:
    (m, channels) uint16 codes, or None; ``light_unit`` makes numbers of them.  ``overhang``: voxels beyond the first
    and the last from which samples are taken back to them.  The others: see ``voxel_scanline.add_runs``.
    """
    left = shift + (1.0 - SLACK) + BEFORE * BLOCK
    right = shift - scale + SLACK + BEFORE * BLOCK
    pair = far_weight != np.float32(0.0)
    begin = end = far_begin = 0
    far_end = 0 if pair else width
    span = 0
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
            to = line[low:high]
            near = scalars[voxel + low - begin : voxel + high - begin]
            if pair:
                far = scalars[far_voxel + low - far_begin : far_voxel + high - far_begin]
                for i in range(to.size):
                    to[i] = weight * np.float32(near[i]) + far_weight * np.float32(far[i])
            else:
                for i in range(to.size):
                    to[i] = np.float32(near[i])
            if lights is not None:
                put_light(
                    line, stride, low, high, lights, light_unit, weight, voxel + low - begin, far_weight,
                    far_voxel + low - far_begin, pair,
                )
            reach[0], reach[1] = min(reach[0], low), max(reach[1], high)
            from_pixel, to_pixel = low * scale + left, high * scale + right
            if low == 0:
                from_pixel -= overhang * scale
            if high == width:
                to_pixel += overhang * scale
            mark_blocks(marks, slot, (int(from_pixel) >> BLOCK_BITS) - BEFORE, (int(to_pixel) >> BLOCK_BITS) - BEFORE)
            s += 1


@inner_loop(forceinline=True)
def put_light(line, stride, low, high, lights, light_unit, weight, voxel, far_weight, far_voxel, pair):
    """The planes of light of voxels [low, high) of a scanline; see ``put_scanline``."""
    for channel in range(lights.shape[1]):
        to = line[(channel + 1) * stride + low : (channel + 1) * stride + high]
        for i in range(to.size):
            bits = np.uint32(np.uint32(lights[voxel + i, channel]) << CODE_BITS)
            value = bits.view(np.float32) * light_unit
            if pair:
                bits = np.uint32(np.uint32(lights[far_voxel + i, channel]) << CODE_BITS)
                value = weight * value + far_weight * (bits.view(np.float32) * light_unit)
            to[i] = value
