"""Average pooling: a coarse grid of nodes, each the mean of a cube of voxels.

Averages of extinction preserve the optical depth.
"""

from __future__ import annotations

import numpy as np

from ..classify.placing import RecordPositions
from ..classify.visible import VisibleVoxels
from ..runtime.jit import compiled, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from . import reference
from .records import empty_records


def pool_steps(voxels: VisibleVoxels, write, level: int, *, threads: int = 0):
    """Average visible voxels to nodes.

    Parameters
    ----------
    voxels : VisibleVoxels
    write : callable
        See ``encode.record_steps``; writes (extinction * RGB, extinction).
    level : int
    threads : int
        0 for one per core.

    Yields
    ------
    float
        Fraction done.

    Returns
    -------
    (nz, ny, nx, 4) ndarray of float32
        Means of (extinction * RGB, extinction); voxels that are not visible, and those beyond the volume, count as 0.
    """
    shape = (-(-n >> level) for n in voxels.shape_xyz[::-1])
    means = np.zeros((*shape, 4), np.float32)
    records = empty_records(16, 0)
    for node_plane, totals in enumerate(means):
        yield node_plane / len(means)
        planes = node_plane << level, min((node_plane + 1) << level, voxels.shape_xyz[2])
        positions = RecordPositions.in_order(voxels, *planes)
        first, last = positions.span
        if last > first:
            if len(records) < last - first:
                records = empty_records(16, last - first)
            write(positions, records)
            made = records[: last - first]
            if compiled():
                arguments = read_only(voxels.row_start), read_only(voxels.column), read_only(made)
                with parallel_call(threads):
                    add_to_nodes(*arguments, planes[0], planes[1], voxels.shape_xyz[1], level, totals)
            else:
                reference.add_to_nodes(voxels, first, made, level, totals)
            totals *= np.float32(0.125**level)
    return means


@kernel
def add_to_nodes(row_start, column, records, first_plane, last_plane, n_y, level, totals):
    """Add ``records`` (n, 4) float32 of the voxels of some planes to one plane of nodes.

    ``row_start``, ``column``: see VisibleVoxels. ``n_y``: rows of a plane. Updates ``totals`` (ny, nx, 4) float32.
    """
    share_out(
        _add_to_nodes, totals.shape[0], (row_start, column, records, first_plane, last_plane, n_y, level, totals)
    )


@kernel(inner=True)
def _add_to_nodes(begin, end, row_start, column, records, first_plane, last_plane, n_y, level, totals):
    """``add_to_nodes`` for rows of nodes [begin, end)."""
    first = row_start[first_plane * n_y]
    for node_row in range(begin, end):
        for z in range(first_plane, last_plane):
            for y in range(node_row << level, min((node_row + 1) << level, n_y)):
                for v in range(row_start[z * n_y + y], row_start[z * n_y + y + 1]):
                    x = np.int64(column[v]) >> level
                    for c in range(4):
                        totals[node_row, x, c] += records[v - first, c]
