"""Principal axis by the 45-degree rule: which set of tables a ray is splatted from.

A ray belongs to the axis along which it advances fastest *in voxel-index space*, so that it never moves more
than one voxel sideways per slice.  Parallel rays share one axis.  The rays of a perspective camera may fall into
up to six pyramids about the eye, one for each direction of each axis (algorithm.md 1.4).
"""

from __future__ import annotations

import numpy as np

from .eye import IndexView


def dominant_axis(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(...) int8 axis (0 x, 1 y, 2 z; ties go to the earlier) and (...) int8 sign of (..., 3) directions."""
    axis = np.argmax(np.abs(directions), axis=-1).astype(np.int8)
    along = np.take_along_axis(directions, axis[..., None].astype(np.intp), axis=-1)[..., 0]
    return axis, np.where(along < 0.0, -1, 1).astype(np.int8)


def axis_shares(view: IndexView, band: float) -> list[tuple[int, int, float]]:
    """(axis, sign, share) of the principal axes that a picture of parallel rays is mixed from, the fastest first.

    Within ``band`` degrees of the 45 degrees at which the principal axis switches, the axis to come fades in, and both
    have half where they are as fast as each other: what a camera sees never jumps.  Shares sum to one.
    """
    direction = -view.eye[:3]
    leading = int(dominant_axis(direction)[0])
    fastest = abs(direction[leading])
    beside = 45.0 - np.degrees(np.arctan2(np.abs(direction), fastest))  # degrees from where each axis would take over
    coming = np.maximum(1.0 - beside / band, 0.0) if band > 0.0 else np.zeros(3)
    weights = coming / (2.0 - coming)  # so that of two axes the shares change evenly
    weights[leading] = 1.0
    order = [leading, *(axis for axis in range(3) if axis != leading and weights[axis] > 0.0)]
    signs = np.where(direction < 0.0, -1, 1)
    return [(axis, int(signs[axis]), float(weights[axis] / weights.sum())) for axis in order]


def candidate_pyramids(view: IndexView) -> list[tuple[int, int]]:
    """The (axis, sign) pairs that rays of this view may belong to; for parallel rays the one they do."""
    if view.is_parallel:
        axis, sign = dominant_axis(-view.eye[:3])
        return [(int(axis), int(sign))]
    return [(axis, sign) for axis in range(3) for sign in (1, -1)]
