"""Clip limits: where the rays of sheet pixels go through half-spaces, and through holes cut out of them.

What convex bodies keep of a ray is one stretch of it; what is cut out of it by a convex body is one hole.  Both end at
the planes themselves, inside a slab as well as between two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..axes import AXES
from .base_plane import BasePlane

MOST = np.finfo(np.float32).max


@dataclass(frozen=True, eq=False)
class Cuts:
    """Planes in voxel indices: ``plane @ (x, y, z, 1)``, in voxels, is at most 0 on the side that counts.

    ``kept``: (n, 4) float64 half-spaces; what lies in all of them is kept.  ``holes``: tuple of (m, 4) float64
    half-spaces; what lies in all m of one of them is cut away.
    """

    kept: np.ndarray
    holes: tuple


def clip_limits(plane: BasePlane, cuts: Cuts, limits: np.ndarray) -> np.ndarray:
    """(2 + 2 holes, H, W) float32: the ``limits`` (2, H, W) of ``ray_limits`` with what the cuts leave of each ray.

    The first two: where a ray begins and ends.  Then, for each hole that any ray has between them, where it goes in and
    comes out; a hole that a ray does not have is as deep as nothing, and no two of a ray overlap.  A ray of which
    nothing is left ends before it begins.
    """
    begin, end = (limit.astype(np.float64) for limit in limits)
    if len(cuts.kept):
        enter, leave = stretch_within(plane, cuts.kept)
        begin, end = np.maximum(begin, enter), np.minimum(end, leave)
    holes = np.empty((0, 2, *begin.shape))
    if cuts.holes:
        into, out = zip(*(stretch_within(plane, sides) for sides in cuts.holes))
        begin, end, holes = _without_holes(begin, end, np.stack(into), np.stack(out))
    nothing = ~(begin < end)
    begin[nothing], end[nothing] = -MOST, -MOST
    found = np.concatenate((np.stack((begin, end)), holes.reshape(-1, *begin.shape)))
    return np.clip(found, -MOST, MOST).astype(np.float32)


def stretch_within(plane: BasePlane, sides: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(H, W), (H, W) float64: where each sheet pixel's ray enters and leaves the convex body of some half-spaces,
    voxels along the viewing direction; it enters behind where it leaves where it never does."""
    i, j, k = AXES[plane.axis]
    x, y = plane.points()
    dx, dy = (np.broadcast_to(slope, place.shape) for slope, place in zip(plane.slopes(x, y), (x, y)))
    begin, end = np.full((len(y), len(x)), -np.inf), np.full((len(y), len(x)), np.inf)
    for side in sides:
        # On a ray, side @ (place, 1) is ``at_zero`` at axis position zero and changes ``per_voxel`` along the view.
        per_voxel = plane.sign * (side[i] * dx + (side[j] * dy + side[k])[:, None])
        at_zero = side[i] * (x - plane.reference * dx) + (side[j] * (y - plane.reference * dy) + side[3])[:, None]
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
