"""The kernels of this folder once more in numpy, to be read, to run where numba is missing, and to test against.

Where rays begin and end, and what clip objects leave of them (algorithm.md 1.12).
"""

import numpy as np

# Depths of neighboring pixels lie on one surface if they differ by less than this fraction of their mean.
SAME_SURFACE = np.float32(0.02)
MOST = float(np.finfo(np.float32).max)


def find_intervals(columns, rows, nearest, furthest, layer, left, top, last_column, last_row, intervals):
    """Begin and end of the ray of each sheet pixel; arguments as of ``ray_intervals._interval_rows``."""
    at_zero, per_voxel = (columns[n] + rows[n][:, None] for n in (3, 4))
    end = np.full(at_zero.shape, furthest)
    if layer.size > 0:
        end = np.minimum(end, _sample(layer, (left, top), *picture_positions(last_column, last_row, columns, rows)))
    with np.errstate(divide="ignore", invalid="ignore"):
        intervals[:] = np.clip(((nearest - at_zero) / per_voxel, (end - at_zero) / per_voxel), -MOST, MOST)
    sideways = ~(per_voxel > 0.0)  # never visible: the ray runs across or against the camera's axis
    intervals[0][sideways], intervals[1][sideways] = -MOST, MOST


def picture_positions(last_column, last_row, columns, rows) -> tuple[np.ndarray, np.ndarray]:
    """Column and row (H, W) of each sheet pixel in the picture, from the center of its first pixel, clamped.

    ``columns``, ``rows``: of ``ray_intervals._along_and_across``. ``last_column``, ``last_row``: of the picture.
    """
    a, b, c = (columns[n] + rows[n][:, None] for n in range(3))
    with np.errstate(divide="ignore", invalid="ignore"):
        column = np.clip(np.nan_to_num(a / c) - 0.5, 0.0, last_column)
        row = np.clip(np.nan_to_num(b / c) - 0.5, 0.0, last_row)
    return column, row


def _sample(layer: np.ndarray, first_pixel, column, row) -> np.ndarray:
    """The layer at positions in the picture: bilinear within one surface, the nearest pixel elsewhere."""
    height, width = layer.shape
    left, top = first_pixel
    whole_column, whole_row = column.astype(np.intp), row.astype(np.intp)
    c0, r0 = whole_column - left, whole_row - top
    c1, r1 = np.minimum(c0 + 1, width - 1), np.minimum(r0 + 1, height - 1)
    corners = layer[r0, c0], layer[r0, c1], layer[r1, c0], layer[r1, c1]
    least = np.minimum(np.minimum(corners[0], corners[1]), np.minimum(corners[2], corners[3]))
    most = np.maximum(np.maximum(corners[0], corners[1]), np.maximum(corners[2], corners[3]))
    with np.errstate(invalid="ignore"):
        smooth = np.isfinite(most) & (most - least <= SAME_SURFACE * np.abs(most))
        fc, fr = column - whole_column, row - whole_row
        linear = (1 - fr) * ((1 - fc) * corners[0] + fc * corners[1]) + fr * ((1 - fc) * corners[2] + fc * corners[3])
    nearest = layer[(row + 0.5).astype(np.intp) - top, (column + 0.5).astype(np.intp) - left]
    return np.where(smooth, linear, nearest)


def clip(crossings, bodies, intervals) -> np.ndarray:
    """Ray intervals and holes that cuts leave, as ``clip_intervals._clip_rows``; without holes that no ray has."""
    begin, end = (bound.astype(np.float64) for bound in intervals)
    ways = [_stretch_within(*(part[first:last] for part in crossings)) for first, last in zip((0, *bodies), bodies)]
    begin, end = np.maximum(begin, ways[0][0]), np.minimum(end, ways[0][1])
    holes = np.empty((0, 2, *begin.shape))
    if len(bodies) > 1:
        begin, end, holes = _without_holes(begin, end, *(np.stack(ends) for ends in zip(*ways[1:])))
    nothing = ~(begin < end)
    begin[nothing], end[nothing] = -MOST, -MOST
    found = np.concatenate((np.stack((begin, end)), holes.reshape(-1, *begin.shape)))
    return np.clip(found, -MOST, MOST).astype(np.float32)


def _stretch_within(column_rate, column_zero, row_rate, row_zero) -> tuple[np.ndarray, np.ndarray]:
    """(H, W), (H, W) float64: where each ray enters and leaves an intersection of half-spaces.

    A ray that misses it has begin > end.
    """
    shape = row_rate.shape[1], column_rate.shape[1]
    begin, end = np.full(shape, -np.inf), np.full(shape, np.inf)
    for side in range(len(column_rate)):
        per_voxel = column_rate[side] + row_rate[side, :, None]
        at_zero = column_zero[side] + row_zero[side, :, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = -at_zero / per_voxel
        np.minimum(end, crossing, out=end, where=per_voxel > 0.0)
        np.maximum(begin, crossing, out=begin, where=per_voxel < 0.0)
        end[(per_voxel == 0.0) & (at_zero > 0.0)] = -np.inf
    return begin, end


def _without_holes(begin, end, into, out):
    """Reference implementation of ``_take_holes``.

    ``begin``, ``end`` (H, W): of the rays; ``into``, ``out`` (n, H, W): of the holes. Returns the shortened rays, and
    (holes, 2, H, W) the holes that remain inside any ray, separated.
    """
    into, out = np.where(into < out, into, np.inf), np.where(into < out, out, np.inf)  # empty holes sort last
    order = np.argsort(into, axis=0, kind="stable")
    into, out = np.take_along_axis(into, order, 0), np.take_along_axis(out, order, 0)
    reached = begin
    for hole in range(len(into)):
        at_front = into[hole] <= begin
        begin = np.where(at_front, np.maximum(begin, out[hole]), begin)
        reached = np.maximum(reached, begin)
        into[hole] = np.maximum(into[hole], reached)
        out[hole] = reached = np.maximum(out[hole], into[hole])
    for hole in reversed(range(len(into))):
        at_back = (out[hole] >= end) & (into[hole] < out[hole])
        end = np.where(at_back, np.minimum(end, into[hole]), end)
        into[hole][at_back] = out[hole][at_back] = np.inf
    some = (into < out).any(axis=(1, 2))
    return begin, end, np.stack((into, out), axis=1)[some]
