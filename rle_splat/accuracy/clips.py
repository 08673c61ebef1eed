"""Clip objects along rays: where rays cross their planes, and which points they keep."""

from __future__ import annotations

import numpy as np

from .rays import WorldRays


class Clipping:
    """The clip objects of a scene along rays.

    Parameters
    ----------
    clips : sequence of Clip
    """

    def __init__(self, clips, rays: WorldRays):
        self._clips = [(clip, np.linalg.inv(clip.matrix_world)) for clip in clips]
        self._rays = rays

    def __getitem__(self, chosen) -> Clipping:
        part = Clipping((), self._rays[chosen])
        part._clips = self._clips
        return part

    def crossings(self) -> np.ndarray:
        """(N, K) planar depths where each ray crosses the planes of the clip objects; not finite where none."""
        found = [np.empty((len(self._rays.origin), 0))]
        for clip, to_own in self._clips:
            start = self._rays.origin @ to_own[:3, :3].T + to_own[:3, 3]
            step = self._rays.step @ to_own[:3, :3].T
            walls = [(2, 0.0)] if clip.kind == "plane" else [(axis, at) for axis in range(3) for at in (-1.0, 1.0)]
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                found += [((at - start[:, axis]) / step[:, axis])[:, None] for axis, at in walls]
        return np.concatenate(found, axis=1)

    def keeps(self, ray, depth) -> np.ndarray:
        """(P,) bool: whether the points at planar ``depth`` (P,) on the rays with index ``ray`` (P,) are kept."""
        points = self._rays[ray].at_depth(depth)
        kept = np.ones(len(points), bool)
        for clip, to_own in self._clips:
            own = points @ to_own[:3, :3].T + to_own[:3, 3]
            inside = own[:, 2] <= 0.0 if clip.kind == "plane" else (np.abs(own) <= 1.0).all(axis=1)
            kept &= inside if clip.keep == "inside" else ~inside
        return kept
