"""Clip limits: where the rays of sheet pixels go through half-spaces, and through holes cut out of them.

What convex bodies keep of a ray is one stretch of it; what is cut out of it by a convex body is one hole.  Both end at
the planes themselves, inside a slab as well as between two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..runtime.jit import compiled, kernel, parallel_call
from ..runtime.parallel import share_out
from ..volume.axes import AXES
from .base_plane import BasePlane
from .ray_limits import MOST


@dataclass(frozen=True, eq=False)
class Cuts:
    """Planes in voxel indices: ``plane @ (x, y, z, 1)``, in any unit, is at most 0 on the side that counts.

    ``kept``: (n, 4) float64 half-spaces; what lies in all of them is kept.  ``holes``: tuple of (m, 4) float64
    half-spaces; what lies in all m of one of them is cut away.
    """

    kept: np.ndarray
    holes: tuple = ()


def clip_limits(
    plane: BasePlane, cuts: Cuts, limits: np.ndarray | None = None, backend: str = "auto", threads: int = 0
) -> np.ndarray:
    """(2 + 2 holes, H, W) float32: the ``limits`` (2, H, W) of ``ray_limits``, or without any the whole of each ray,
    with what the cuts leave of it, voxels along the viewing direction.

    The first two: where a ray begins and ends.  Then, for each hole that any ray has between them, where it goes in and
    comes out; a hole that a ray does not have is as deep as nothing, and no two of a ray overlap.  A ray of which
    nothing is left ends before it begins.
    """
    if limits is None:
        limits = np.empty((2, plane.height, plane.width), np.float32)
        limits[0], limits[1] = -MOST, MOST
    sides, bodies = np.concatenate((cuts.kept, *cuts.holes)), np.cumsum((len(cuts.kept), *map(len, cuts.holes)))
    crossings = _crossings(plane, sides)
    if not compiled(backend):
        return _limits_numpy(crossings, bodies, limits)
    found = np.empty((2 * len(bodies), *limits.shape[1:]), np.float32)
    has_hole = np.zeros((plane.height, len(bodies)), np.bool_)
    with parallel_call(threads):
        _limit_rows(*crossings, bodies, np.ascontiguousarray(limits), found, has_hole)
    return found[np.repeat(np.append(True, has_hole.any(axis=0)[1:]), 2)] if len(bodies) > 1 else found


def what_is_left(plane: BasePlane, limits: np.ndarray, reach: int) -> tuple[BasePlane, np.ndarray] | None:
    """The window of the plane outside which the ``limits`` leave nothing of any ray, and its limits; None for nothing.

    ``reach``: sheet pixels about a ray of which anything is left that are held besides.
    """
    some = limits[0] < limits[1]
    columns, rows = (np.flatnonzero(some.any(axis=axis)) for axis in (0, 1))
    if not len(rows):
        return None
    window = plane.part((columns[0], rows[0]), (columns[-1], rows[-1]), reach)
    u, v = (new - old for new, old in zip(window.origin, plane.origin))
    return window, limits[:, v : v + window.height, u : u + window.width]


def _crossings(plane: BasePlane, sides: np.ndarray) -> tuple[np.ndarray, ...]:
    """Where rays meet planes, by column and row of sheet pixels: (n, W), (n, W), (n, H) and (n, H) float64.

    On the ray of pixel (u, v), ``side @ (place, 1)`` is ``column_zero[u] + row_zero[v]`` at axis position zero and
    changes by ``column_rate[u] + row_rate[v]`` a voxel along the viewing direction.
    """
    i, j, k = AXES[plane.axis]
    x, y = plane.points()
    dx, dy = (np.broadcast_to(slope, place.shape) for slope, place in zip(plane.slopes(x, y), (x, y)))
    a, b, c, d = (sides[:, number, None] for number in (i, j, k, 3))
    return (
        plane.sign * (a * dx), a * (x - plane.reference * dx),
        plane.sign * (b * dy + c), b * (y - plane.reference * dy) + d,
    )  # fmt: skip


@kernel
def _limit_rows(column_rate, column_zero, row_rate, row_zero, bodies, limits, found, has_hole):
    """``clip_limits`` of all rows.  ``bodies``: up to which side each body goes, the first of what is kept, then holes.
    Out: ``found`` (2 bodies, H, W) float32 and ``has_hole`` (H, bodies), for whichever body a row has."""
    share_out(
        _limit_some, limits.shape[1],
        (column_rate, column_zero, row_rate, row_zero, bodies, limits, found, has_hole),
    )  # fmt: skip


@kernel(inline="always", exact=True)
def _held(place):
    return np.float32(min(max(place, -MOST), MOST))


@kernel(inner=True, exact=True)
def _limit_some(first_row, last_row, column_rate, column_zero, row_rate, row_zero, bodies, limits, found, has_hole):
    width, holes = limits.shape[2], bodies.size - 1
    begin, end = np.empty((1 + holes, width)), np.empty((1 + holes, width))
    for v in range(first_row, last_row):
        side = 0
        for body in range(1 + holes):
            for u in range(width):
                begin[body, u] = limits[0, v, u] if body == 0 else -np.inf
                end[body, u] = limits[1, v, u] if body == 0 else np.inf
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
            found[0, v, u] = _held(begin[0, u]) if some else np.float32(-MOST)
            found[1, v, u] = _held(end[0, u]) if some else np.float32(-MOST)
        for hole in range(1, 1 + holes):
            for u in range(width):
                found[2 * hole, v, u], found[2 * hole + 1, v, u] = _held(begin[hole, u]), _held(end[hole, u])


@kernel(inner=True, exact=True)
def _take_holes(into, out, has_hole):
    """Rays from ``into[0]`` to ``out[0]`` shortened by the holes at their ends, which the other rows of the two arrays
    (1 + holes, W) are; then these sorted, apart and within the ray, or infinitely far.  Out: ``has_hole`` (1 + holes,),
    whether any ray has each."""
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


def _limits_numpy(crossings, bodies, limits) -> np.ndarray:
    """Twin of ``_limit_rows``, without the holes that no ray has."""
    begin, end = (limit.astype(np.float64) for limit in limits)
    ways = [_stretch_within(*(part[first:last] for part in crossings)) for first, last in zip((0, *bodies), bodies)]
    begin, end = np.maximum(begin, ways[0][0]), np.minimum(end, ways[0][1])
    holes = np.empty((0, 2, *begin.shape))
    if len(bodies) > 1:
        begin, end, holes = _without_holes(begin, end, *(np.stack(ends) for ends in zip(*ways[1:])))
    nothing = ~(begin < end)
    begin[nothing], end[nothing] = -MOST, -MOST
    found = np.concatenate((np.stack((begin, end)), holes.reshape(-1, *begin.shape)))
    return np.clip(found, -MOST, MOST).astype(np.float32)


def _stretch_within(column_rate, column_zero, row_rate, row_zero) -> tuple[np.ndarray, np.ndarray]:
    """(H, W), (H, W) float64: where each ray enters and leaves the convex body of some half-spaces; it enters behind
    where it leaves where it never does."""
    shape = row_rate.shape[1], column_rate.shape[1]
    begin, end = np.full(shape, -np.inf), np.full(shape, np.inf)
    for side in range(len(column_rate)):
        per_voxel = column_rate[side] + row_rate[side, :, None]
        at_zero = column_zero[side] + row_zero[side, :, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = -at_zero / per_voxel
        np.minimum(end, crossing, out=end, where=per_voxel > 0.0)
        np.maximum(begin, crossing, out=begin, where=per_voxel < 0.0)
        end[(per_voxel == 0.0) & (at_zero > 0.0)] = -np.inf
    return begin, end


def _without_holes(begin, end, into, out):
    """Rays shortened by the holes at their ends, and (holes, 2, H, W) those that remain inside some ray, apart.

    ``into``, ``out``: (n, H, W), where a ray enters and leaves each hole; ``begin`` and ``end``: (H, W) of the rays.
    """
    into, out = np.where(into < out, into, np.inf), np.where(into < out, out, np.inf)  # none: behind all others
    order = np.argsort(into, axis=0, kind="stable")
    into, out = np.take_along_axis(into, order, 0), np.take_along_axis(out, order, 0)
    reached = begin
    for hole in range(len(into)):
        at_front = into[hole] <= begin
        begin = np.where(at_front, np.maximum(begin, out[hole]), begin)
        reached = np.maximum(reached, begin)
        into[hole] = np.maximum(into[hole], reached)
        out[hole] = reached = np.maximum(out[hole], into[hole])
    for hole in reversed(range(len(into))):
        at_back = (out[hole] >= end) & (into[hole] < out[hole])
        end = np.where(at_back, np.minimum(end, into[hole]), end)
        into[hole][at_back] = out[hole][at_back] = np.inf
    some = (into < out).any(axis=(1, 2))
    return begin, end, np.stack((into, out), axis=1)[some]
