"""Meshes in the volume: whether any may end a ray in it, and where the rays end."""

from __future__ import annotations

import numpy as np

from ..scene import Quality, RleSplatError, Scene
from ..scene.changed import change
from ..splat.intermediate_image import IntermediateImage
from ..view.base_plane import BasePlane
from ..view.eye import IndexView, index_view
from ..view.projection import depth_row
from ..view.ray_intervals import pixels_read
from .camera_clip import find_volume_depths
from .depth_layers import HALO, DepthLayers, depth_layers_steps
from .far_layer import layers_to_splat, leave_out_like, mix_layers, take_like, trace_layers
from .kind import Kind
from .mesh_depth import mesh_depth
from .ray_pass import RayEffect, RayPass

SPARSE = 64  # one triangle of so many
BEHIND = "no mesh is in or in front of the volume"


class MeshSurfaces(RayEffect):
    """Ends rays at meshes; what is seen past silhouettes is drawn in a second pass."""

    name, stage = "mesh occlusion", "occlusion"
    _layers: DepthLayers  # once ``inspect_steps`` has found some

    def __init__(self, scene: Scene, view: IndexView, quality: Quality):
        self._scene, self._view, self._quality = scene, view, quality

    @classmethod
    def of(cls, scene: Scene, view: IndexView, quality: Quality) -> MeshSurfaces | None:
        """The effect, None for a scene without meshes; parameters as of ``RayEffects``."""
        return cls(scene, view, quality) if scene.hides_volume else None

    def inspect_steps(self, planes: list[BasePlane]):
        """See ``RayEffect.inspect_steps``."""
        self._layers = yield from mesh_layers_steps(self._scene, self._view, self._quality, planes)
        return BEHIND if self._layers is None else None

    def passes(self, passes: list[RayPass], reach: int) -> list[RayPass]:
        """See ``RayEffect.passes``: the near layer, and the far layer where there are silhouettes."""
        (whole,) = passes
        planes, first_pixel = [plane for _, plane in whole.planes], self._layers.first_pixel
        found: list[RayPass] = []
        for surface, region, shown in layers_to_splat(self._layers, whole.region, planes, reach):
            found.append(RayPass(region, shown, surface, first_pixel, found[0] if found else None))
        return found

    def shorten(self, ray_pass: RayPass, number: int, plane: BasePlane, intervals):
        """See ``RayEffect.shorten``; ``CameraClip`` has shortened the rays, this leaves out repeated blocks."""
        if ray_pass.before is None:
            ray_pass.intervals[number] = plane, intervals
        else:
            ray_pass.alike[number] = leave_out_like(plane, intervals, *ray_pass.before.intervals[number])
        return plane, intervals

    def complete(self, ray_pass: RayPass, number: int, image: IntermediateImage) -> None:
        """See ``RayEffect.complete``."""
        if ray_pass.before is None:
            ray_pass.images[number] = image
        else:
            take_like(image, ray_pass.before.images.get(number), ray_pass.alike[number])

    def trace(self, trace, *pixels):
        """See ``RayEffect.trace``; a pixel on a silhouette has a ray for each layer."""
        return trace_layers(self._layers, trace, *pixels, self._scene.region[:2])

    def mix(self, ray_pass: RayPass, picture, found):
        """See ``RayEffect.mix``."""
        mix_layers(self._layers, self._scene.region, ray_pass.region, *picture, *found)
        return picture


def mesh_layers_steps(scene: Scene, view: IndexView, quality: Quality, planes: list[BasePlane]):
    """Generator of fractions done: the depth layers of a scene's meshes.

    Returns
    -------
    DepthLayers or None
        None where no mesh ends any ray inside the volume.
    """
    if not scene.hides_volume:
        return None
    region = _pixels_with_layers(scene, planes)
    samples = _depth_samples(scene, quality, region)
    nearest_mesh = float(samples.min())
    if nearest_mesh > find_volume_depths(scene, view, quality)[1]:
        return None
    if scene.ray_ends is not None and quality.warp_filter == "bilinear":
        surface = samples[..., 0]
        return DepthLayers(surface, surface, None, region[:2])
    voxel = float(np.linalg.norm(view.to_world, axis=0).min())
    return (yield from depth_layers_steps(samples, 0.5 * voxel, region[:2], threads=quality.threads))


def _depth_samples(scene: Scene, quality: Quality, region) -> np.ndarray:
    """(H, W, S) float32: planar depths at which rays of the pixels of a region end, one a pixel of given ray ends."""
    if scene.ray_ends is not None:
        left, top, right, bottom = region
        return np.asarray(scene.ray_ends[top:bottom, left:right, None], np.float32)
    return mesh_depth(scene.triangles, scene.camera, scene.width, scene.height, region=region, threads=quality.threads)


def _pixels_with_layers(scene: Scene, planes: list[BasePlane]) -> tuple[int, int, int, int]:
    """The part of the frame whose depth layers the wanted pixels depend on, and what those depend on in turn."""
    if scene.crop is None:
        return scene.region
    parts = np.array([scene.crop, *(pixels_read(plane) for plane in planes)])
    left, top = np.maximum(parts[:, :2].min(axis=0) - HALO, 0).tolist()
    right, bottom = np.minimum(parts[:, 2:].max(axis=0) + HALO, (scene.width, scene.height)).tolist()
    return left, top, right, bottom


def _judge(scene: Scene, quality: Quality) -> tuple[bool, str]:
    """By the depth of the nearest corner; what the rays really meet is known when they have been looked at."""
    if not scene.hides_volume:
        return False, "the scene has no meshes"
    nearest = np.inf
    if scene.ray_ends is not None:
        left, top, right, bottom = scene.region
        nearest = float(np.min(scene.ray_ends[top:bottom, left:right]))
        if nearest != nearest:
            raise RleSplatError("The scene's ray ends hold a value that is not a number; give inf for no end.")
    view = index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
    furthest = find_volume_depths(scene, view, quality)[1]
    # Beside ray ends triangles cast shadows.
    if nearest <= furthest or _any_before(scene.triangles, depth_row(scene.camera), furthest):
        return True, "meshes are in or in front of the volume"
    if scene.triangles is not None and len(scene.triangles) and (scene.volume_shadows or scene.ambient_occlusion > 0.0):
        return True, "meshes behind the volume shade it"  # from lamps, or the sky, that lie behind them
    return False, BEHIND


def _any_before(triangles, row: np.ndarray, depth: float) -> bool:
    """Whether a corner of (n, 3, 3) triangles is nearer than a depth; few are looked at first, as most often one is."""
    if triangles is None or len(triangles) == 0:
        return False
    corners = np.asarray(triangles, np.float64)
    return any((some @ row[:3]).min() + row[3] <= depth for some in (corners[::SPARSE], corners))


MESH_OCCLUSION = Kind(
    "Let meshes hide the part of the volume behind them, also inside the volume", _judge,
    lambda scene: change(scene, triangles=None, ray_ends=None), stage="occlusion",
)  # fmt: skip
