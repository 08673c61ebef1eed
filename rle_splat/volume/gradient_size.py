"""Magnitude of the gradient at selected voxels, in physical values per unit of the volume.

Central differences, one-sided at the faces of the volume. A neighbor that is not finite counts as equal to the voxel
itself. Unlike the normals of integer data, the differences are not smoothed, since smoothing would lower the magnitude.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import compiled, inner_loop, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from . import reference
from .stored_scalars import StoredValues, by_any_type


def gradient_sizes(volume, row_start: np.ndarray, column: np.ndarray, *, threads: int = 0) -> np.ndarray:
    """Gradient magnitude of selected voxels.

    Parameters
    ----------
    volume : Volume
    row_start : (nz * ny + 1,) ndarray of int64
        First entry of ``column`` of each row of voxels along x.
    column : (m,) ndarray of integers
        x of the selected voxels.
    threads : int
        0 for one per core.

    Returns
    -------
    (m,) ndarray of float32
        Physical values per unit of the volume's own space (mostly mm).
    """
    covector = np.linalg.inv(np.asarray(volume.affine, np.float64)[:3, :3]).T * volume.slope
    voxels, sizes = read_only(np.asarray(volume.voxels)), np.empty(len(column), np.float32)
    if compiled():
        with parallel_call(threads):
            lists, covector = (read_only(row_start), read_only(column)), tuple(covector.ravel().tolist())
            _measure(StoredValues.of(voxels), len(row_start) - 1, *lists, covector, sizes)
    else:
        reference.measure_gradients(voxels, row_start, column, covector, sizes)
    return sizes


@kernel
def _measure(voxels, rows, row_start, column, covector, sizes):
    """Fill ``sizes`` (m,) float32; ``voxels``: StoredValues, of so many rows; ``covector``: nine floats, inverse
    transpose of the affine times the slope."""
    share_out(_measure_rows, rows, (voxels, row_start, column, covector, sizes))


@kernel(inline="always")
def _step(before, after, here, count):
    """Change per voxel between two neighbors ``count`` voxels apart; one that is not finite counts as ``here``."""
    a = before if np.abs(before) < np.inf else here
    b = after if np.abs(after) < np.inf else here
    return (b - a) / max(count, 1)


@inner_loop
def _measure_row(voxels, row, first, end, column, covector, sizes):
    """Fill ``sizes`` [first, end), of the voxels at ``column`` of a row."""
    n_z, n_y, n_x = voxels.shape
    z, y = row // n_y, row % n_y
    z0, z1, y0, y1 = max(z - 1, 0), min(z + 1, n_z - 1), max(y - 1, 0), min(y + 1, n_y - 1)
    for i in range(first, end):
        x = np.int64(column[i])
        x0, x1 = max(x - 1, 0), min(x + 1, n_x - 1)
        here = np.float64(voxels[z, y, x])
        gx = _step(np.float64(voxels[z, y, x0]), np.float64(voxels[z, y, x1]), here, x1 - x0)
        gy = _step(np.float64(voxels[z, y0, x]), np.float64(voxels[z, y1, x]), here, y1 - y0)
        gz = _step(np.float64(voxels[z0, y, x]), np.float64(voxels[z1, y, x]), here, z1 - z0)
        wx = covector[0] * gx + covector[1] * gy + covector[2] * gz
        wy = covector[3] * gx + covector[4] * gy + covector[5] * gz
        wz = covector[6] * gx + covector[7] * gy + covector[8] * gz
        size = np.sqrt(wx * wx + wy * wy + wz * wz)
        sizes[i] = size if size < np.inf else 0.0


_measure_stored = by_any_type(_measure_row)


@kernel(inner=True)
def _measure_rows(begin_row, end_row, voxels, row_start, column, covector, sizes):
    """Fill ``sizes`` for rows [begin_row, end_row)."""
    for row in range(begin_row, end_row):
        _measure_stored(voxels, row, row_start[row], row_start[row + 1], column, covector, sizes)
