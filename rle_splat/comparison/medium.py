"""The medium that all systems draw, classified and shaded once."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..classify.classification import ClassifiedVolume
from ..effects.analyze import analyze_effects
from ..encode.stored import StoredVolume
from ..pipeline.scan_source import classify_and_shade
from ..runtime.jit import need_kernels
from ..runtime.steps import Clock
from ..scene import Quality, RleSplatError, Scene
from ..view.eye import IndexView, index_view
from ..view.principal_axis import dominant_axis

CHANNELS = 4  # of a voxel record: extinction * RGB, extinction


@dataclass(frozen=True, eq=False)
class ShadedScene:
    """A scene with its voxels classified and shaded.

    Attributes
    ----------
    classified : ClassifiedVolume
        The non-transparent voxels.
    colors : (m, 3) float32
        Their shaded, unassociated colors.
    stages_ms : dict
        Milliseconds of classifying and shading, and of making ``field``.
    """

    scene: Scene
    classified: ClassifiedVolume
    colors: np.ndarray
    stages_ms: dict

    @cached_property
    def view(self) -> IndexView:
        """The scene's camera in voxel-index space."""
        return index_view(self.scene.camera, self.scene.index_to_world, self.scene.width, self.scene.height)

    @cached_property
    def indices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Indices z, y, x, each (m,) int64, of the non-transparent voxels."""
        _, ny, nz = self.classified.shape_xyz
        row = np.repeat(np.arange(nz * ny), np.diff(self.classified.row_start))
        return row // ny, row % ny, self.classified.column.astype(np.int64)

    @cached_property
    def field(self) -> np.ndarray:
        """(nz + 2, ny + 2, nx + 2, 4) float32: (extinction * RGB, extinction) of all voxels, 1 / world length.

        One layer of transparent voxels is added on each side, because the medium is zero outside the grid.
        """
        began = time.perf_counter()
        nx, ny, nz = self.classified.shape_xyz
        dense = np.zeros((nz + 2, ny + 2, nx + 2, CHANNELS), np.float32)
        z, y, x = (axis + 1 for axis in self.indices)
        extinction = self.classified.extinction[:, None]
        dense[z, y, x] = np.concatenate((extinction * self.colors, extinction), axis=1)
        self.stages_ms["dense"] = 1e3 * (time.perf_counter() - began)
        return dense

    @property
    def principal_axes(self) -> list[int]:
        """The principal axes (0 x, 1 y, 2 z) of the rays of this view."""
        if self.view.is_parallel:
            return [int(dominant_axis(-self.view.eye[:3])[0])]
        # Two pixels of slack, for the margin of the base planes.
        rows, columns = np.mgrid[-2 : self.view.height + 3, -2 : self.view.width + 3]
        return sorted({int(axis) for axis in np.unique(dominant_axis(self.view.ray_directions(columns, rows))[0])})

    def stored(self, axes: dict) -> Scene:
        """The scene with its volume replaced by run-length tables, for the renderer; the colors include the shading.

        Parameters
        ----------
        axes : dict
            Principal axis -> RunLengthVolume.
        """
        scene = self.scene
        volume = StoredVolume.of(
            axes, scene.volume.affine, scene.volume.unit, self.classified.unit_length,
            scene.transfer_function.to_json(),
        )  # fmt: skip
        return replace(scene, volume=volume, lights=(), headlight=False, effects={})


def scene_medium(scene: Scene, quality: Quality) -> ShadedScene:
    """Classify and shade a scene for comparison; raises RleSplatError for scenes that not all systems can draw."""
    if quality.classification != "pre":
        raise RleSplatError(
            f"The systems are compared on one medium of classified voxels; choose the classification pre, not "
            f"{quality.classification}."
        )
    if not scene.volume.holds_values:
        raise RleSplatError("The systems are compared on voxels; give the volume itself instead of a .rle file.")
    scene = analyze_effects(scene, quality)[1]
    if scene.hides_volume:
        raise RleSplatError("The systems are compared without meshes; take the meshes out of the scene.")
    clock = Clock()
    classified, colors = classify_and_shade(scene, quality, clock)
    return ShadedScene(scene, classified, colors, {name: clock.stages[name] for name in ("classify", "shade")})


def check_plain_view(medium: ShadedScene, title: str) -> None:
    """Raise RleSplatError without numba, for a perspective view, and where the clip distances cut the volume, for a
    compiled system of parallel projection without clipping."""
    need_kernels(title)
    if not medium.view.is_parallel:
        raise RleSplatError(f"{title} is a method of parallel projection; choose an orthographic camera.")
    nearest, furthest = medium.view.box_depths(medium.classified.shape_xyz)
    if nearest < medium.scene.camera.clip_start or furthest > medium.scene.camera.clip_end:
        raise RleSplatError(f"{title} draws whole volumes only; move the clip distances off the volume.")


# --- the rays of all pixels in voxel-index space, as two matrices -----------------------------------------------------


def pixel_frame(view: IndexView) -> tuple[np.ndarray, np.ndarray]:
    """(3, 3) and (3,) float64, A and o, with A @ (x, y, z) + o = (column * h, row * h, depth).

    ``depth`` is planar depth in world units; h is 1 for parallel rays and the depth for perspective ones.
    """
    rows = np.stack((view.projection[0], view.projection[1], view.depth))
    return rows[:, :3], rows[:, 3]


def pixel_rays(view: IndexView) -> tuple[np.ndarray, np.ndarray]:
    """(3, 3) and (3, 3) float64, S and D: the ray through (column, row) is at voxel-index point
    ``S @ (column, row, 1) + depth * (D @ (column, row, 1))`` at planar depth ``depth``."""
    frame, offset = pixel_frame(view)
    inverse = np.linalg.inv(frame)
    fixed = np.stack((np.zeros(3), np.zeros(3), -inverse @ offset), axis=1)
    if not view.is_parallel:
        return fixed, inverse
    start = fixed.copy()
    start[:, :2] = inverse[:, :2]
    step = np.zeros((3, 3))
    step[:, 2] = inverse[:, 2]
    return start, step
