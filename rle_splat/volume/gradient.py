"""Unit normals from the gradient of the scalar, at selected voxels only (algorithm.md 1.13).

Float data: central differences. Integer data: Sobel's 3x3x3 operator, whose (1, 2, 1) smoothing across the derivative
averages out rounding errors. At the faces of the volume the difference is one-sided, and the smoothing repeats the
face. A neighbor that is not finite counts as equal to the voxel itself.

Below a noise floor (change per voxel step, in stored values) a voxel has no normal, so that noise does not give random
normals. Integer data: a quarter of a stored step, twice the standard deviation (0.13 steps) that rounding alone gives
Sobel's gradient. Float data: eight machine epsilons of the largest neighboring value, the rounding error that a
computed constant may carry.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ..runtime.buffer_pool import empty
from ..runtime.jit import compiled, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from ..runtime.steps import drain
from . import reference
from .reference import SMOOTHING

INTEGER_FLOOR = 0.25  # stored steps per voxel
FLOAT_FLOOR = 8.0  # machine epsilons per voxel
NORMALS_AT_ONCE = 1 << 19  # selected voxels between two chances to cancel, 10 to 20 ms


def unit_normals(volume, row_start: np.ndarray, column: np.ndarray, index_to_world, *, threads: int = 0) -> np.ndarray:
    """``normal_steps`` at once."""
    return drain(normal_steps(volume, row_start, column, index_to_world, threads=threads))


def normal_steps(volume, row_start: np.ndarray, column: np.ndarray, index_to_world, *, threads: int = 0):
    """Generator of fractions done: unit normals of selected voxels, in world space.

    A gradient is a covector: it is transformed by the inverse transpose of the matrix.

    Parameters
    ----------
    volume : Volume
    row_start : (nz * ny + 1,) ndarray of int64
        First entry of ``column`` of each row of voxels along x; row = z * ny + y, as in ClassifiedVolume.
    column : (m,) ndarray of integers
        x of the selected voxels.
    index_to_world : (4, 4) array_like
        Voxel index (x, y, z) to world; any invertible affine.
    threads : int
        0 for one per core.

    Returns
    -------
    (m, 3) ndarray of float32
        Unit vectors along the gradient of the scalar; (0, 0, 0) where the gradient is below the noise floor.
    """
    voxels = read_only(np.asarray(volume.voxels))
    linear = np.asarray(index_to_world, dtype=np.float64)[:3, :3]
    # Only the direction matters. Scaling the matrix first avoids overflow at extreme scales.
    covector = np.linalg.inv(linear / np.abs(linear).max()).T * np.sign(volume.slope)
    is_integer = voxels.dtype.kind in "iu"
    floor = INTEGER_FLOOR if is_integer else FLOAT_FLOOR * float(np.finfo(voxels.dtype).eps)
    normals = empty((3, len(column)), np.float32)  # one component after another, for SIMD
    if not compiled():
        lists = read_only(row_start), read_only(column)
        reference.find_normals(voxels, lists, covector, floor, is_integer, normals)
        return normals.T
    covector, (n_z, n_y, _) = tuple(covector.ravel().tolist()), voxels.shape
    sum_type = np.empty(0, np.int32 if voxels.dtype.itemsize <= 2 else np.int64)
    starts = row_start[::n_y]
    ends = np.searchsorted(starts, np.arange(0, len(column), NORMALS_AT_ONCE)).tolist()
    for first, last in pairwise(sorted({*ends, n_z})):
        yield first / n_z
        low, high = max(first - 1, 0), min(last + 1, n_z)  # the rows of the planes around are empty
        rows = np.clip(row_start[low * n_y : high * n_y + 1], starts[first], starts[last])
        given = voxels[low:high], (read_only(rows), read_only(column)), covector, floor
        with parallel_call(threads):
            if is_integer:
                _sobel(*given, sum_type, normals)
            else:
                _central(*given, normals)
    return normals.T


# --- kernels --------------------------------------------------------------------------------------------------
#
# Arguments of all kernels: ``voxels`` (nz, ny, nx); ``lists``: row_start and column of the selected voxels;
# ``covector``: nine floats, the matrix row by row (a tuple, because an array would be reloaded for every voxel);
# ``normals`` (3, m) float32: output, unit vectors in world space.


@kernel(inline="always")
def _unit(gx, gy, gz, floor, covector):
    """Unit world normal of an index-space gradient (stored values per voxel step), or (0, 0, 0)."""
    wx = covector[0] * gx + covector[1] * gy + covector[2] * gz
    wy = covector[3] * gx + covector[4] * gy + covector[5] * gz
    wz = covector[6] * gx + covector[7] * gy + covector[8] * gz
    length = np.sqrt(wx * wx + wy * wy + wz * wz)
    # Selections instead of branches, so that the calling loop becomes SIMD.
    found = gx * gx + gy * gy + gz * gz > floor * floor and 0.0 < length < np.inf
    scale = 1.0 / length if found else 0.0
    return wx * scale if found else 0.0, wy * scale if found else 0.0, wz * scale if found else 0.0


@kernel
def _sobel(voxels, lists, covector, floor, sum_type, normals):
    """Normals of integer ``voxels``. ``sum_type``: an empty array whose dtype holds 16 times any voxel exactly."""
    arguments = (voxels, lists, covector, floor, sum_type, normals)
    share_out(_sobel_rows, voxels.shape[0] * voxels.shape[1], arguments)


@kernel(inner=True)
def _sobel_rows(begin_row, end_row, voxels, lists, covector, floor, sum_type, normals):
    """Normals of rows [begin_row, end_row) of integer voxels."""
    row_start, column = lists
    n_x = voxels.shape[2]
    # Separate arrays, so that the compiler knows that they do not overlap.
    sums = np.empty(n_x + 2, sum_type.dtype), np.empty(n_x + 2, sum_type.dtype), np.empty(n_x + 2, sum_type.dtype)
    unit = np.empty(n_x, np.float32), np.empty(n_x, np.float32), np.empty(n_x, np.float32)
    for row in range(begin_row, end_row):
        own = slice(row_start[row], row_start[row + 1])
        if own.start < own.stop:
            _sobel_row(voxels, row, column[own], covector, floor, sums, unit, normals[:, own])


@kernel(inline="always")
def _across(one, nw, nn, ne, ww, here, ee, sw, ss, se):
    """Sobel sums of the 3 x 3 voxels across a row (y fastest, then z).

    Returns the voxels smoothed over y and z; their difference along y smoothed over z; their difference along z
    smoothed over y. Arithmetic stays in type ``one``, because plain integers would be twice as wide.
    """
    nw, nn, ne, ww, here, ee = one(nw), one(nn), one(ne), one(ww), one(here), one(ee)
    sw, ss, se = one(sw), one(ss), one(se)
    two, four = one(2), one(4)
    smooth = nw + ne + sw + se + two * (nn + ww + ee + ss) + four * here
    return one(smooth), one(ne + se - nw - sw + two * (ee - ww)), one(sw + se - nw - ne + two * (ss - nn))


@kernel(inner=True)
def _sobel_row(voxels, row, column, covector, floor, sums, unit, normals):
    """Normals of the voxels of a row at ``column``.

    Long SIMD loops compute the sums over the 3 x 3 voxels across the row, then the normals of all from the first to the
    last; the selected ones are copied. Scratch: ``sums``, three (nx + 2,) integer arrays, and ``unit``, three (nx,)
    float32 arrays.
    """
    n_z, n_y, n_x = voxels.shape
    z, y = row // n_y, row % n_y
    z0, z1, y0, y1 = max(z - 1, 0), min(z + 1, n_z - 1), max(y - 1, 0), min(y + 1, n_y - 1)
    begin, count = np.int64(column[0]), np.int64(column[-1]) + 1 - np.int64(column[0])
    one = sums[0].dtype.type  # arithmetic stays in this type, because plain integers would be twice as wide
    two = one(2)
    scale_x = 1.0 / (2 * SMOOTHING)
    scale_y, scale_z = 1.0 / (SMOOTHING * max(y1 - y0, 1)), 1.0 / (SMOOTHING * max(z1 - z0, 1))
    first, last = max(begin - 1, 0), min(begin + count + 1, n_x)
    # Slices start at zero, so the compiler knows that no index is negative, and vectorizes the loops.
    nw, nn, ne = voxels[z0, y0, first:last], voxels[z0, y, first:last], voxels[z0, y1, first:last]
    ww, here, ee = voxels[z, y0, first:last], voxels[z, y, first:last], voxels[z, y1, first:last]
    sw, ss, se = voxels[z1, y0, first:last], voxels[z1, y, first:last], voxels[z1, y1, first:last]
    smooth, along_y, along_z = sums
    at = first - (begin - 1)  # entry 0 of the sums belongs to the voxel before ``begin``
    s, a, b = smooth[at:], along_y[at:], along_z[at:]
    for i in range(here.size):
        s[i], a[i], b[i] = _across(one, nw[i], nn[i], ne[i], ww[i], here[i], ee[i], sw[i], ss[i], se[i])
    # Outside the volume: repeat the face for the smoothing, and extrapolate linearly for the difference, which then is
    # exactly twice the one-sided difference.
    if begin == 0:
        along_y[0], along_z[0] = along_y[1], along_z[1]
        smooth[0] = two * smooth[1] - smooth[2 if n_x > 1 else 1]
    if begin + count == n_x:
        along_y[count + 1], along_z[count + 1] = along_y[count], along_z[count]
        smooth[count + 1] = two * smooth[count] - smooth[count - 1 if n_x > 1 else count]
    s0, s2 = smooth[:count], smooth[2:]
    a0, a1, a2 = along_y[:count], along_y[1:], along_y[2:]
    b0, b1, b2 = along_z[:count], along_z[1:], along_z[2:]
    unit_x, unit_y, unit_z = unit
    for i in range(s0.size):
        gx = np.float64(one(s2[i] - s0[i])) * scale_x
        gy = np.float64(one(a0[i] + two * a1[i] + a2[i])) * scale_y
        gz = np.float64(one(b0[i] + two * b1[i] + b2[i])) * scale_z
        unit_x[i], unit_y[i], unit_z[i] = _unit(gx, gy, gz, floor, covector)
    for i in range(column.size):
        x = np.int64(column[i]) - begin
        normals[0, i], normals[1, i], normals[2, i] = unit_x[x], unit_y[x], unit_z[x]


@kernel(inline="always")
def _finite_or(value, otherwise):
    """``value`` as float64, or ``otherwise`` where it is NaN or infinite."""
    value = np.float64(value)
    return value if np.abs(value) < np.inf else otherwise


@kernel
def _central(voxels, lists, covector, floor, normals):
    """Normals of float ``voxels``; ``floor`` is relative to the largest value among a voxel's neighbors."""
    share_out(_central_rows, voxels.shape[0] * voxels.shape[1], (voxels, lists, covector, floor, normals))


@kernel(inner=True)
def _central_rows(begin_row, end_row, voxels, lists, covector, floor, normals):
    """Normals of rows [begin_row, end_row) of float voxels."""
    row_start, column = lists
    for row in range(begin_row, end_row):
        own = slice(row_start[row], row_start[row + 1])
        _central_row(voxels, row, column[own], covector, floor, normals[:, own])


@kernel(inner=True)
def _central_row(voxels, row, column, covector, floor, normals):
    """Normals of the voxels of a row at ``column``."""
    n_z, n_y, n_x = voxels.shape
    z, y = row // n_y, row % n_y
    z0, z1, y0, y1 = max(z - 1, 0), min(z + 1, n_z - 1), max(y - 1, 0), min(y + 1, n_y - 1)
    for i in range(column.size):
        x = np.int64(column[i])
        x0, x1 = max(x - 1, 0), min(x + 1, n_x - 1)
        here = np.float64(voxels[z, y, x])
        ax, bx = _finite_or(voxels[z, y, x0], here), _finite_or(voxels[z, y, x1], here)
        ay, by = _finite_or(voxels[z, y0, x], here), _finite_or(voxels[z, y1, x], here)
        az, bz = _finite_or(voxels[z0, y, x], here), _finite_or(voxels[z1, y, x], here)
        largest = max(max(abs(ax), abs(bx)), max(abs(ay), abs(by)), max(abs(az), abs(bz)))
        gx, gy, gz = (bx - ax) / max(x1 - x0, 1), (by - ay) / max(y1 - y0, 1), (bz - az) / max(z1 - z0, 1)
        normals[0, i], normals[1, i], normals[2, i] = _unit(gx, gy, gz, floor * largest, covector)
