"""A pyramid of average-pooled extinction and emission; each node has the largest deviation of the voxels below it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..volume.pyramid import pooled


@dataclass(frozen=True, eq=False)
class Level:
    """``means``: (nz, ny, nx, 4) float32, the average (extinction * RGB, extinction) of 2^level voxels a side,
    transparent ones beyond the grid included, so that the total optical depth is kept.  ``deviation``: (nz, ny, nx)
    float32, the largest difference of any voxel's record from the mean, over the channels; 1 / world length."""

    means: np.ndarray
    deviation: np.ndarray

    @property
    def nbytes(self) -> int:
        return self.means.nbytes + self.deviation.nbytes


def build(voxels: np.ndarray, most_levels: int) -> list[Level]:
    """Level 0, the voxels (nz, ny, nx, 4) themselves, and up to ``most_levels`` above it, as long as a node is not
    the whole volume.

    The largest deviation of a voxel from a mean is the larger distance of the mean to the extremes below it.
    """
    levels = [Level(voxels, np.zeros(voxels.shape[:3], np.float32))]
    means, least, most = voxels, voxels, voxels
    while len(levels) <= most_levels and max(means.shape[:3]) > 1:
        means, least, most = 0.125 * pooled(means, np.add), pooled(least, np.minimum), pooled(most, np.maximum)
        levels.append(Level(means, np.maximum(means - least, most - means).max(axis=3)))
    return levels


def children(parents: np.ndarray, shape) -> np.ndarray:
    """(8 m, 3) indices z, y, x one level down of (m, 3) nodes, those outside a level of ``shape`` left out."""
    corner = np.array([(z, y, x) for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    found = (2 * parents[:, None, :] + corner).reshape(-1, 3)
    return found[(found < np.array(shape[:3])).all(axis=1)]


def cut(levels: list[Level], largest_deviation: float) -> list[np.ndarray]:
    """Per level, finest first, the (m, 3) indices z, y, x of the nodes to draw.

    From the top down, a node stands for all below it when none deviates from it by more than
    ``largest_deviation``; nodes in which nothing absorbs are left out.
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
