"""Rays that do not end at the lines of Blender's floor grid.

The grid is drawn with little opacity, but its lines are in the viewport's depth like any mesh.  Rays that end there
would cut lines into the volume, which near the horizon become a pattern of dots.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .view import ViewportView

PIXELS = 1.5  # by which a line may lie beside its pixel's center, which changes the floor's depth
MOST = 0.05  # of the depth: near the horizon the floor changes too much to tell
BEHIND = 0.03  # of the depth: Blender 5.2 draws lines behind the floor, in perspective by 1.3 % at the median
SHARE = 1e-5  # of the depth, since the buffer is rounded
THIN = 5  # pixels across which a line, or lines side by side, are less
ROWS = 4  # one row of so many is looked at first


def without_floor(view: ViewportView, ends: np.ndarray, part) -> None:
    """Let no ray end at thin lines in the plane z = 0.

    Parameters
    ----------
    view : ViewportView
    ends : (height, width) ndarray of float32
        As of ``view.ray_ends``; changed in place. A line takes the furthest depth beside it. A mesh in that plane is no
        line and stays.
    part : (left, top, right, bottom)
        The part that holds depths.
    """
    left, top, right, bottom = part
    found = ends[top:bottom, left:right]
    floor = _Floor.of(view, part)
    rows, _ = floor.near(found[::ROWS], ROWS)
    if not len(rows):
        return
    some = slice(max(int(rows[0]) - ROWS, 0), int(rows[-1]) + ROWS)  # all else has no line
    rows, columns = floor.near(found[some], 1, some.start)
    if len(rows):
        around = slice(max(int(columns.min()) - THIN, 0), int(columns.max()) + THIN)
        at = rows - some.start, columns - around.start
        found[some, around][at] = _closed(found[some, around])[at]


@dataclass(frozen=True, eq=False)
class _Floor:
    """The depth of the plane z = 0 in the pixels of a part of a view.

    ``by_row``, ``by_column``: float32; a pixel's depth is ``above / (by_row - by_column)`` in perspective and
    ``(by_row + by_column) / above`` in a parallel view.  ``slope``: how much the denominator, or the sum, changes from
    a pixel to the next.
    """

    by_row: np.ndarray
    by_column: np.ndarray
    above: np.float32
    slope: np.float32
    parallel: bool

    @classmethod
    def of(cls, view: ViewportView, part) -> _Floor:
        left, top, right, bottom = part
        window, matrix = view.window, view.camera.matrix_world
        # World z of the view's axes, and of the eye.
        (across, up, back), eye = matrix[2, :3] / np.linalg.norm(matrix[:3, :3], axis=0), matrix[2, 3]
        parallel = bool(window[3, 3] != 0.0)
        middle = -window[:2, 3] if parallel else window[:2, 2]
        columns = 2.0 * (np.arange(left, right) + 0.5) / view.width - 1.0
        rows = 1.0 - 2.0 * (np.arange(top, bottom) + 0.5) / view.height
        by_column = (across / window[0, 0] * (columns + middle[0])).astype(np.float32)
        by_row = (up / window[1, 1] * (rows + middle[1])).astype(np.float32)
        slope = 2.0 * abs(across) / (view.width * window[0, 0]) + 2.0 * abs(up) / (view.height * window[1, 1])
        if parallel:
            change = np.float32(slope / max(abs(back), 1e-12))
            return cls(by_row + np.float32(eye), by_column, np.float32(back), change, True)
        change = np.float32(slope / max(abs(eye), 1e-12))
        return cls(np.float32(back) - by_row, by_column, np.float32(eye), change, False)

    def near(self, found: np.ndarray, step: int, first: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the part, in the order of the rows, whose depths are those of the plane.

        ``found``: (n, columns) float32, of every ``step``-th row from ``first`` on.  Only pixels in which something was
        drawn are looked at, since that is a small share of most views.
        """
        rows, columns = np.divmod(np.flatnonzero(found.ravel() < np.inf), found.shape[1])
        depths, rows = found[rows, columns], rows * step + first
        with np.errstate(all="ignore"):
            if self.parallel:
                floor = (self.by_row[rows] + self.by_column[columns]) / self.above
                change = self.slope
            else:
                floor = self.above / (self.by_row[rows] - self.by_column[columns])
                change = floor * floor * self.slope
            before = np.minimum(np.float32(PIXELS) * change, np.float32(MOST) * floor) + np.float32(SHARE) * floor
            behind = depths - floor
            near = (behind >= -before) & (behind <= np.maximum(before, np.float32(BEHIND) * floor))
            near &= (floor > 0.0) & (floor < np.inf)
        return rows[near], columns[near]


def _closed(depths: np.ndarray) -> np.ndarray:
    """Depths without what is nearer and thin: a closing by THIN x THIN pixels."""
    around = THIN // 2
    for join, beyond in ((np.maximum, -np.inf), (np.minimum, np.inf)):
        joined = np.full([size + 2 * around for size in depths.shape], beyond, np.float32)
        joined[around:-around, around:-around] = depths
        width = 1
        while width < THIN:
            step = min(width, THIN - width)
            joined = join(joined[:-step], joined[step:])
            joined = join(joined[:, :-step], joined[:, step:])
            width += step
        depths = joined
    return depths
