"""The matrix of a camera or a light that looks at a point."""

import numpy as np
from numpy.typing import ArrayLike

from ..scene import RleSplatError

LEAST_ANGLE = 1e-6  # sine of the angle between the view and up, below which up says nothing


def look_at(position: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> np.ndarray:
    """Make the ``matrix_world`` of a camera, a light or a cutting plane at one point that looks at another.

    Parameters
    ----------
    position, target : (3,) array_like
        In world units.
    up : (3,) array_like
        The direction that is up in the picture.

    Returns
    -------
    (4, 4) ndarray of float64
        Columns are right, up, backward and the position: cameras and lights look along -Z, and a plane removes the side
        of +Z.

    Raises
    ------
    RleSplatError
        If a number is not finite, the points are the same, or ``up`` is along the view.
    """
    try:
        position, target, up = (np.asarray(one, np.float64).reshape(3) for one in (position, target, up))
    except (TypeError, ValueError) as error:
        raise RleSplatError("look_at takes a position, a target and up, three numbers each.") from error
    backward = position - target
    right = np.cross(up, backward)
    lengths = np.linalg.norm(backward), np.linalg.norm(right)
    if not np.isfinite(lengths).all() or lengths[1] <= LEAST_ANGLE * lengths[0] * np.linalg.norm(up):
        raise RleSplatError("look_at needs two finite points that differ, and an up that is not along the view.")
    backward, right = backward / lengths[0], right / lengths[1]
    matrix = np.eye(4)
    matrix[:3] = np.stack((right, np.cross(backward, right), backward, position), axis=1)
    return matrix
