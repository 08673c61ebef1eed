"""The kernels of this folder once more in numpy, to be read, to run where numba is missing, and to test against.

The warp of sheets to the picture, its spline prefilter (algorithm.md 1.9), and the pixels that get rays (1.14).
"""

import numpy as np

from ..scene import NO_DEPTH
from ..view.principal_axis import dominant_axis

# Half depths that differ by more than this many voxels belong to different surfaces and are not interpolated.
SAME_SURFACE = 2.0
# In place of the half depth of a transparent sheet pixel, where the filter has lobes: between four of these nothing is
# shown. Else a line of up to 11 levels appears two pixels beside hard outlines.
CLEAR = np.finfo(np.float32).max
AROUND = 1  # distance to the neighbors with which a pixel is compared
# Samples on each side on which a coefficient depends, along each axis: 1 + 2 + 4 + 8.
MARGIN = 15
FACTORS = tuple((1 << n, np.float32(c)) for n, c in enumerate((-1.0 / 4.0, 1.0 / 14.0, 1.0 / 194.0, 1.0 / 37634.0)))
# The gain g of both axes: a constant image equals its coefficients.
GAIN = np.float32(np.prod([1.0 + 2.0 * float(weight) for _, weight in FACTORS]) ** -2)


def _product(matrix, values):
    """``matrix @ values`` along the first axis of ``values``, elementwise.

    The bits of numpy's matrix product depend on the number of elements, so a window would differ from the whole.
    """
    return np.stack([sum(weight * value for weight, value in zip(row, values, strict=True)) for row in matrix])


def _weights(fraction, polynomials):
    """(4, ...) float32 tap weights at fractions; ``polynomials`` (4, 4): one row per power."""
    fraction = fraction.astype(np.float32)
    square = fraction * fraction
    return _product(polynomials.T, (np.ones_like(fraction), fraction, square, square * fraction))


def resample(
    pixels, half, sheet_origin, to_sheet, directions, axis, sign, taps, table, most_color, depth_map, picture_origin,
    first, rgba, depth,
):  # fmt: skip
    """Fill the pixels that belong to one base plane; arguments as of ``resample``."""
    if first:
        rgba[...], depth[...] = 0.0, NO_DEPTH
    height, width = depth.shape
    sheet_height, sheet_width = half.shape
    column, row = np.meshgrid(picture_origin[0] + np.arange(width) + 0.5, picture_origin[1] + np.arange(height) + 0.5)
    pixel_centers = column, row, np.ones_like(column)
    if directions.any():
        own_axis, own_sign = dominant_axis(np.moveaxis(_product(directions, pixel_centers), 0, -1))
        mine = (own_axis == axis) & (own_sign == sign)
    else:
        mine = np.ones((height, width), bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v, w = _product(to_sheet, pixel_centers)
        u, v = u / w, v / w
        for position, origin, count in ((u, sheet_origin[0], sheet_width), (v, sheet_origin[1], sheet_height)):
            mine &= (position >= origin + 1) & (position < origin + count - 2)
    u0, v0 = (np.zeros(mine.shape, np.int64) for _ in range(2))
    u0[mine] = np.floor(u[mine]).astype(np.int64) - sheet_origin[0]
    v0[mine] = np.floor(v[mine]).astype(np.int64) - sheet_origin[1]
    corners = np.stack((half[v0, u0], half[v0, u0 + 1], half[v0 + 1, u0], half[v0 + 1, u0 + 1]))
    mine &= (corners != CLEAR).any(axis=0)
    u, v, u0, v0, corners = u[mine], v[mine], u0[mine], v0[mine], corners[:, mine]
    fu, fv = u - np.floor(u), v - np.floor(v)
    table = table.reshape(6, 4, 4)
    across, down = (_weights(fraction, table[:4, :, 0]) for fraction in (fu, fv))
    pixels = table[4, 0] * pixels + table[5, 0]
    total = np.zeros((len(u), 4), np.float32)
    for j in range(4):
        line = np.zeros_like(total)
        for i in range(4):
            line += across[i][:, None] * pixels[v0 + j - 1, u0 + i - 1]
        total += down[j][:, None] * line
    alpha = np.clip(total[:, 3], 0, 1)
    rgba[mine, :3] = np.clip(total[:, :3], 0, (most_color * alpha)[:, None])
    rgba[mine, 3] = alpha

    with np.errstate(invalid="ignore"):
        smooth = corners.max(axis=0) - corners.min(axis=0) <= SAME_SURFACE
        linear = (1 - fv) * ((1 - fu) * corners[0] + fu * corners[1]) + fv * ((1 - fu) * corners[2] + fu * corners[3])
        nearest = half[v0 + (fv >= 0.5), u0 + (fu >= 0.5)]
        at_half = np.where(smooth, linear, nearest)
    at_zero, per_voxel = _product(depth_map, (u, v, np.ones_like(u)))
    found = depth[mine]
    here = at_half < CLEAR
    found[here] = at_zero[here] + at_half[here] * per_voxel[here]
    depth[mine] = found


def find_coefficients(pixels, rows, columns, coefficients):
    """Spline coefficients of color and alpha, as ``spline_prefilter.spline_coefficients``."""
    lines = pixels[rows, columns].copy()
    lines[..., 3] = 1 - lines[..., 3]
    for axis in (1, 0):
        edges = [(MARGIN, MARGIN) if a == axis else (0, 0) for a in range(3)]
        lines = np.moveaxis(np.pad(lines, edges, mode="edge"), axis, 0)
        for stride, weight in FACTORS:
            lines = lines[stride:-stride] + weight * (lines[: -2 * stride] + lines[2 * stride :])
        lines = np.moveaxis(lines, 0, axis)
    np.multiply(GAIN, lines, out=coefficients)


def find_spread(picture, spread):
    """Largest difference of any channel around each pixel, as ``steep._spread``."""
    rgba = picture.reshape(*spread.shape, -1)
    spread[...] = (_find_extreme(rgba, np.maximum) - _find_extreme(rgba, np.minimum)).max(axis=-1)


def _find_extreme(rgba, choose):
    """Extreme of each pixel and its neighbors, per channel; ``choose``: np.minimum or np.maximum."""
    for axis in (0, 1):
        widths = [(0, 0)] * 3
        widths[axis] = (AROUND, AROUND)
        padded = np.moveaxis(np.pad(rgba, widths, mode="edge"), axis, 0)
        rgba = np.moveaxis(choose(choose(padded[:-2], padded[1:-1]), padded[2:]), 0, axis)
    return rgba
