"""The truth T1 of a medium at probe pixels, from the cells that their rays cross."""

import numpy as np

from ..accuracy.integrate import integrate
from ..accuracy.medium import ClassifiedField
from ..accuracy.probes import draw_pixels
from ..accuracy.rays import camera_rays
from ..accuracy.transfer import world_opacity_distance
from .medium import ShadedScene

TOLERANCE = 1e-7  # far below a level, 1/255


class _ShadedColors:
    """The colors of the medium that the systems draw, looked up by index arrays (z, y, x) of visible voxels."""

    def __init__(self, medium: ShadedScene):
        self._shape, self._colors = medium.scene.volume.voxels.shape, medium.colors
        self._places = np.ravel_multi_index(medium.indices, self._shape)

    def __getitem__(self, indices) -> np.ndarray:
        wanted = np.ravel_multi_index(np.broadcast_arrays(*indices), self._shape)
        return self._colors[np.minimum(np.searchsorted(self._places, wanted), len(self._places) - 1)]


def _field(medium: ShadedScene) -> ClassifiedField:
    """T1's medium, classified by the transfer function's points where rays cross cells, shaded as the systems are."""
    scene, volume = medium.scene, medium.scene.volume
    is_shaded = medium.colors is not medium.classified.color and len(medium.colors)
    colors = _ShadedColors(medium) if is_shaded else None
    distance = world_opacity_distance(scene)
    return ClassifiedField.of_scalars(volume.voxels, volume.physical, scene.transfer_function, distance, colors)


def probe_truth(medium: ShadedScene, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns and rows of about ``count`` random pixels, one in each cell of a grid, and their truth (N, 4) float64."""
    scene = medium.scene
    columns, rows = draw_pixels(scene.width, scene.height, count, seed)
    rays = camera_rays(scene.camera, scene.width, scene.height, columns + 0.5, rows + 0.5)
    limits = (scene.camera.clip_start, scene.camera.clip_end)
    rgba, _ = integrate(_field(medium), rays, scene.index_to_world, *limits, TOLERANCE)
    return columns, rows, rgba
