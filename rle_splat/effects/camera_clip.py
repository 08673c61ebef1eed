"""The camera's clip distances: whether they cut the volume, and the scene without them."""

from __future__ import annotations

import numpy as np

from ..scene import LARGEST_LENGTH, LEAST_LENGTH, Quality, Scene
from ..scene.changed import change
from ..view.base_plane import BasePlane
from ..view.eye import IndexView, index_view
from ..view.footprints import FOOTPRINTS
from ..view.ray_intervals import ray_intervals
from .kind import Kind
from .ray_pass import RayEffect, RayPass


def find_volume_depths(scene: Scene, view: IndexView, quality: Quality) -> tuple[float, float]:
    """The nearest and furthest planar depth of all slabs, with half a voxel to spare, in world units.

    An end outside of these depths shortens no ray, so that the picture has the same bits with and without it.
    """
    return view.box_depths(scene.volume.shape_xyz, np.ceil(FOOTPRINTS[quality.kernel].radius) + 0.5)


def is_cut(scene: Scene, view: IndexView, quality: Quality) -> bool:
    """Whether a clip plane of the camera cuts the volume's box, or its eye is inside."""
    nearest, furthest = find_volume_depths(scene, view, quality)
    behind_eye = not view.is_parallel and nearest <= 0.0
    return bool(
        (nearest < scene.camera.clip_start and not behind_eye) or furthest > scene.camera.clip_end or behind_eye
    )


class CameraClip(RayEffect):
    """Ends rays at the camera's clip distances, and at the surface of a mesh where a pass has one.

    Parameters
    ----------
    camera : Camera
    cuts : bool
        Whether a clip plane cuts the volume; else only meshes end rays.
    """

    def __init__(self, camera, quality: Quality, cuts: bool):
        self._distances, self._threads = (camera.clip_start, camera.clip_end), quality.threads
        self.moves_depth = cuts

    @classmethod
    def of(cls, scene: Scene, view: IndexView, quality: Quality) -> CameraClip | None:
        """The effect, None where neither clip planes nor meshes can end rays; parameters as of ``RayEffects``."""
        cuts = is_cut(scene, view, quality)
        return cls(scene.camera, quality, cuts) if cuts or scene.hides_volume else None

    def stage_of(self, ray_pass: RayPass) -> str:
        """See ``RayEffect.stage_of``."""
        return self.stage if ray_pass.surface is None else "occlusion"

    def shorten(self, ray_pass: RayPass, number: int, plane: BasePlane, intervals):
        """See ``RayEffect.shorten``."""
        if not self.moves_depth and ray_pass.surface is None:
            return plane, intervals
        found = ray_intervals(plane, *self._distances, ray_pass.surface, ray_pass.first_pixel, threads=self._threads)
        return plane, found


def _judge(scene: Scene, quality: Quality) -> tuple[bool, str]:
    view = index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
    cut = is_cut(scene, view, quality)
    return cut, f"{'a' if cut else 'no'} clip plane of the camera cuts the volume"


def _without(scene: Scene) -> Scene:
    return change(scene, camera=change(scene.camera, clip_start=LEAST_LENGTH, clip_end=LARGEST_LENGTH))


CLIPPING = Kind(
    "End rays at the clip distances of the camera", _judge, _without, stage="clipping",
    may_be_idle=True,
)  # fmt: skip
