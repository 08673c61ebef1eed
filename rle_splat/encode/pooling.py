"""Average pooling: nodes that replace cubes of voxels, for pictures in which many voxels share a pixel.

Averages of extinction preserve the optical depth (algorithm.md 1.5, minification). One plane of nodes is made
at a time, so that no grid of the volume's size is allocated.
"""

from __future__ import annotations

import numpy as np

from ..classify.classification import ClassifiedVolume
from ..classify.placing import RecordPositions
from ..classify.visible import VisibleVoxels, row_offsets
from ..runtime.jit import compiled, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from .records import empty_records


def nodes_shape(shape_xyz, level: int) -> tuple[int, int, int]:
    """(nz, ny, nx): number of nodes of 2^level voxels a side that cover a volume."""
    nx, ny, nz = (-(-n >> level) for n in shape_xyz)
    return nz, ny, nx


def node_to_voxel(level: int) -> np.ndarray:
    """(4, 4) float64 matrix from node index (x, y, z, 1) to the voxel index of its center."""
    side = 2**level
    matrix = np.diag((side, side, side, 1.0))
    matrix[:3, 3] = 0.5 * (side - 1)
    return matrix


def pooled_steps(voxels: VisibleVoxels, write, level: int, finest: ClassifiedVolume, *, threads: int = 0):
    """Average visible voxels to nodes.

    Parameters
    ----------
    voxels : VisibleVoxels
    write : callable
        See ``encode.record_steps``; writes (extinction * RGB, extinction).
    level : int
    finest : ClassifiedVolume
        The classified voxels, for their lengths.
    threads : int
        0 for one per core.

    Yields
    ------
    float
        Fraction done.

    Returns
    -------
    tuple
        As of ``classified_nodes``.
    """
    nz, ny, nx = nodes_shape(voxels.shape_xyz, level)
    means = np.empty((1, ny, nx, 4), np.float32)
    records = empty_records(16, 0)
    lists = []
    for node_plane in range(nz):
        yield node_plane / nz
        planes = node_plane << level, min((node_plane + 1) << level, voxels.shape_xyz[2])
        positions = RecordPositions.in_order(voxels, *planes)
        first, last = positions.span
        means[:] = 0.0
        if last > first:
            if len(records) < last - first:
                records = empty_records(16, last - first)
            write(positions, records)
            made = records[: last - first]
            if compiled():
                arguments = read_only(voxels.row_start), read_only(voxels.column), read_only(made)
                with parallel_call(threads):
                    add_to_nodes(*arguments, planes[0], planes[1], voxels.shape_xyz[1], level, means[0])
            else:
                _add_to_nodes_numpy(voxels, first, made, level, means[0])
            means *= np.float32(0.125**level)
        lists.append(node_lists(means))
    return classified_nodes(lists, (nx, ny, nz), finest)


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


def _add_to_nodes_numpy(voxels: VisibleVoxels, first: int, records, level: int, totals):
    """Reference implementation of ``add_to_nodes``."""
    number = np.arange(first, first + len(records))
    row = np.searchsorted(voxels.row_start, number, side="right") - 1
    y = row % voxels.shape_xyz[1] >> level
    np.add.at(totals, (y, voxels.column[number].astype(np.int64) >> level), records)


def node_lists(means: np.ndarray):
    """List the nodes (nz, ny, nx, 4) with extinction: (m, 4) records, (m,) column, (nz * ny,) count of each row."""
    seen = means[..., 3] > 0.0
    column = np.nonzero(seen)[2].astype(np.uint16 if means.shape[2] <= 65536 else np.int32)
    return means[seen], column, seen.sum(axis=2).ravel()


def classified_nodes(lists, shape_xyz, finest: ClassifiedVolume) -> tuple[ClassifiedVolume, np.ndarray]:
    """Make a classified volume of nodes.

    Parameters
    ----------
    lists : sequence of tuple
        As of ``node_lists``, of planes in order.
    shape_xyz : (nx, ny, nz)
        Number of nodes.
    finest : ClassifiedVolume
        The classified voxels, for their lengths.

    Returns
    -------
    classified : ClassifiedVolume
    colors : (m, 3) ndarray of float32
        Unassociated colors.
    """
    visible, column, counts = (np.concatenate(parts) for parts in zip(*lists, strict=True))
    colors = np.ascontiguousarray(visible[:, :3] / visible[:, 3:])
    extinction = np.ascontiguousarray(visible[:, 3])
    opacity = -np.expm1(-extinction * np.float32(finest.opacity_distance))
    classified = ClassifiedVolume.from_lists(
        shape_xyz, row_offsets(counts), column, extinction, opacity, colors, 0, finest.unit_length,
        finest.opacity_distance,
    )
    return classified, colors
