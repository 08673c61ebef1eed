"""Clip objects: which of a scene's planes and boxes cut the volume, and where they lie among its voxels."""

from __future__ import annotations

import numpy as np

from ..scene import CLIP_KINDS, Clip, Quality, Scene
from ..scene.changed import change
from ..view.base_plane import BasePlane
from ..view.clip_intervals import Cuts, clip_intervals, what_is_left
from ..view.footprints import FOOTPRINTS
from ..warp.warp import TAPS, warp_reach
from .kind import Kind
from .ray_pass import RayEffect, RayPass

NOTHING_LEFT = "The picture is empty: what the cutting objects leave of the volume is transparent or out of view."

# A plane this little inside the volume, in voxels, cuts nothing: a box that was fitted to it, rounded.
TOUCHING = 1e-5


def cuts_of(scene: Scene, quality: Quality) -> Cuts | None:
    """The cuts that a scene's clip objects make in its volume, in voxel indices; None where nothing is cut."""
    cutting = [(clip, sides) for clip, sides in _cutting(scene, quality) if len(sides)]
    if not cutting:
        return None
    kept = [sides for clip, sides in cutting if not _is_hole(clip)]
    return Cuts(
        np.concatenate([np.empty((0, 4)), *kept]), tuple(sides for clip, sides in cutting if _is_hole(clip))
    )  # fmt: skip


class ClipBodies(RayEffect):
    """Cuts out of rays what the scene's clip objects cut away."""

    stage = "clip objects"
    nothing_left = NOTHING_LEFT

    def __init__(self, cuts: Cuts, quality: Quality):
        self._cuts, self._quality = cuts, quality

    @classmethod
    def of(cls, scene: Scene, view, quality: Quality) -> ClipBodies | None:
        """The effect, None where nothing is cut; parameters as of ``RayEffects``."""
        cuts = cuts_of(scene, quality)
        return None if cuts is None else cls(cuts, quality)

    def shorten(self, ray_pass: RayPass, number: int, plane: BasePlane, intervals):
        """See ``RayEffect.shorten``."""
        quality = self._quality
        found = clip_intervals(plane, self._cuts, intervals, quality.threads)
        # A pass that takes pixels over needs all of the plane.
        return (plane, found) if ray_pass.before else what_is_left(plane, found, warp_reach(quality) + TAPS)


def _cutting(scene: Scene, quality: Quality):
    """Each clip object with those of its sides that cut the volume; all or none of a box that is cut away."""
    footprint = FOOTPRINTS[quality.kernel].radius if quality.classification == "pre" else 0.0
    if not scene.clips:
        return
    ends = ((-footprint, n - 1.0 + footprint) for n in scene.volume.shape_xyz)
    corners = np.array(np.meshgrid(*ends, (1.0,))).reshape(4, -1)
    for clip in scene.clips:
        sides = half_spaces(clip, scene.index_to_world)
        beyond = sides @ corners
        if _is_hole(clip):
            meets = (beyond.min(axis=1) < -TOUCHING).all()  # no side has all of the volume beyond it
            yield clip, sides if meets else sides[:0]
        else:
            yield clip, sides[(beyond > TOUCHING).any(axis=1)]


def _is_hole(clip: Clip) -> bool:
    return clip.kind == "box" and clip.keep == "outside"


def half_spaces(clip: Clip, index_to_world) -> np.ndarray:
    """The half-spaces of a clip object: one of a plane, six of a box.

    Parameters
    ----------
    index_to_world : (4, 4) ndarray of float64

    Returns
    -------
    (n, 4) ndarray of float64
        Plane equations in voxel indices; their values are distances in voxels, at most 0 on the kept side of a plane
        and inside a box.
    """
    to_own = np.linalg.inv(clip.matrix_world) @ index_to_world
    if clip.kind == "plane":
        sides = to_own[2:3] if clip.keep == "inside" else -to_own[2:3]
    else:
        ahead = np.array((0.0, 0.0, 0.0, 1.0))
        sides = np.concatenate((to_own[:3] - ahead, -to_own[:3] - ahead))
    return sides / np.linalg.norm(sides[:, :3], axis=1)[:, None]


def _count_in_words(number: int, kind: str) -> str:
    if number == 1:
        return f"1 {kind}"
    return f"{number} {'boxes' if kind == 'box' else f'{kind}s'}"


def _judge(scene: Scene, quality: Quality) -> tuple[bool, str]:
    if not scene.clips:
        return False, "the scene has no cutting object"
    kinds = [clip.kind for clip, sides in _cutting(scene, quality) if len(sides)]
    found = [_count_in_words(kinds.count(kind), kind) for kind in CLIP_KINDS if kind in kinds]
    if not found:
        return False, f"the scene has {_count_in_words(len(scene.clips), 'cutting object')}, and none cuts the volume"
    return True, f"{' and '.join(found)} {'cuts' if len(kinds) == 1 else 'cut'} the volume"


CLIP_OBJECTS = Kind(
    "Cut the volume by the planes and boxes of the scene", _judge, lambda scene: change(scene, clips=()),
    stage="clip objects",
)  # fmt: skip
