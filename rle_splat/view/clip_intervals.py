"""Ray intervals inside clip objects: where the rays of sheet pixels pass half-spaces, and holes cut out of them.

Convex bodies to keep leave one interval of a ray; a convex body to cut away makes one hole in it. Intervals and holes
end exactly at the planes, also inside a slab.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..runtime.jit import compiled, kernel, parallel_call
from ..runtime.parallel import share_out
from ..volume.axes import AXES
from . import reference
from .base_plane import BasePlane
from .reference import MOST


@dataclass(frozen=True, eq=False)
class Cuts:
    """Half-spaces in voxel-index space: ``plane @ (x, y, z, 1) <= 0``.

    Attributes
    ----------
    kept : (n, 4) ndarray of float64
        The intersection of these half-spaces is kept.
    holes : tuple of (m, 4) ndarray of float64
        For each entry, the intersection of its m half-spaces is cut away.
    """

    kept: np.ndarray
    holes: tuple = ()

    @property
    def sides(self) -> np.ndarray:
        """(n, 4) float64: all half-spaces, those of ``kept`` first."""
        return np.concatenate((self.kept, *self.holes))


def clip_intervals(plane: BasePlane, cuts: Cuts, intervals: np.ndarray | None = None, threads: int = 0) -> np.ndarray:
    """Shorten ray intervals to what clip objects leave.

    Parameters
    ----------
    intervals : (2, H, W) ndarray of float32 or None
        Ray intervals as of ``ray_intervals``; None for whole rays.
    threads : int
        0 for one per core.

    Returns
    -------
    (2 + 2 holes, H, W) ndarray of float32
        Voxels along the viewing direction. The first two planes are begin and end of each ray; begin > end if nothing
        is left. Then follow begin and end of each hole that any ray has. Holes of a ray do not overlap. A ray without
        a hole stores an empty interval (begin = end).
    """
    if intervals is None:
        intervals = np.empty((2, plane.height, plane.width), np.float32)
        intervals[0], intervals[1] = -MOST, MOST
    return _clip(_crossings(plane, cuts.sides), cuts, intervals, threads)


def clip_rays(first, step, cuts: Cuts) -> tuple[np.ndarray, np.ndarray]:
    """Find what clip objects leave of single rays.

    Parameters
    ----------
    first, step : (n, 3) ndarray of float64
        Voxel that a ray passes at 0, and how far it goes from there to 1, as x, y, z.

    Returns
    -------
    enter, leave : (1 + holes, n) ndarray of float32
        Begin and end of each piece of a ray, front to back; ``enter >= leave`` for one of which nothing is left.
    """
    # Element by element: the bits of a matrix product depend on its size.
    sides = cuts.sides
    a, b, c, d = (sides[:, number, None] for number in range(4))
    rate, zero = (a * x + b * y + c * z for x, y, z in (step.T, first.T))
    no_rows, whole = np.zeros((len(a), 1)), np.empty((2, 1, len(first)), np.float32)
    whole[0], whole[1] = -MOST, MOST
    found = _clip((rate, zero + d, no_rows, no_rows), cuts, whole, 0)[:, 0]
    (begin, end), into, out = found[:2], found[2::2], found[3::2]  # a hole may be before the begin, or behind the end
    return np.maximum(np.vstack((begin, out)), begin), np.minimum(np.vstack((into, end)), end)


def _clip(crossings: tuple, cuts: Cuts, intervals: np.ndarray, threads: int) -> np.ndarray:
    """``clip_intervals`` of rays whose ``crossings`` with the sides of all cuts are known."""
    bodies = np.cumsum((len(cuts.kept), *map(len, cuts.holes)), dtype=np.int64)
    if not compiled():
        return reference.clip(crossings, bodies, intervals)
    found = np.empty((2 * len(bodies), *intervals.shape[1:]), np.float32)
    has_hole = np.zeros((intervals.shape[1], len(bodies)), np.bool_)
    with parallel_call(threads):
        _clip_rows(*crossings, bodies, np.ascontiguousarray(intervals), found, has_hole)
    return found[np.repeat(np.append(True, has_hole.any(axis=0)[1:]), 2)] if len(bodies) > 1 else found


def what_is_left(plane: BasePlane, intervals: np.ndarray, reach: int) -> tuple[BasePlane, np.ndarray] | None:
    """Reduce a plane to the window outside which no ray has anything left.

    Parameters
    ----------
    intervals : (2 + 2 holes, H, W) ndarray of float32
        Ray intervals of the plane.
    reach : int
        Sheet pixels to keep around rays that have something left.

    Returns
    -------
    (BasePlane, ndarray) or None
        The window and its ray intervals; None if nothing is left.
    """
    some = intervals[0] < intervals[1]
    columns, rows = (np.flatnonzero(some.any(axis=axis)) for axis in (0, 1))
    if not len(rows):
        return None
    window = plane.part((columns[0], rows[0]), (columns[-1], rows[-1]), reach)
    u, v = (new - old for new, old in zip(window.origin, plane.origin))
    return window, intervals[:, v : v + window.height, u : u + window.width]


def _crossings(plane: BasePlane, sides: np.ndarray) -> tuple[np.ndarray, ...]:
    """Linear functions whose roots are the crossings of rays and planes: (n, W), (n, W), (n, H) and (n, H) float64.

    On the ray of pixel (u, v), ``side @ (x, y, z, 1)`` is ``column_zero[u] + row_zero[v]`` at axis position 0 and
    changes by ``column_rate[u] + row_rate[v]`` per voxel along the viewing direction.
    """
    i, j, k = AXES[plane.axis]
    x, y = plane.points
    dx, dy = (np.broadcast_to(slope, at.shape) for slope, at in zip(plane.slopes(x, y), (x, y)))
    a, b, c, d = (sides[:, number, None] for number in (i, j, k, 3))
    return (
        plane.sign * (a * dx), a * (x - plane.reference * dx),
        plane.sign * (b * dy + c), b * (y - plane.reference * dy) + d,
    )  # fmt: skip


@kernel
def _clip_rows(column_rate, column_zero, row_rate, row_zero, bodies, intervals, found, has_hole):
    """Kernel of ``clip_intervals``.

    ``bodies``: end of each body in the list of sides; the first body is kept, the others are holes. Writes ``found``
    (2 bodies, H, W) float32 and ``has_hole`` (H, bodies), the holes that any ray of a row has.
    """
    share_out(
        _clip_some, intervals.shape[1],
        (column_rate, column_zero, row_rate, row_zero, bodies, intervals, found, has_hole),
    )  # fmt: skip


@kernel(inline="always", exact=True)
def _clamp(position):
    """Clamp to the range of float32."""
    return np.float32(min(max(position, -MOST), MOST))


@kernel(inner=True, exact=True)
def _clip_some(first_row, last_row, column_rate, column_zero, row_rate, row_zero, bodies, intervals, found, has_hole):
    """``_clip_rows`` for rows [first_row, last_row)."""
    width, holes = intervals.shape[2], bodies.size - 1
    begin, end = np.empty((1 + holes, width)), np.empty((1 + holes, width))
    for v in range(first_row, last_row):
        side = 0
        for body in range(1 + holes):
            for u in range(width):
                begin[body, u] = intervals[0, v, u] if body == 0 else -np.inf
                end[body, u] = intervals[1, v, u] if body == 0 else np.inf
            while side < bodies[body]:
                down_rate, down_zero = row_rate[side, v], row_zero[side, v]
                for u in range(width):
                    per_voxel, at_zero = column_rate[side, u] + down_rate, column_zero[side, u] + down_zero
                    crossing = -at_zero / per_voxel
                    if per_voxel > 0.0:
                        end[body, u] = min(end[body, u], crossing)
                    elif per_voxel < 0.0:
                        begin[body, u] = max(begin[body, u], crossing)
                    elif at_zero > 0.0:
                        end[body, u] = -np.inf
                side += 1
        if holes > 0:
            _take_holes(begin, end, has_hole[v])
        for u in range(width):
            some = begin[0, u] < end[0, u]
            found[0, v, u] = _clamp(begin[0, u]) if some else np.float32(-MOST)
            found[1, v, u] = _clamp(end[0, u]) if some else np.float32(-MOST)
        for hole in range(1, 1 + holes):
            for u in range(width):
                found[2 * hole, v, u], found[2 * hole + 1, v, u] = _clamp(begin[hole, u]), _clamp(end[hole, u])


@kernel(inner=True, exact=True)
def _take_holes(into, out, has_hole):
    """Shorten rays by the holes at their ends, and sort and separate the other holes, in place.

    ``into``, ``out`` (1 + holes, W): begin and end of each ray, then of its holes. Holes that are not inside the ray
    become infinitely far. Writes ``has_hole`` (1 + holes,), whether any ray has each hole.
    """
    count, width = into.shape
    for u in range(width):
        holes = 1
        for hole in range(1, count):
            enter, leave = into[hole, u], out[hole, u]
            into[hole, u] = out[hole, u] = np.inf
            if not enter < leave:
                continue
            at = holes
            while at > 1 and into[at - 1, u] > enter:
                into[at, u], out[at, u] = into[at - 1, u], out[at - 1, u]
                at -= 1
            into[at, u], out[at, u] = enter, leave
            holes += 1
        begin, end = into[0, u], out[0, u]
        reached = begin
        for hole in range(1, holes):
            if into[hole, u] <= begin:
                begin = max(begin, out[hole, u])
            reached = max(reached, begin)
            into[hole, u] = max(into[hole, u], reached)
            out[hole, u] = reached = max(out[hole, u], into[hole, u])
        for hole in range(holes - 1, 0, -1):
            if out[hole, u] >= end and into[hole, u] < out[hole, u]:
                end = min(end, into[hole, u])
                into[hole, u] = out[hole, u] = np.inf
            if into[hole, u] < out[hole, u]:
                has_hole[hole] = True
        into[0, u], out[0, u] = begin, end
