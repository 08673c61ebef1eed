"""Nodes of a pyramid, averaged straight from the visible voxels, and how far a picture of them may be wrong.

Laur and Hanrahan store with every node of a pyramid by how much it misstates the voxels it stands for.  Here the
node keeps the extremes of its voxels, from which follows, for every place in the volume, a bound of the difference
between the medium that the voxels make and the one that the nodes make, both with trilinear kernels.

Only what is visible is ever touched, so that the cost follows the visible voxels and the memory the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..classify.placing import Places
from ..runtime.jit import compiled, kernel, read_only
from ..volume.pyramid import pooled
from .pooling import nodes_shape

# Channels of a node's means, a voxel record: extinction * RGB, extinction.  Its extremes have three more, what the
# brightest colour would add: extinction * (brightest - RGB).
MEANS, EXTREMES = 4, 7
VOXELS_AT_ONCE = 1 << 20  # whose records are made together, 16 MiB, or those of one plane
NODE_BYTES = 4 * (MEANS + 2 * EXTREMES) + 12  # while they are made: means, extremes, a count and two errors


@dataclass(frozen=True, eq=False)
class Nodes:
    """A grid of nodes, each standing for a cube of 2^level voxels a side, transparent ones beyond the volume included.

    ``means``: (nz, ny, nx, 4) float32, average (extinction * RGB, extinction), 1 / world length.
    ``least`` and ``most``: (nz, ny, nx, 7) float32, extremes of the voxels' (extinction * RGB, extinction,
    extinction * (brightest - RGB)).  ``brightest``: no channel of any voxel's colour is above it.
    """

    level: int
    means: np.ndarray
    least: np.ndarray
    most: np.ndarray
    brightest: float

    def coarser(self) -> Nodes:
        """The next level, of half as many nodes a side."""
        return Nodes(
            self.level + 1, 0.125 * pooled(self.means, np.add), pooled(self.least, np.minimum),
            pooled(self.most, np.maximum), self.brightest,
        )


def node_steps(voxels, write, level: int, brightest: float, backend: str = "auto"):
    """Generator: yields the fraction done; returns the Nodes of a ``level``.

    ``voxels``: VisibleVoxels.  ``write(places, records)``: see ``encode.record_steps``.
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
    pool = pool_records if compiled(backend) else pool_records_numpy
    for plane in range(0, nz, planes_at_once):
        yield plane / nz
        places = Places.in_order(voxels, plane, min(plane + planes_at_once, nz))
        first, last = places.span
        if last > first:
            write(places, records)
            pool(
                read_only(voxels.row_start), read_only(voxels.column), first, records[: last - first], ny, level,
                np.float32(brightest), counts, totals, least, most,
            )
    least[counts < 8**level] = 0.0  # a voxel of the node is transparent
    return Nodes(level, totals * np.float32(0.125**level), least, most, brightest)


@kernel
def pool_records(row_start, column, first, records, n_y, level, brightest, counts, totals, least, most):
    """Add the records (n, 4) of the voxels from number ``first`` on to their nodes.

    ``row_start``, ``column``: see VisibleVoxels.  ``counts`` (nz, ny, nx) int32, ``totals`` (nz, ny, nx, 4), ``least``
    and ``most`` (nz, ny, nx, 7) float32: updated.
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
    """Twin of ``pool_records``."""
    voxels = np.arange(first, first + len(records))
    row = np.searchsorted(row_start, voxels, side="right") - 1
    node = (row // n_y >> level, row % n_y >> level, column[voxels].astype(np.int64) >> level)
    extremes = _with_complement(records, brightest)
    np.add.at(counts, node, 1)
    np.add.at(totals, node, records)
    np.minimum.at(least, node, extremes)
    np.maximum.at(most, node, extremes)


def _with_complement(records, brightest) -> np.ndarray:
    """(..., 7) of (..., 4) records: with what the brightest colour would add."""
    return np.concatenate((records, brightest * records[..., 3:] - records[..., :3]), axis=-1)


def node_errors(nodes: Nodes, backend: str = "auto") -> np.ndarray:
    """(nz + 2, ny + 2, nx + 2) float32, 1 / world length: how wrong the medium of the nodes may be about each node.

    Between eight node centres the voxels' medium is an average of voxels of these nodes, and the nodes' medium one
    of their means; what is left of either beyond the other's extremes bounds the difference.  A node takes the
    largest bound of the cells about it, so that errors interpolated between nodes bound the difference everywhere.
    One layer of nodes beyond the volume is included: there the medium falls off to nothing.
    """
    nz, ny, nx = nodes.means.shape[:3]
    cells = np.empty((nz + 1, ny + 1, nx + 1), np.float32)
    run = cell_errors if compiled(backend) else cell_errors_numpy
    run(nodes.means, nodes.least, nodes.most, np.float32(nodes.brightest), cells)
    return _of_neighbours(np.pad(cells, 1), np.maximum)


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
    """For each cell between eight nodes the largest difference of a voxel's record from a mean, over the channels.

    ``means`` (nz, ny, nx, 4), ``least`` and ``most`` (nz, ny, nx, 7): see Nodes.  ``cells``: (nz + 1, ny + 1, nx + 1)
    float32, written; cell (0, 0, 0) lies before node (0, 0, 0), and beyond the grid everything is zero.
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
    """Twin of ``cell_errors``."""
    around = ((1, 1), (1, 1), (1, 1), (0, 0))
    means, least, most = (np.pad(part, around) for part in (_with_complement(means, brightest), least, most))
    above = _of_neighbours(most, np.maximum) - _of_neighbours(means, np.minimum)
    below = _of_neighbours(means, np.maximum) - _of_neighbours(least, np.minimum)
    cells[:] = np.maximum(above, below).max(axis=3)


def _of_neighbours(values: np.ndarray, join) -> np.ndarray:
    """Neighbours joined along z, y and x by a ufunc ``join``: one fewer along each."""
    for axis in range(3):
        values = np.moveaxis(values, axis, 0)
        values = np.moveaxis(join(values[1:], values[:-1]), 0, axis)
    return values
