"""Rays that do not end at the lines of Blender's floor grid.

The grid is drawn with little opacity, but its lines are in the viewport's depth like any mesh.  Rays that end there
would cut lines into the volume, which near the horizon become a pattern of dots.
"""

from __future__ import annotations

import numpy as np

from .view import View

PIXELS = 1.5  # by which a line may lie beside its pixel's center, which changes the floor's depth
MOST = 0.05  # of the depth: near the horizon the floor changes too much to tell
BEHIND = 0.03  # of the depth: Blender 5.2 draws lines behind the floor, in perspective by 1.3 % at the median
SHARE = 1e-5  # of the depth, since the buffer is rounded
THIN = 5  # pixels across which a line, or lines side by side, are less
ROWS = 4  # one row of so many is looked at first


def without_floor(view: View, ends: np.ndarray, part) -> np.ndarray:
    """The depths at which rays end, without thin lines in the plane z = 0.

    Parameters
    ----------
    view : View
    ends : (height, width) ndarray of float32
        As of ``view.ray_ends``.
    part : (left, top, right, bottom)
        The part that holds depths.

    Returns
    -------
    (height, width) ndarray of float32
        A line takes the furthest depth beside it. A mesh in that plane is no line and stays.
    """
    left, top, right, bottom = part
    found = ends[top:bottom, left:right]
    numbers = np.flatnonzero(_near_floor(view, found[::ROWS], part, ROWS).any(axis=1)) * ROWS
    if not len(numbers):
        return ends
    some = slice(max(int(numbers[0]) - ROWS, 0), int(numbers[-1]) + ROWS)  # all else has no line
    near = _near_floor(view, found[some], (left, top + some.start, right, bottom), 1)
    cleared = ends.copy()
    np.copyto(cleared[top:bottom, left:right][some], _closed(found[some]), where=near)
    return cleared


def _near_floor(view: View, found: np.ndarray, part, step: int) -> np.ndarray:
    """Which depths are those of the plane z = 0.

    ``found``: (rows, columns) float32, of the first rows of ``part``, every ``step``-th of them.
    """
    left, top, right, _ = part
    window, matrix = view.window, view.camera.matrix_world
    # World z of the view's axes, and of the eye.
    (across, up, back), eye = matrix[2, :3] / np.linalg.norm(matrix[:3, :3], axis=0), matrix[2, 3]
    parallel = window[3, 3] != 0.0
    middle = -window[:2, 3] if parallel else window[:2, 2]
    columns = 2.0 * (np.arange(left, right) + 0.5) / view.width - 1.0
    rows = 1.0 - 2.0 * (top + step * np.arange(len(found)) + 0.5) / view.height
    by_column = (across / window[0, 0] * (columns + middle[0])).astype(np.float32)
    by_row = (up / window[1, 1] * (rows + middle[1])).astype(np.float32)
    slope = 2.0 * abs(across) / (view.width * window[0, 0]) + 2.0 * abs(up) / (view.height * window[1, 1])
    with np.errstate(all="ignore"):
        if parallel:
            floor = np.add.outer(by_row + np.float32(eye), by_column) / np.float32(back)
            change = np.float32(slope / max(abs(back), 1e-12))
        else:
            floor = np.float32(eye) / np.subtract.outer(np.float32(back) - by_row, by_column)
            change = floor * floor * np.float32(slope / max(abs(eye), 1e-12))
        before = np.minimum(np.float32(PIXELS) * change, np.float32(MOST) * floor) + np.float32(SHARE) * floor
        behind = found - floor
        near = behind >= -before
        near &= behind <= np.maximum(before, np.float32(BEHIND) * floor)
        near &= floor > 0.0
        near &= floor < np.inf
    return near


def _closed(depths: np.ndarray) -> np.ndarray:
    """Depths without what is nearer and thin: a closing by THIN x THIN pixels."""
    for join, beyond in ((np.maximum, -np.inf), (np.minimum, np.inf)):
        for axis in (0, 1):
            padding = [(0, 0), (0, 0)]
            padding[axis] = THIN // 2, THIN // 2
            joined, width = np.moveaxis(np.pad(depths, padding, constant_values=beyond), axis, 0), 1
            while width < THIN:
                step = min(width, THIN - width)
                joined, width = join(joined[:-step], joined[step:]), width + step
            depths = np.moveaxis(joined, 0, axis)
    return depths
