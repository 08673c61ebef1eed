"""The camera's clip distances: whether they cut the volume, and the scene without them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..scene import LARGEST_LENGTH, LEAST_LENGTH, Quality, Scene
from ..view.eye import IndexView, index_view
from ..view.footprints import FOOTPRINTS
from ..view.ray_limits import box_depths
from .kind import Kind


def slab_depths(scene: Scene, view: IndexView, quality: Quality) -> tuple[float, float]:
    """Planar depths between which every slab of every sheet ends, with half a voxel to spare.

    What shortens no ray in here shortens none at all: the picture has the same bits whether it is asked or not.
    """
    return box_depths(view, scene.volume.shape_xyz, np.ceil(FOOTPRINTS[quality.kernel].radius) + 0.5)


def is_cut(scene: Scene, view: IndexView, quality: Quality) -> bool:
    """Whether a clip plane of the camera cuts the volume's box, or its eye is inside."""
    nearest, furthest = slab_depths(scene, view, quality)
    behind_eye = not view.is_parallel and nearest <= 0.0
    return (nearest < scene.camera.clip_start and not behind_eye) or furthest > scene.camera.clip_end or behind_eye


def _called_for(scene: Scene, quality: Quality) -> tuple[bool, str]:
    view = index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
    cut = is_cut(scene, view, quality)
    return cut, f"a clip plane of the camera {'cuts' if cut else 'does not cut'} the volume"


def _without(scene: Scene) -> Scene:
    return replace(scene, camera=replace(scene.camera, clip_start=LEAST_LENGTH, clip_end=LARGEST_LENGTH))


CLIPPING = Kind(
    "ends rays at the clip distances of the camera", _called_for, _without, stage="clipping",
    may_be_idle=True,
)
