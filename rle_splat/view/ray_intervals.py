"""Ray intervals: where the rays of sheet pixels begin and end, for clip distances and meshes in the volume."""

from __future__ import annotations

import numpy as np

from ..runtime.jit import compiled, inner_loop, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from ..volume.axes import AXES
from . import reference
from .base_plane import BasePlane
from .reference import MOST, SAME_SURFACE

NO_LAYER = np.empty((0, 0), np.float32)  # for kernels, so that one serves pictures with and without meshes


def ray_intervals(
    plane: BasePlane, nearest: float, furthest: float, layer: np.ndarray | None = None, first_pixel=(0, 0), *,
    threads: int = 0,
) -> np.ndarray:  # fmt: skip
    """Ray intervals of the sheet pixels of a plane.

    Parameters
    ----------
    nearest, furthest : float
        Planar depths between which rays are integrated, world units.
    layer : (rows, columns) ndarray or None
        Planar depth at which each pixel's ray meets a mesh, inf for none. Must cover ``pixels_read(plane)``.
    first_pixel : (column, row)
        Pixel of the picture at which ``layer`` begins.
    threads : int
        0 for one per core.

    Returns
    -------
    (2, H, W) ndarray of float32
        Begin and end of each ray, voxels along the viewing direction.
    """
    columns, rows = _along_and_across(plane)
    intervals = np.empty((2, plane.height, plane.width), np.float32)
    layer = read_only(np.ascontiguousarray(NO_LAYER if layer is None else layer, np.float32))
    picture = plane.view.width - 1.0, plane.view.height - 1.0
    arguments = (columns, rows, float(nearest), float(furthest), layer, *first_pixel, *picture, intervals)
    if compiled():
        with parallel_call(threads):
            find_intervals(plane.height, arguments)
    else:
        reference.find_intervals(*arguments)
    return intervals


def _along_and_across(plane: BasePlane) -> tuple[np.ndarray, np.ndarray]:
    """Column and row shares, (5, W) and (5, H) float64, of quantities that are affine in the sheet pixel.

    The sum of both is the homogeneous pixel of the picture (3), the planar depth of the ray at axis position 0, and its
    change per voxel along the viewing direction.
    """
    i, j, k = AXES[plane.axis]
    x, y = plane.points
    dx, dy = plane.slopes(x, y)
    depth, h = plane.view.depth, plane.homography
    columns, rows = np.empty((5, len(x))), np.empty((5, len(y)))
    for n in range(3):
        columns[n], rows[n] = h[n, 0] * x, h[n, 1] * y + h[n, 2]
    columns[4], rows[4] = depth[i] * dx, depth[j] * dy + depth[k]
    columns[3] = depth[i] * x - plane.reference * columns[4]
    rows[3] = depth[j] * y + (depth[k] * plane.reference + depth[3]) - plane.reference * rows[4]
    columns[4], rows[4] = plane.sign * columns[4], plane.sign * rows[4]
    return columns, rows


@kernel
def find_intervals(height, arguments):
    """Kernel of ``ray_intervals`` for rows [0, ``height``); ``arguments``: of ``_interval_rows``."""
    share_out(_interval_rows, height, arguments)


@inner_loop
def _interval_rows(begin, end, columns, rows, nearest, furthest, layer, left, top, last_column, last_row, intervals):
    """Ray intervals of rows [begin, end), to ``intervals`` (2, H, W).

    ``columns``, ``rows``: of ``_along_and_across``. ``layer``: (h, w) float32, empty for none, whose first pixel is at
    column ``left`` and row ``top`` of a picture with the last column ``last_column`` and the last row ``last_row``.
    """
    for v in range(begin, end):
        for u in range(intervals.shape[2]):
            at_zero, per_voxel = columns[3, u] + rows[3, v], columns[4, u] + rows[4, v]
            stop = furthest
            if layer.size > 0:
                c = columns[2, u] + rows[2, v]
                column = _within((columns[0, u] + rows[0, v]) / c, last_column)
                row = _within((columns[1, u] + rows[1, v]) / c, last_row)
                stop = min(stop, _sample(layer, left, top, column, row))
            first, last = -MOST, MOST
            if per_voxel > 0.0:
                first = min(max((nearest - at_zero) / per_voxel, -MOST), MOST)
                last = min(max((stop - at_zero) / per_voxel, -MOST), MOST)
            intervals[0, v, u], intervals[1, v, u] = first, last


@inner_loop
def _within(position, last):
    """Coordinate of the picture from the center of its first pixel, clamped to its sides; 0 for NaN."""
    return 0.0 if position != position else min(max(position - 0.5, 0.0), last)


@inner_loop
def _sample(layer, left, top, column, row):
    """Value of the layer at one position: as ``reference._sampled``."""
    c, r = int(column), int(row)
    c0, r0 = c - left, r - top
    c1, r1 = min(c0 + 1, layer.shape[1] - 1), min(r0 + 1, layer.shape[0] - 1)
    one, two, three, four = layer[r0, c0], layer[r0, c1], layer[r1, c0], layer[r1, c1]
    least, most = min(min(one, two), min(three, four)), max(max(one, two), max(three, four))
    if most < np.inf and most - least <= SAME_SURFACE * abs(most):
        fc, fr = column - c, row - r
        return (1 - fr) * ((1 - fc) * one + fc * two) + fr * ((1 - fc) * three + fc * four)
    return np.float64(layer[int(row + 0.5) - top, int(column + 0.5) - left])


def pixels_read(plane: BasePlane) -> tuple[int, int, int, int]:
    """(left, top, right, bottom) of the picture's pixels at which ``ray_intervals`` reads a layer for this plane."""
    ends = plane.view.width - 1.0, plane.view.height - 1.0
    columns, rows = _along_and_across(plane)
    corners = columns[:, [0, -1]], rows[:, [0, -1]]
    depths = corners[0][2] + corners[1][2][:, None]
    if depths.min() * depths.max() > 0.0:  # all before the eye: a projective map has its extremes at the corners
        columns, rows = corners
    column, row = reference.picture_positions(*ends, columns, rows)
    return int(column.min()), int(row.min()), int(column.max()) + 2, int(row.max()) + 2


def box_intervals(plane: BasePlane, shape_xyz) -> tuple[np.ndarray, np.ndarray]:
    """Ray intervals inside the box of the voxel centers, by column and by row.

    The sideways position of a ray along the scanlines depends on its column only, and across them on its row only. So a
    ray is inside from the later of both begins to the earlier of both ends.

    Parameters
    ----------
    shape_xyz : (nx, ny, nz)

    Returns
    -------
    (2, W) ndarray of float32, (2, H) ndarray of float32
        Begin and end for the columns and for the rows of sheet pixels, voxels along the viewing direction.
    """
    found = []
    for position, slope, axis in zip(plane.points, plane.ray_slopes, AXES[plane.axis]):
        last = shape_xyz[axis] - 1.0
        straight = slope == 0.0
        some_straight = bool(straight.any())
        if some_straight:
            slope = np.where(straight, 1.0, slope)
        at_first = plane.sign * ((0.0 - position) / slope + plane.reference)
        at_last = plane.sign * ((last - position) / slope + plane.reference)
        ends = np.empty((2, len(position)))
        np.minimum(at_first, at_last, out=ends[0])
        np.maximum(at_first, at_last, out=ends[1])
        if some_straight:
            inside = (position >= 0.0) & (position <= last)
            ends[0] = np.where(straight, np.where(inside, -np.inf, np.inf), ends[0])
            ends[1] = np.where(straight, np.where(inside, np.inf, -np.inf), ends[1])
        found.append(np.minimum(np.maximum(ends, -MOST, out=ends), MOST, out=ends).astype(np.float32))
    return tuple(found)
