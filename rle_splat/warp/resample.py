"""Resampling the intermediate image at the ray of each pixel."""

from __future__ import annotations

import math

import numpy as np

from ..jit import kernel, prange
from ..lanes import mix2x2, sum4x4

# Half depths that differ by more than this many voxels lie on different surfaces and are not interpolated.
SAME_SURFACE = 2.0
_SIXTH = np.float32(1.0 / 6.0)


@kernel
def _bspline_weights(t):
    """Cubic B-spline weights of the four taps around fraction ``t``."""
    one = np.float32(1.0)
    r = one - t
    w0 = _SIXTH * r * r * r
    w3 = _SIXTH * t * t * t
    w1 = _SIXTH * (np.float32(4.0) + t * t * (np.float32(3.0) * t - np.float32(6.0)))
    return w0, w1, one - w0 - w1 - w3, w3


@kernel
def _belongs(directions, column, row, axis, sign):
    """Whether the ray of a pixel advances fastest along ``axis`` in direction ``sign`` (ties: earlier axis)."""
    along = directions[axis, 0] * column + directions[axis, 1] * row + directions[axis, 2]
    if along * sign <= 0.0:
        return False
    for other in range(3):
        if other == axis:
            continue
        sideways = abs(directions[other, 0] * column + directions[other, 1] * row + directions[other, 2])
        if sideways > abs(along) or (sideways == abs(along) and other < axis):
            return False
    return True


@kernel
def _half_depth(half, u0, v0, fu, fv):
    """Half depth at fractions (fu, fv) beyond pixel (u0, v0): linear on one surface, the nearest pixel's across an
    edge."""
    a, b = half[v0, u0], half[v0, u0 + 1]
    c, d = half[v0 + 1, u0], half[v0 + 1, u0 + 1]
    least, most = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
    if most - least <= SAME_SURFACE:
        return (1.0 - fv) * ((1.0 - fu) * a + fu * b) + fv * ((1.0 - fu) * c + fu * d)
    return half[v0 + int(fv >= 0.5), u0 + int(fu >= 0.5)]


@kernel(parallel=True)
def resample(
    pixels, half, sheet_origin, to_sheet, directions, axis, sign, cubic, most_colour, depth_map, picture_origin, rgba,
    depth,
):
    """Fill the pixels that belong to one base plane.

    ``pixels``: (h, w, 4) float32 colour and alpha, spline coefficients when ``cubic``.  ``half``: (h, w)
    float32 half depths along the viewing direction, inf for none.  ``to_sheet``: (3, 3) picture pixel to sheet
    pixel.  ``directions``: (3, 3) picture pixel to index-space ray, all zero for parallel rays.  ``depth_map``:
    (2, 3), sheet pixel to planar depth at position 0 and per voxel.  Out: ``rgba`` (H, W, 4), ``depth`` (H, W).

    ``sheet_origin`` (u, v) and ``picture_origin`` (column, row): the numbers of the first pixel of the arrays.  All
    positions are reckoned in these numbers, so that a window of a sheet, or of a picture, gets the same bits.
    """
    height, width = depth.shape
    sheet_height, sheet_width = half.shape
    flat = pixels.reshape(-1)
    parallel_rays = directions[axis, 0] == 0.0 and directions[axis, 1] == 0.0 and directions[axis, 2] == 0.0
    one, zero = np.float32(1.0), np.float32(0.0)
    first_u, last_u = sheet_origin[0] + 1, sheet_origin[0] + sheet_width - 2
    first_v, last_v = sheet_origin[1] + 1, sheet_origin[1] + sheet_height - 2
    for r in prange(height):
        row = r + picture_origin[1] + 0.5
        sample = np.empty(4, np.float32)
        for c in range(width):
            column = c + picture_origin[0] + 0.5
            if not parallel_rays and not _belongs(directions, column, row, axis, sign):
                continue
            w = to_sheet[2, 0] * column + (to_sheet[2, 1] * row + to_sheet[2, 2])
            u = (to_sheet[0, 0] * column + (to_sheet[0, 1] * row + to_sheet[0, 2])) / w
            v = (to_sheet[1, 0] * column + (to_sheet[1, 1] * row + to_sheet[1, 2])) / w
            if not (u >= first_u and v >= first_v and u < last_u and v < last_v):
                continue
            whole_u, whole_v = math.floor(u), math.floor(v)
            u0, v0 = whole_u - sheet_origin[0], whole_v - sheet_origin[1]
            fu, fv = np.float32(u - whole_u), np.float32(v - whole_v)
            if cubic:
                first_tap = 4 * ((v0 - 1) * sheet_width + u0 - 1)
                sum4x4(flat, first_tap, 4 * sheet_width, _bspline_weights(fu), _bspline_weights(fv), sample, 0)
            else:
                mix2x2(flat, 4 * (v0 * sheet_width + u0), 4 * sheet_width, fu, fv, sample, 0)
            alpha = min(max(sample[3], zero), one)
            for channel in range(3):
                rgba[r, c, channel] = min(max(sample[channel], zero), most_colour * alpha)
            rgba[r, c, 3] = alpha
            at_half = _half_depth(half, u0, v0, u - whole_u, v - whole_v)
            if at_half < np.inf:
                at_zero = depth_map[0, 0] * u + depth_map[0, 1] * v + depth_map[0, 2]
                per_voxel = depth_map[1, 0] * u + depth_map[1, 1] * v + depth_map[1, 2]
                depth[r, c] = at_zero + at_half * per_voxel
