"""The principal axis of a ray, which selects the run-length tables from which it is splatted.

The principal axis is the axis along which a ray advances fastest in voxel-index space, so that it never moves more than
one voxel sideways per slice. Parallel rays share one axis. The rays of a perspective camera may belong to up to six
pyramids around the eye, one for each direction of each axis (algorithm.md 1.4).
"""

import numpy as np

from .eye import IndexView


def dominant_axis(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axis (0 x, 1 y, 2 z; ties go to the first) and sign, (...) int8 each, of (..., 3) directions."""
    axis = np.argmax(np.abs(directions), axis=-1).astype(np.int8)
    along = np.take_along_axis(directions, axis[..., None].astype(np.intp), axis=-1)[..., 0]
    return axis, np.where(along < 0.0, -1, 1).astype(np.int8)


def axis_shares(view: IndexView, band: float) -> list[tuple[int, int, float]]:
    """Principal axes from which a picture of parallel rays is blended.

    Parameters
    ----------
    band : float
        Degrees around the change of the principal axis within which both axes are used.

    Returns
    -------
    list of (axis, sign, share)
        Fastest axis first; shares sum to one. At the change of axis both have half, so that nothing jumps when the
        camera turns.
    """
    direction = -view.eye[:3]
    lengths = np.abs(direction)
    leading = int(lengths.argmax())
    beside = 45.0 - np.degrees(np.arctan2(lengths, lengths[leading]))  # degrees before each axis would be the fastest
    coming = [max(1.0 - away / band, 0.0) if band > 0.0 else 0.0 for away in beside.tolist()]
    weights = [one / (2.0 - one) for one in coming]  # makes the shares of two axes linear in the angle
    weights[leading] = 1.0
    whole = weights[0] + weights[1] + weights[2]
    order = [leading, *(axis for axis in range(3) if axis != leading and weights[axis] > 0.0)]
    return [(axis, -1 if direction[axis] < 0.0 else 1, weights[axis] / whole) for axis in order]


def candidate_pyramids(view: IndexView) -> list[tuple[int, int]]:
    """The (axis, sign) pairs to which rays of this view may belong; exactly one for parallel rays."""
    if view.is_parallel:
        axis, sign = dominant_axis(-view.eye[:3])
        return [(int(axis), int(sign))]
    return [(axis, sign) for axis in range(3) for sign in (1, -1)]
