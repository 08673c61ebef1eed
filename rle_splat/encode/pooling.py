"""Average pooling: a coarse grid of nodes, each the mean of a cube of voxels.

Averages of extinction preserve the optical depth.
"""

from __future__ import annotations

import numpy as np

from ..classify.visible import VisibleVoxels
from ..runtime.jit import kernel, read_only, run_either
from ..runtime.parallel import share_out
from . import reference

VOXELS_AT_ONCE = 1 << 20  # kept voxels that are averaged between two chances to cancel, 10 ms


def pool_steps(voxels: VisibleVoxels, extinction, side: int, *, threads: int = 0):
    """Generator of fractions done: average the extinction of kept voxels to nodes.

    Parameters
    ----------
    extinction : (m,) ndarray of float32
    side : int
        Voxels along a side of a cube.
    threads : int
        0 for one per core.

    Returns
    -------
    (nz, ny, nx) ndarray of float32
        Means; voxels that are not kept, and those beyond the volume, count as 0.
    """
    means = np.zeros([-(-n // side) for n in voxels.shape_xyz[::-1]], np.float32)
    arguments = read_only(voxels.row_start), read_only(voxels.column), read_only(extinction), voxels.shape_xyz, side
    at_once = max(VOXELS_AT_ONCE * len(means) // max(len(voxels), 1), 1)
    for first in range(0, len(means), at_once):
        yield first / len(means)
        part = means[first : first + at_once]
        run_either(threads, _pool, reference.pool, first, *arguments, part)
    return means


@kernel
def _pool(first, row_start, column, extinction, shape_xyz, side, means):
    """Add extinction to planes of nodes from number ``first`` on; ``means`` (planes, ny, nx) float32."""
    share_out(
        _pool_rows, means.shape[0] * means.shape[1], (first, row_start, column, extinction, shape_xyz, side, means)
    )


@kernel(inner=True)
def _pool_rows(begin, end, first, row_start, column, extinction, shape_xyz, side, means):
    """``_pool`` for rows of nodes [begin, end)."""
    _, n_y, n_z = shape_xyz
    rows, share = means.shape[1], np.float32(1.0 / side**3)
    for number in range(begin, end):
        plane, row = number // rows, number % rows
        to = means[plane, row]
        for z in range((first + plane) * side, min((first + plane + 1) * side, n_z)):
            for y in range(row * side, min((row + 1) * side, n_y)):
                for v in range(row_start[z * n_y + y], row_start[z * n_y + y + 1]):
                    to[np.int64(column[v]) // side] += share * extinction[v]
