"""Pyramid of averaged extinction and emission, with the largest deviation below each node."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Level:
    """One level of the pyramid. A node at level L averages 2^L voxels along each side.

    Attributes
    ----------
    means : (nz, ny, nx, 4) ndarray of float32
        Mean (extinction * RGB, extinction) in 1 / world length. Voxels beyond the grid count as transparent, so that
        the total optical depth is preserved.
    deviation : (nz, ny, nx) ndarray of float32
        Largest difference of any voxel below the node from the mean, over the channels, in 1 / world length.
    """

    means: np.ndarray
    deviation: np.ndarray

    @property
    def nbytes(self) -> int:
        """Bytes of both arrays."""
        return self.means.nbytes + self.deviation.nbytes


def pooled(values: np.ndarray, join) -> np.ndarray:
    """Reduce pairs of neighbors along z, y and x by the ufunc ``join``; odd sides are padded with zeros."""
    for axis in range(3):
        values = np.moveaxis(values, axis, 0)
        near, far = values[0::2], values[1::2]
        if len(far) < len(near):
            far = np.concatenate((far, np.zeros_like(near[:1])))
        values = np.moveaxis(join(near, far), 0, axis)
    return values


def build(voxels: np.ndarray, most_levels: int) -> list[Level]:
    """Build the pyramid.

    Parameters
    ----------
    voxels : (nz, ny, nx, 4) ndarray of float32
        Level 0: (extinction * RGB, extinction).
    most_levels : int
        Largest number of levels above level 0. The pyramid also ends when one node covers the whole volume.

    Returns
    -------
    list of Level
        Finest level first.

    Notes
    -----
    The largest deviation from a mean is the larger of the distances of the mean to the smallest and the largest voxel.
    """
    levels = [Level(voxels, np.zeros(voxels.shape[:3], np.float32))]
    means, least, most = voxels, voxels, voxels
    while len(levels) <= most_levels and max(means.shape[:3]) > 1:
        means, least, most = 0.125 * pooled(means, np.add), pooled(least, np.minimum), pooled(most, np.maximum)
        levels.append(Level(means, np.maximum(means - least, most - means).max(axis=3)))
    return levels


def children(parents: np.ndarray, shape) -> np.ndarray:
    """Children of nodes, one level down.

    Parameters
    ----------
    parents : (m, 3) ndarray of int
        z, y, x.
    shape : sequence of int
        Shape (nz, ny, nx, ...) of the level of the children.

    Returns
    -------
    (at most 8 m, 3) ndarray of int
        z, y, x of the children inside that level.
    """
    corner = np.array([(z, y, x) for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    found = (2 * parents[:, None, :] + corner).reshape(-1, 3)
    return found[(found < np.array(shape[:3])).all(axis=1)]


def cut(levels: list[Level], largest_deviation: float) -> list[np.ndarray]:
    """Select the nodes to draw.

    From the top down, a node replaces all voxels below it if none deviates from its mean by more than
    ``largest_deviation``. Nodes without extinction are left out.

    Parameters
    ----------
    levels : list of Level
        Finest first.
    largest_deviation : float
        1 / world length.

    Returns
    -------
    list of (m, 3) ndarray of int
        Per level, finest first: z, y, x of the selected nodes.
    """
    chosen: list[np.ndarray] = []
    wanted = np.argwhere(levels[-1].means[..., 3] > 0.0)
    for number in range(len(levels) - 1, -1, -1):
        level = levels[number]
        good = level.deviation[tuple(wanted.T)] <= largest_deviation
        chosen.insert(0, wanted[good])
        if number > 0:
            below = levels[number - 1].means
            wanted = children(wanted[~good], below.shape)
            wanted = wanted[below[tuple(wanted.T)][:, 3] > 0.0]
    return chosen
