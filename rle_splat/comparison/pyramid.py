"""A pyramid of average-pooled extinction and emission; each node has the largest deviation of the voxels below it."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Level:
    """One level of a pyramid, of nodes of 2^level voxels along each side.

    Attributes
    ----------
    means : (nz, ny, nx, 4) float32
        The average (extinction * RGB, extinction) of the node's voxels, 1 / world length.  Voxels beyond the grid count
        as transparent, so that the total optical depth is kept.
    deviation : (nz, ny, nx) float32
        The largest difference of any voxel's record from the mean, over the channels.
    """

    means: np.ndarray
    deviation: np.ndarray

    @property
    def nbytes(self) -> int:
        """Bytes of both arrays."""
        return self.means.nbytes + self.deviation.nbytes


def build(voxels: np.ndarray, most_levels: int) -> list[Level]:
    """Build the levels of a pyramid.

    A node's deviation is the largest distance of its mean to the extremes of the voxels below it.

    Parameters
    ----------
    voxels : (nz, ny, nx, 4) float32
        Level 0.
    most_levels : int
        Of further levels; there are fewer where one node is the whole volume.
    """
    levels = [Level(voxels, np.zeros(voxels.shape[:3], np.float32))]
    means, least, most = voxels, voxels, voxels
    while len(levels) <= most_levels and max(means.shape[:3]) > 1:
        means, least, most = 0.125 * pooled(means, np.add), pooled(least, np.minimum), pooled(most, np.maximum)
        levels.append(Level(means, np.maximum(means - least, most - means).max(axis=3)))
    return levels


def pooled(values: np.ndarray, join) -> np.ndarray:
    """Join neighbors in pairs along z, y and x by a ufunc ``join``; values beyond the far ends count as zero."""
    for axis in range(3):
        values = np.moveaxis(values, axis, 0)
        near, far = values[0::2], values[1::2]
        if len(far) < len(near):
            far = np.concatenate((far, np.zeros_like(near[:1])))
        values = np.moveaxis(join(near, far), 0, axis)
    return values


def children(parents: np.ndarray, shape) -> np.ndarray:
    """The children of (m, 3) nodes: indices z, y, x (n, 3) one level down, without those outside its ``shape``."""
    corner = np.array([(z, y, x) for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    found = (2 * parents[:, None, :] + corner).reshape(-1, 3)
    return found[(found < np.array(shape[:3])).all(axis=1)]


def cut(levels: list[Level], largest_deviation: float) -> list[np.ndarray]:
    """Choose the nodes to draw: the coarsest ones whose deviation is at most ``largest_deviation``.

    Returns
    -------
    list of (m, 3) int64
        For each level, finest first, the indices z, y, x of its nodes.  Nodes that absorb nothing are left out.
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
