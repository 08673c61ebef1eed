"""The rays of all pixels in voxel-index space, as two matrices."""

import numpy as np

from ..view.eye import IndexView


def pixel_frame(view: IndexView) -> tuple[np.ndarray, np.ndarray]:
    """(3, 3) and (3,) float64, A and o, with A @ (x, y, z) + o = (column * h, row * h, depth).

    ``depth`` is planar depth in world units; h is 1 for parallel rays and the depth for perspective ones.
    """
    rows = np.stack((view.projection[0], view.projection[1], view.depth))
    return rows[:, :3], rows[:, 3]


def pixel_rays(view: IndexView) -> tuple[np.ndarray, np.ndarray]:
    """(3, 3) and (3, 3) float64, S and D: the ray through (column, row) is at voxel-index point
    ``S @ (column, row, 1) + depth * (D @ (column, row, 1))`` at planar depth ``depth``."""
    frame, offset = pixel_frame(view)
    inverse = np.linalg.inv(frame)
    fixed = np.stack((np.zeros(3), np.zeros(3), -inverse @ offset), axis=1)
    if not view.is_parallel:
        return fixed, inverse
    start = fixed.copy()
    start[:, :2] = inverse[:, :2]
    step = np.zeros((3, 3))
    step[:, 2] = inverse[:, 2]
    return start, step
