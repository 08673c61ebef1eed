"""How much a transfer function shows around a voxel, by which the normals of several channels are weighted.

It is the mean extinction over all values from the smallest to the largest of the 27 voxels around. So it is above zero
wherever a cell of the voxel shows anything, even where the voxel itself shows nothing, and continuous in the values.
"""

import math

import numpy as np

from ..runtime.work_sizes import MIXED_AT_ONCE
from ..volume.blocks import cut_chunks
from .lookup_table import LookupTable
from .reference import with_neighbors
from .visible import VisibleVoxels


def nearby_steps(volume, voxels: VisibleVoxels, infinite):
    """Generator of fractions done: find the smallest and the largest stored value around kept voxels.

    Parameters
    ----------
    volume : Volume
    voxels : VisibleVoxels
        Of which only the places count.
    infinite : (low, high) or ()
        Values that replace minus and plus infinity, if any.

    Returns
    -------
    (2, m) ndarray of float32
        In the order of the voxels; NaN where none of the values around is a number.
    """
    nx, ny, nz = volume.shape_xyz
    found = np.empty((2, len(voxels)), np.float32)
    for first, last in cut_chunks(nz, ny * nx, MIXED_AT_ONCE):
        yield first / nz
        starts = voxels.row_start[first * ny : last * ny + 1]
        rows = np.repeat(np.arange((last - first) * ny), np.diff(starts))
        own, low = slice(starts[0], starts[-1]), max(first - 1, 0)
        for end, choose in zip(found, (np.fmin, np.fmax)):
            around = np.asarray(volume.voxels[low : last + 1])
            for axis in range(3):
                around = with_neighbors(around, choose, axis)
            end[own] = around[first - low : last - low].reshape(-1, nx)[rows, voxels.column[own]]
            if infinite:
                end[own] = np.where(np.isinf(end[own]), np.clip(end[own], *infinite), end[own])
    return found


def mean_extinction(table: LookupTable, nearby: np.ndarray) -> np.ndarray:
    """Mean extinction between pairs of stored values.

    Parameters
    ----------
    nearby : (2, m) ndarray of float32
        The smaller and the larger ones, as of ``nearby_steps``.

    Returns
    -------
    (m,) ndarray of float32
        1 / world length; 0 between values that are no numbers.
    """
    entries = table.entries[:-1, 3].astype(np.float64)
    if not len(entries) or table.low > table.high:
        return np.zeros(nearby.shape[1], np.float32)
    sums, found = np.concatenate(([0.0], np.cumsum(entries))), np.empty(nearby.shape[1], np.float32)
    # The table's end stands for all values beyond it where these are shown, else nothing is there.
    before, behind = (entries[end] * math.isfinite(limit) for end, limit in ((0, table.nearest), (-1, table.furthest)))

    def integral(at):
        inside = np.clip(at, 0.0, len(entries))
        cell = np.minimum(inside.astype(np.int64), len(entries) - 1)
        beyond = before * np.minimum(at, 0.0) + behind * np.maximum(at - len(entries), 0.0)
        return sums[cell] + (inside - cell) * entries[cell] + beyond

    for first in range(0, len(found), MIXED_AT_ONCE):
        part = slice(first, first + MIXED_AT_ONCE)
        low, high = (np.nan_to_num(nearby[:, part].astype(np.float64), nan=0.0) - table.origin) * table.rate
        # As wide as an entry at least, so that equal values have their own extinction.
        wider = 0.5 * np.maximum(1.0 - (high - low), 0.0)
        low, high = low - wider, high + wider
        found[part] = np.where(np.isnan(nearby[0, part]), 0.0, (integral(high) - integral(low)) / (high - low))
    return found
