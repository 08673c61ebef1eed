"""Normals from the gradient of the scalar, at chosen voxels only (algorithm.md 1.13).

Float data: central differences.  Integer data: Sobel's 3x3x3 estimator, whose (1, 2, 1) smoothing across the
derivative averages the rounding out.  At the volume's faces the difference is one-sided, and smoothing repeats
the face.  A neighbour that is not finite counts as equal to the voxel itself.

Noise floor, as change per voxel step in stored values: below it there is no normal, never a random one.
Integer data: a quarter of a step, twice the 0.13 steps (standard deviation) that rounding alone gives Sobel's
gradient.  Float data: eight rounding errors of the larger value, which is what a computed constant may carry.
"""

from __future__ import annotations

import numpy as np

from ..jit import compiled, kernel, parallel_call, read_only
from ..parallel import share_out

INTEGER_FLOOR = 0.25  # stored steps per voxel
FLOAT_FLOOR = 8.0  # rounding errors (machine epsilons) per voxel
SMOOTHING = 16.0  # sum of the smoothing weights; the span of a difference is 2, or 1 at a face
CHUNK = 1 << 18  # voxels that the numpy twin works on at once


def unit_normals(
    volume, row_start: np.ndarray, column: np.ndarray, index_to_world, *, backend: str = "auto", threads: int = 0
) -> np.ndarray:
    """(m, 3) float32 unit vectors in world space along the scalar's gradient; (0, 0, 0) where there is none.

    ``row_start`` (nz * ny + 1,) int64 and ``column`` (m,): which voxels, in rows along x (row = z * ny + y), as
    in a ClassifiedVolume.  ``index_to_world``: (4, 4) float64, any invertible affine: a gradient is a covector,
    so it goes to the world by the inverse transpose.
    """
    voxels = read_only(np.asarray(volume.voxels))
    row_start, column = read_only(row_start), read_only(column)
    linear = np.asarray(index_to_world, dtype=np.float64)[:3, :3]
    # Only the direction matters, so the matrix is brought to ordinary size: no overflow at extreme scales.
    covector = np.linalg.inv(linear / np.abs(linear).max()).T * np.sign(volume.slope)
    is_integer = voxels.dtype.kind in "iu"
    floor = INTEGER_FLOOR if is_integer else FLOAT_FLOOR * float(np.finfo(voxels.dtype).eps)
    normals = np.empty((3, len(column)), dtype=np.float32).T  # one component after the other, for SIMD
    if compiled(backend):
        with parallel_call(threads):
            if is_integer:
                sum_type = np.empty(0, np.int32 if voxels.dtype.itemsize <= 2 else np.int64)
                _sobel(voxels, row_start, column, covector, floor, sum_type, normals)
            else:
                _central(voxels, row_start, column, covector, floor, normals)
    else:
        _normals_numpy(voxels, row_start, column, covector, floor, is_integer, normals)
    return normals


@kernel(inline="always")
def _write_normal(gx, gy, gz, floor, covector, normals, i):
    """Unit world normal of the index-space gradient (stored values per voxel step) into ``normals[i]``."""
    wx = covector[0, 0] * gx + covector[0, 1] * gy + covector[0, 2] * gz
    wy = covector[1, 0] * gx + covector[1, 1] * gy + covector[1, 2] * gz
    wz = covector[2, 0] * gx + covector[2, 1] * gy + covector[2, 2] * gz
    length = np.sqrt(wx * wx + wy * wy + wz * wz)
    # No branch, so that the loop round it becomes SIMD.
    found = gx * gx + gy * gy + gz * gz > floor * floor and 0.0 < length < np.inf
    scale = 1.0 / length if found else 0.0
    normals[i, 0] = wx * scale if found else 0.0
    normals[i, 1] = wy * scale if found else 0.0
    normals[i, 2] = wz * scale if found else 0.0


@kernel
def _sobel(voxels, row_start, column, covector, floor, sum_type, normals):
    """Integer ``voxels`` (nz, ny, nx); ``covector`` (3, 3); ``sum_type``: an array of the type that holds 16 times
    any voxel exactly; writes ``normals`` (m, 3) float32, unit, world."""
    arguments = (voxels, row_start, column, covector, floor, sum_type, normals)
    share_out(_sobel_rows, voxels.shape[0] * voxels.shape[1], arguments)


@kernel(inner=True)
def _sobel_rows(begin_row, end_row, voxels, row_start, column, covector, floor, sum_type, normals):
    """Along a row the sums over the 3 x 3 voxels across it are formed once for the span of its visible voxels, in long
    SIMD loops; a voxel then takes three of them."""
    n_z, n_y, n_x = voxels.shape
    # Smoothed over y and z; difference along y, smoothed over z; difference along z, smoothed over y.
    smooth = np.empty(n_x, sum_type.dtype)
    along_y = np.empty(n_x, sum_type.dtype)
    along_z = np.empty(n_x, sum_type.dtype)
    one = smooth.dtype.type  # arithmetic stays in this type: with plain integers it would be twice as wide
    two, four = one(2), one(4)
    for row in range(begin_row, end_row):
        begin, end = row_start[row], row_start[row + 1]
        if begin == end:
            continue
        z, y = row // n_y, row % n_y
        z0, z1, y0, y1 = max(z - 1, 0), min(z + 1, n_z - 1), max(y - 1, 0), min(y + 1, n_y - 1)
        first = max(np.int64(column[begin]) - 1, 0)
        count = min(np.int64(column[end - 1]) + 1, n_x - 1) + 1 - first
        for i in range(count):
            x = first + i
            nw, nn, ne = one(voxels[z0, y0, x]), one(voxels[z0, y, x]), one(voxels[z0, y1, x])
            ww, here, ee = one(voxels[z, y0, x]), one(voxels[z, y, x]), one(voxels[z, y1, x])
            sw, ss, se = one(voxels[z1, y0, x]), one(voxels[z1, y, x]), one(voxels[z1, y1, x])
            smooth[i] = nw + ne + sw + se + two * (nn + ww + ee + ss) + four * here
            along_y[i] = ne + se - nw - sw + two * (ee - ww)
            along_z[i] = sw + se - nw - ne + two * (ss - nn)
        scale_y, scale_z = 1.0 / (SMOOTHING * max(y1 - y0, 1)), 1.0 / (SMOOTHING * max(z1 - z0, 1))
        for i in range(begin, end):
            x = np.int64(column[i])
            x0, x1 = max(x - 1, 0), min(x + 1, n_x - 1)
            b, h, a = x0 - first, x - first, x1 - first
            gx = np.float64(smooth[a] - smooth[b]) * (1.0 / (2 * SMOOTHING) if x1 - x0 == 2 else 1.0 / SMOOTHING)
            gy = np.float64(along_y[b] + two * along_y[h] + along_y[a]) * scale_y
            gz = np.float64(along_z[b] + two * along_z[h] + along_z[a]) * scale_z
            _write_normal(gx, gy, gz, floor, covector, normals, i)


@kernel(inline="always")
def _finite_or(value, otherwise):
    """``value`` as float64, or ``otherwise`` where it is NaN or infinite."""
    value = np.float64(value)
    return value if np.abs(value) < np.inf else otherwise


@kernel
def _central(voxels, row_start, column, covector, floor, normals):
    """Float ``voxels`` (nz, ny, nx); ``floor`` is relative to the largest value met; else as ``_sobel``."""
    arguments = (voxels, row_start, column, covector, floor, normals)
    share_out(_central_rows, voxels.shape[0] * voxels.shape[1], arguments)


@kernel(inner=True)
def _central_rows(begin, end, voxels, row_start, column, covector, floor, normals):
    n_z, n_y, n_x = voxels.shape
    for row in range(begin, end):
        if row_start[row] == row_start[row + 1]:
            continue
        z, y = row // n_y, row % n_y
        z0, z1, y0, y1 = max(z - 1, 0), min(z + 1, n_z - 1), max(y - 1, 0), min(y + 1, n_y - 1)
        for i in range(row_start[row], row_start[row + 1]):
            x = np.int64(column[i])
            x0, x1 = max(x - 1, 0), min(x + 1, n_x - 1)
            here = np.float64(voxels[z, y, x])
            ax, bx = _finite_or(voxels[z, y, x0], here), _finite_or(voxels[z, y, x1], here)
            ay, by = _finite_or(voxels[z, y0, x], here), _finite_or(voxels[z, y1, x], here)
            az, bz = _finite_or(voxels[z0, y, x], here), _finite_or(voxels[z1, y, x], here)
            largest = max(max(abs(ax), abs(bx)), max(abs(ay), abs(by)), max(abs(az), abs(bz)))
            gx, gy, gz = (bx - ax) / max(x1 - x0, 1), (by - ay) / max(y1 - y0, 1), (bz - az) / max(z1 - z0, 1)
            _write_normal(gx, gy, gz, floor * largest, covector, normals, i)


def _normals_numpy(voxels, row_start, column, covector, floor, is_integer, normals):
    """Twin of both kernels, in chunks of voxels."""
    n_y = voxels.shape[1]
    for first in range(0, len(column), CHUNK):
        part = slice(first, min(first + CHUNK, len(column)))
        row = np.searchsorted(row_start, np.arange(part.start, part.stop), side="right") - 1
        place = (row // n_y, row % n_y, column[part].astype(np.int64))
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            gradient, largest = (_sobel_numpy if is_integer else _central_numpy)(voxels, place)
            world = gradient @ covector.T
            length = np.sqrt((world**2).sum(axis=1))
            keep = ((gradient**2).sum(axis=1) > (floor * largest) ** 2) & (length > 0.0) & (length < np.inf)
            normals[part] = np.where(keep[:, None], world / length[:, None], 0.0)


def _neighbours(place, shape, axis):
    """Index arrays of the neighbours before and after along array ``axis``, and the (m,) distance between them."""
    before, after = list(place), list(place)
    before[axis] = np.maximum(place[axis] - 1, 0)
    after[axis] = np.minimum(place[axis] + 1, shape[axis] - 1)
    return tuple(before), tuple(after), np.maximum(after[axis] - before[axis], 1)


def _central_numpy(voxels, place):
    """(m, 3) x, y, z gradient per voxel step at ``place`` (z, y, x index arrays), and (m,) the largest value met."""
    here = voxels[place].astype(np.float64)
    gradient, largest = np.empty((len(here), 3)), np.zeros(len(here))
    for axis, component in ((2, 0), (1, 1), (0, 2)):
        before, after, span = _neighbours(place, voxels.shape, axis)
        a, b = (voxels[index].astype(np.float64) for index in (before, after))
        a, b = np.where(np.isfinite(a), a, here), np.where(np.isfinite(b), b, here)
        gradient[:, component] = (b - a) / span
        largest = np.maximum(largest, np.maximum(np.abs(a), np.abs(b)))
    return gradient, largest


def _sobel_numpy(voxels, place):
    """As ``_central_numpy``, by Sobel's estimator; the largest value is 1, since the floor is in stored steps."""
    gradient = np.zeros((len(place[0]), 3))
    steps = [_neighbours(place, voxels.shape, axis) for axis in range(3)]
    for c in (-1, 0, 1):
        for b in (-1, 0, 1):
            for a in (-1, 0, 1):
                at = tuple(steps[axis][0 if d < 0 else 1][axis] if d else place[axis]
                           for axis, d in enumerate((c, b, a)))
                value = voxels[at].astype(np.float64)
                wa, wb, wc = 2 - abs(a), 2 - abs(b), 2 - abs(c)
                gradient += value[:, None] * (a * wb * wc, b * wa * wc, c * wa * wb)
    for axis, component in ((2, 0), (1, 1), (0, 2)):
        gradient[:, component] /= SMOOTHING * steps[axis][2]
    return gradient, 1.0
