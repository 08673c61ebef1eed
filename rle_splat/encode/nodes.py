"""Nodes of a pyramid, averaged directly from the visible voxels, with bounds of their error.

Laur and Hanrahan store with every node of a pyramid its error against the voxels that it replaces. Here a node stores
the extremes of its voxels. They give, for every point of the volume, a bound of the difference between the medium of
the voxels and that of the nodes, both interpolated trilinearly. Only visible voxels are read: the cost is proportional
to the visible voxels, and the memory to the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..classify.placing import RecordPositions
from ..runtime.jit import compiled, kernel, read_only
from ..volume.pyramid import pooled
from .pooling import nodes_shape

# Channels of a node's means (a voxel record: extinction * RGB, extinction) and of its extremes, which have three more:
# extinction * (brightest - RGB), the difference to the brightest color.
MEANS, EXTREMES = 4, 7
VOXELS_AT_ONCE = 1 << 20  # voxels whose records are made at once (16 MiB), or those of one plane if more
NODE_BYTES = 4 * (MEANS + 2 * EXTREMES) + 12  # bytes per node during construction: means, extremes, count, two errors


@dataclass(frozen=True, eq=False)
class Nodes:
    """A grid of nodes. Each averages a cube of 2^level voxels a side; voxels beyond the volume count as transparent.

    Attributes
    ----------
    level : int
    means : (nz, ny, nx, 4) ndarray of float32
        Mean (extinction * RGB, extinction) in 1 / world length.
    least, most : (nz, ny, nx, 7) ndarray of float32
        Extremes of the voxels' (extinction * RGB, extinction, extinction * (brightest - RGB)).
    brightest : float
        Upper bound of any channel of any voxel's color.
    """

    level: int
    means: np.ndarray
    least: np.ndarray
    most: np.ndarray
    brightest: float

    def coarser(self) -> Nodes:
        """The next level, with half as many nodes a side."""
        return Nodes(
            self.level + 1, 0.125 * pooled(self.means, np.add), pooled(self.least, np.minimum),
            pooled(self.most, np.maximum), self.brightest,
        )


def node_steps(voxels, write, level: int, brightest: float):
    """Average visible voxels to nodes.

    Parameters
    ----------
    voxels : VisibleVoxels
    write : callable
        See ``encode.record_steps``.
    level : int
    brightest : float
        Upper bound of any channel of any voxel's color.

    Yields
    ------
    float
        Fraction done.

    Returns
    -------
    Nodes
    """
    _, ny, nz = voxels.shape_xyz
    shape = nodes_shape(voxels.shape_xyz, level)
    totals = np.zeros((*shape, MEANS), np.float32)
    least = np.full((*shape, EXTREMES), np.inf, np.float32)
    most = np.zeros((*shape, EXTREMES), np.float32)
    counts = np.zeros(shape, np.int32)
    plane_start = voxels.row_start[::ny]
    largest = int(np.diff(plane_start).max())
    planes_at_once = max(VOXELS_AT_ONCE // max(largest, 1), 1)
    records = np.empty((min(planes_at_once * largest, len(voxels)), 4), np.float32)
    pool = pool_records if compiled() else pool_records_numpy
    for plane in range(0, nz, planes_at_once):
        yield plane / nz
        positions = RecordPositions.in_order(voxels, plane, min(plane + planes_at_once, nz))
        first, last = positions.span
        if last > first:
            write(positions, records)
            pool(
                read_only(voxels.row_start), read_only(voxels.column), first, records[: last - first], ny, level,
                np.float32(brightest), counts, totals, least, most,
            )
    least[counts < 8**level] = 0.0  # the node has a transparent voxel
    return Nodes(level, totals * np.float32(0.125**level), least, most, brightest)


@kernel
def pool_records(row_start, column, first, records, n_y, level, brightest, counts, totals, least, most):
    """Add ``records`` (n, 4) of the voxels from number ``first`` on to their nodes.

    ``row_start``, ``column``: see VisibleVoxels. Updates ``counts`` (nz, ny, nx) int32, ``totals`` (nz, ny, nx, 4), and
    ``least`` and ``most`` (nz, ny, nx, 7) float32.
    """
    row = np.searchsorted(row_start, first, side="right") - 1
    last = first + len(records)
    voxel = first
    while voxel < last:
        stop = min(row_start[row + 1], last)
        z, y = (row // n_y) >> level, (row % n_y) >> level
        for v in range(voxel, stop):
            x = np.int64(column[v]) >> level
            counts[z, y, x] += 1
            density = records[v - first, 3]
            for c in range(EXTREMES):
                value = records[v - first, c] if c < MEANS else brightest * density - records[v - first, c - MEANS]
                if c < MEANS:
                    totals[z, y, x, c] += value
                least[z, y, x, c] = min(least[z, y, x, c], value)
                most[z, y, x, c] = max(most[z, y, x, c], value)
        voxel = max(voxel, stop)
        row += 1


def pool_records_numpy(row_start, column, first, records, n_y, level, brightest, counts, totals, least, most):
    """Reference implementation of ``pool_records``."""
    voxels = np.arange(first, first + len(records))
    row = np.searchsorted(row_start, voxels, side="right") - 1
    node = (row // n_y >> level, row % n_y >> level, column[voxels].astype(np.int64) >> level)
    extremes = _with_complement(records, brightest)
    np.add.at(counts, node, 1)
    np.add.at(totals, node, records)
    np.minimum.at(least, node, extremes)
    np.maximum.at(most, node, extremes)


def _with_complement(records, brightest) -> np.ndarray:
    """(..., 7) from records (..., 4): appends the difference to the brightest color."""
    return np.concatenate((records, brightest * records[..., 3:] - records[..., :3]), axis=-1)


def node_errors(nodes: Nodes) -> np.ndarray:
    """Bounds of the error of nodes.

    Parameters
    ----------
    nodes : Nodes

    Returns
    -------
    (nz + 2, ny + 2, nx + 2) ndarray of float32
        Largest difference between the medium of the voxels and that of the nodes around each node, 1 / world length;
        with one layer of nodes beyond the volume, where the medium ramps to zero.

    Notes
    -----
    Between eight node centers, the medium of the voxels is an average of voxels of these nodes, and the medium of the
    nodes is an average of their means. The distance of either beyond the other's extremes bounds the difference. A node
    takes the largest bound of the adjacent cells, so that interpolated errors are bounds everywhere.
    """
    nz, ny, nx = nodes.means.shape[:3]
    cells = np.empty((nz + 1, ny + 1, nx + 1), np.float32)
    run = cell_errors if compiled() else cell_errors_numpy
    run(nodes.means, nodes.least, nodes.most, np.float32(nodes.brightest), cells)
    return _of_neighbors(np.pad(cells, 1), np.maximum)


@kernel(inline="always")
def _largest(most, k, j, first, last):
    """The largest density of nodes [first, last) of a row."""
    found = np.float32(0.0)
    for i in range(first, last):
        found = max(found, most[k, j, i, 3])
    return found


@kernel(inline="always")
def _cell_error(means, least, most, brightest, z, y, x):
    """The error of one cell; see ``cell_errors``."""
    nz, ny, nx = means.shape[0], means.shape[1], means.shape[2]
    worst = np.float32(0.0)
    for c in range(EXTREMES):
        low = mean_low = np.float32(np.inf)
        high = mean_high = np.float32(0.0)
        for corner in range(8):
            k, j, i = z - (corner >> 2), y - ((corner >> 1) & 1), x - (corner & 1)
            smallest = largest = mean = np.float32(0.0)
            if 0 <= k < nz and 0 <= j < ny and 0 <= i < nx:
                smallest, largest = least[k, j, i, c], most[k, j, i, c]
                if c < MEANS:
                    mean = means[k, j, i, c]
                else:
                    mean = brightest * means[k, j, i, 3] - means[k, j, i, c - MEANS]
            low, high = min(low, smallest), max(high, largest)
            mean_low, mean_high = min(mean_low, mean), max(mean_high, mean)
        worst = max(worst, max(high - mean_low, mean_high - low))
    return worst


@kernel
def cell_errors(means, least, most, brightest, cells):
    """Largest difference of a voxel's record from a mean, over the channels, for each cell between eight nodes.

    ``means`` (nz, ny, nx, 4), ``least`` and ``most`` (nz, ny, nx, 7): see Nodes. Writes ``cells`` (nz + 1, ny + 1,
    nx + 1) float32. Cell (0, 0, 0) lies before node (0, 0, 0); beyond the grid everything is zero.
    """
    nz, ny, nx = means.shape[0], means.shape[1], means.shape[2]
    for z in range(nz + 1):
        for y in range(ny + 1):
            for x in range(nx + 1):
                visible = np.float32(0.0)
                for k in range(max(z - 1, 0), min(z + 1, nz)):
                    for j in range(max(y - 1, 0), min(y + 1, ny)):
                        visible = max(visible, _largest(most, k, j, max(x - 1, 0), min(x + 1, nx)))
                cells[z, y, x] = _cell_error(means, least, most, brightest, z, y, x) if visible > 0.0 else 0.0


def cell_errors_numpy(means, least, most, brightest, cells):
    """Reference implementation of ``cell_errors``."""
    around = ((1, 1), (1, 1), (1, 1), (0, 0))
    means, least, most = (np.pad(part, around) for part in (_with_complement(means, brightest), least, most))
    above = _of_neighbors(most, np.maximum) - _of_neighbors(means, np.minimum)
    below = _of_neighbors(means, np.maximum) - _of_neighbors(least, np.minimum)
    cells[:] = np.maximum(above, below).max(axis=3)


def _of_neighbors(values: np.ndarray, join) -> np.ndarray:
    """Combine neighbors along z, y and x by a ufunc ``join``; each axis gets one entry shorter."""
    for axis in range(3):
        values = np.moveaxis(values, axis, 0)
        values = np.moveaxis(join(values[1:], values[:-1]), 0, axis)
    return values
