"""Smallest and largest value of every block of voxels: one level of a min-max octree (algorithm.md 6).

A block is hidden if the transfer function hides all of [low, high]. After a change of the transfer function only the
voxels of visible blocks are read.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..runtime.jit import compiled, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from . import reference

# Voxels of a block along each axis: small enough to follow a surface, and a whole number of cache lines along x.
BLOCK_Z, BLOCK_Y, BLOCK_X = 8, 8, 32
VOXELS_AT_ONCE = 1 << 24  # voxels between two progress reports, at which a user can cancel: 10 to 20 ms


@dataclass(frozen=True, eq=False)
class Blocks:
    """Value range of every block of a volume.

    Attributes
    ----------
    low, high : (blocks along z, y, x) ndarray of the voxels' dtype
        Smallest and largest stored value. low > high where every voxel of a block is NaN.
    nan_voxels : int
        Number of NaN voxels in the volume.
    """

    low: np.ndarray
    high: np.ndarray
    nan_voxels: int

    @cached_property
    def finite_range(self) -> tuple[float, float]:
        """Smallest and largest finite value; inf and -inf where there is none."""
        seen = self.low <= self.high  # others hold no number
        low, high = (ends[seen & np.isfinite(ends)].astype(np.float64) for ends in (self.low, self.high))
        return float(low.min(initial=np.inf)), float(high.max(initial=-np.inf))

    @cached_property
    def holds_infinite(self) -> bool:
        """Whether any value is infinite."""
        if self.low.dtype.kind != "f":
            return False
        seen = self.low <= self.high
        return bool(np.isinf(self.low[seen]).any() or np.isinf(self.high[seen]).any())

    @property
    def nbytes(self) -> int:
        """Bytes of both arrays."""
        return self.low.nbytes + self.high.nbytes


def cut_chunks(n_planes: int, plane_voxels: int, at_once: int = VOXELS_AT_ONCE, multiple: int = 1):
    """Yield (first, end) of pieces of ``n_planes`` planes.

    Parameters
    ----------
    plane_voxels : int
        Voxels of a plane.
    at_once : int
        Approximate number of voxels of a piece.
    multiple : int
        Every piece but the last has a multiple of so many planes.

    Yields
    ------
    first, end : int
        Half-open range of planes.
    """
    planes = max(at_once // max(plane_voxels, 1) // multiple, 1) * multiple
    for first in range(0, n_planes, planes):
        yield first, min(first + planes, n_planes)


def block_steps(volume, *, threads: int = 0):
    """Generator of fractions done: compute the blocks of a volume. Reads every voxel once.

    Parameters
    ----------
    volume : Volume
    threads : int
        0 for one per core.

    Returns
    -------
    Blocks
    """
    voxels = read_only(np.asarray(volume.voxels))
    nz, ny, nx = voxels.shape
    shape = (-(-nz // BLOCK_Z), -(-ny // BLOCK_Y), -(-nx // BLOCK_X))
    low, high = np.empty((2, *shape), voxels.dtype)
    limits = np.finfo(voxels.dtype) if voxels.dtype.kind == "f" else np.iinfo(voxels.dtype)
    most = voxels.dtype.type(np.inf if voxels.dtype.kind == "f" else limits.max)
    least = voxels.dtype.type(-np.inf if voxels.dtype.kind == "f" else limits.min)
    nan_voxels = np.zeros(shape[:2], np.int64)
    for first, last in cut_chunks(nz, ny * nx, multiple=BLOCK_Z):
        yield first / nz
        part = slice(first // BLOCK_Z, -(-last // BLOCK_Z))
        arguments = (voxels[first:last], most, least, low[part], high[part], nan_voxels[part])
        if compiled():
            with parallel_call(threads):
                _extremes(*arguments)
        else:
            reference.find_extremes(*arguments, (BLOCK_Z, BLOCK_Y, BLOCK_X))
    return Blocks(low, high, int(nan_voxels.sum()))


@kernel
def _extremes(voxels, most, least, low, high, nan_voxels):
    """Extremes of the blocks of ``voxels``, whole planes of blocks. ``most``, ``least``: extremes of the dtype."""
    share_out(_rows_of_blocks, low.shape[0] * low.shape[1], (voxels, most, least, low, high, nan_voxels))


@kernel(inner=True)
def _rows_of_blocks(begin, end, voxels, most, least, low, high, nan_voxels):
    """Extremes of rows of blocks [begin, end), numbered along y, then z."""
    n_z, n_y, n_x = voxels.shape
    across, along = low.shape[1], low.shape[2]
    smallest = np.empty(n_x, voxels.dtype)  # whole rows at once: long loops become wide SIMD
    largest = np.empty(n_x, voxels.dtype)
    for row in range(begin, end):
        k, j = row // across, row % across
        for x in range(n_x):
            smallest[x] = most
            largest[x] = least
        nans = 0
        for z in range(k * BLOCK_Z, min((k + 1) * BLOCK_Z, n_z)):
            for y in range(j * BLOCK_Y, min((j + 1) * BLOCK_Y, n_y)):
                for x in range(n_x):
                    value = voxels[z, y, x]
                    smallest[x] = value if value < smallest[x] else smallest[x]  # never for NaN
                    largest[x] = value if value > largest[x] else largest[x]
                    nans += value != value
        nan_voxels[k, j] = nans
        for b in range(along):
            lowest, highest = most, least
            for x in range(b * BLOCK_X, min((b + 1) * BLOCK_X, n_x)):
                lowest = smallest[x] if smallest[x] < lowest else lowest
                highest = largest[x] if largest[x] > highest else highest
            low[k, j, b] = lowest
            high[k, j, b] = highest
