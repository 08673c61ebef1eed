"""Two media a ray may cross, in voxel-index space: one for each truth.

A medium offers a box (``low``, ``high``), ``cells(cell)`` -> what a cell's eight corners hold, ``occupied(cell)``
and ``evaluate(corners, fractions)`` -> associated source and extinction.  Index order is (x, y, z) throughout.
"""

from __future__ import annotations

import numpy as np

from .transfer import extinction_and_color

_CORNERS = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)])


def corner_weights(fractions: np.ndarray) -> np.ndarray:
    """(..., 3) positions in a unit cell -> (..., 8) trilinear weights, corner order x fastest."""
    x, y, z = fractions[..., 0], fractions[..., 1], fractions[..., 2]
    x0, y0, z0 = 1.0 - x, 1.0 - y, 1.0 - z
    rows = (y0 * z0, y * z0, y0 * z, y * z)
    return np.stack([side * row for row in rows for side in (x0, x)], axis=-1)


class _Grid:
    """Values (nz, ny, nx, channels) with a lookup of the eight corners of a cell."""

    def __init__(self, values: np.ndarray, first):
        self._values, self._first = values, np.asarray(first)
        self._most = np.array(values.shape[2::-1]) - 2

    def corners(self, cell: np.ndarray) -> np.ndarray:
        """(P, 3) integer index of each cell's low corner -> (P, 8, channels)."""
        low = np.clip(cell - self._first, 0, self._most)
        at = low[:, None, :] + _CORNERS
        return self._values[at[..., 2], at[..., 1], at[..., 0]]


class ClassifiedMedium:
    """T1: extinction and associated colour interpolated trilinearly, zero outside the grid.

    ``extinction``: (nz, ny, nx) in 1/world length; ``color``: (nz, ny, nx, 3) unassociated, shaded or not.
    The medium fills [-1, n] along each axis: the outermost voxels ramp down to zero within one voxel.
    """

    def __init__(self, extinction, color):
        extinction = np.asarray(extinction, dtype=np.float64)
        source = np.asarray(color, dtype=np.float64) * extinction[..., None]
        fields = np.pad(np.concatenate((source, extinction[..., None]), axis=-1), ((1, 1),) * 3 + ((0, 0),))
        self._grid = _Grid(fields, (-1, -1, -1))
        self.low = np.full(3, -1.0)
        self.high = np.array(extinction.shape[::-1], dtype=np.float64)

    def cells(self, cell: np.ndarray) -> np.ndarray:
        return self._grid.corners(cell)

    @staticmethod
    def occupied(corners: np.ndarray) -> np.ndarray:
        """(P,) bool: whether anything in the cell absorbs."""
        return (corners[..., 3] > 0.0).any(axis=1)

    @staticmethod
    def evaluate(corners: np.ndarray, fractions: np.ndarray) -> np.ndarray:
        """(P, 8, 4) corners at (P, N, 3) positions in the cell -> (P, N, 4): sigma * rgb, sigma."""
        return corner_weights(fractions) @ corners


class ScalarMedium:
    """T2: the scalar interpolated trilinearly and then classified, inside the box of voxel centres [0, n - 1].

    ``values``: (nz, ny, nx) physical scalars, at least two voxels along each axis; NaN makes its cells transparent.
    ``world_distance``: world length of the transfer function's opacity unit distance.
    """

    def __init__(self, values, transfer_function, world_distance: float):
        values = np.asarray(values, dtype=np.float64)
        self._grid = _Grid(values[..., None], (0, 0, 0))
        self._transfer_function, self._world_distance = transfer_function, world_distance
        self._knots = np.array(sorted(p[0] for p in transfer_function.opacity))
        self.low = np.zeros(3)
        self.high = np.array(values.shape[::-1], dtype=np.float64) - 1.0

    def cells(self, cell: np.ndarray) -> np.ndarray:
        return self._grid.corners(cell)

    def occupied(self, corners: np.ndarray) -> np.ndarray:
        """(P,) bool: whether the transfer function is above zero anywhere in the cell's range of values."""
        low, high = corners[..., 0].min(axis=1), corners[..., 0].max(axis=1)
        seen = np.zeros(len(corners), dtype=bool)
        for end in (low, high):
            seen |= extinction_and_color(self._transfer_function, end, 1.0)[0] > 0.0
        for knot in self._knots:
            just_below = np.nextafter(knot, -np.inf)  # a step may be opaque on one side of its knot only
            opaque = (extinction_and_color(self._transfer_function, np.array((just_below, knot)), 1.0)[0] > 0.0).any()
            seen |= opaque & (low <= knot) & (knot <= high)
        return seen

    def evaluate(self, corners: np.ndarray, fractions: np.ndarray) -> np.ndarray:
        """(P, 8, 1) corners at (P, N, 3) positions in the cell -> (P, N, 4): sigma * rgb, sigma."""
        scalar = (corner_weights(fractions) @ corners)[..., 0]
        sigma, color = extinction_and_color(self._transfer_function, scalar, self._world_distance)
        return np.concatenate((color * sigma[..., None], sigma[..., None]), axis=-1)
