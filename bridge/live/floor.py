"""Rays that do not end at the lines of Blender's floor grid.

The grid is drawn with little opacity, but its lines are in the viewport's depth like any mesh.  Rays that end there
would cut lines into the volume, which near the horizon become a pattern of dots.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...rle_splat.runtime.steps import Progress
from .view import BAND, ViewportView

PIXELS = 1.5  # by which a line may lie beside its pixel's center, which changes the floor's depth
MOST = 0.05  # of the depth: near the horizon the floor changes too much to tell
BEHIND = 0.03  # of the depth: Blender 5.2 draws lines behind the floor, in perspective by 1.3 % at the median
SHARE = 1e-5  # of the depth, since the buffer is rounded
THIN = 5  # pixels across which a line, or lines side by side, are less
READING = "Reading the depth of meshes"
ROWS = 4  # one row of so many is looked at first


def without_floor_steps(view: ViewportView, ends: np.ndarray, part):
    """Generator: depths that end no ray at thin lines in the plane z = 0; yields Progress after each band of rows.

    Parameters
    ----------
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
    drawn, floor = ends[top:bottom, left:right], _Floor.of(view, part)
    rows = np.flatnonzero(floor.is_near(drawn[::ROWS], slice(None, None, ROWS)).any(axis=1)) * ROWS
    yield Progress(0.0, READING)
    if not len(rows):
        return ends
    cleared = ends.copy()
    found = cleared[top:bottom, left:right]
    first, last = max(int(rows[0]) - ROWS, 0), min(int(rows[-1]) + ROWS, len(drawn))  # all else has no line
    for begin in range(first, last, BAND):
        band, above = slice(begin, min(begin + BAND, last)), min(begin, THIN)
        near = floor.is_near(drawn[band], band)
        columns = np.flatnonzero(near.any(axis=0))
        if len(columns):
            across = slice(max(int(columns[0]) - THIN, 0), int(columns[-1]) + 1 + THIN)
            closed = _closed(drawn[begin - above : band.stop + THIN, across])[above : above + len(near)]
            np.copyto(found[band, across], closed, where=near[:, across])
        yield Progress((band.stop - first) / (last - first), READING)
    return cleared


@dataclass(frozen=True, eq=False)
class _Floor:
    """The depth of the plane z = 0 in the pixels of a part of a view.

    ``by_row``, ``by_column``: float32; their sum is a pixel's depth in a parallel view, and in perspective its
    reciprocal.  ``slope``: how much the sum changes from a pixel to the next.
    """

    by_row: np.ndarray
    by_column: np.ndarray
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
        by_column = across / window[0, 0] * (columns + middle[0])
        by_row = up / window[1, 1] * (rows + middle[1])
        slope = 2.0 * abs(across) / (view.width * window[0, 0]) + 2.0 * abs(up) / (view.height * window[1, 1])
        by_row = by_row + eye if parallel else by_row - back
        over = (back if parallel else -eye) or 1e-12  # of a view along the plane
        by_row, by_column = ((one / over).astype(np.float32) for one in (by_row, by_column))
        return cls(by_row, by_column, np.float32(slope / abs(over)), parallel)

    def is_near(self, found: np.ndarray, rows: slice) -> np.ndarray:
        """Whether depths are those of the plane, (n, columns) bool.

        ``found``: (n, columns) float32, of these rows of the part.
        """
        with np.errstate(all="ignore"):
            plane = self.by_row[rows, np.newaxis] + self.by_column
            behind = found / plane if self.parallel else found * plane
            behind -= np.float32(1.0)  # as a share of the depth
            before = np.divide(np.float32(PIXELS) * self.slope, plane, out=plane)
            np.minimum(before, np.float32(MOST), out=before)
            before += np.float32(SHARE)
            near = before > SHARE  # before the eye
            near &= behind <= np.maximum(before, np.float32(BEHIND))
            near &= behind >= np.negative(before, out=before)
        return near


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
