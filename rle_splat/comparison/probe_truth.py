"""The truth T1 of a medium at probe pixels, from the cells that their rays cross."""

import numpy as np

from ..accuracy.integrate import integrate
from ..accuracy.medium import ClassifiedField
from ..accuracy.probes import draw_pixels
from ..accuracy.rays import camera_rays
from ..accuracy.transfer import extinction_and_color
from ..accuracy.truths import world_opacity_distance
from .medium import ShadedScene

TOLERANCE = 1e-7  # far below a level, 1/255
_CORNERS = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)])


class SparseMedium(ClassifiedField):
    """T1's medium without a classified copy of the volume.

    Extinction and unshaded color are computed from the transfer function's points at the corners of the cells that
    rays cross.  Shaded colors are those of the medium that the systems draw.
    """

    def __init__(self, medium: ShadedScene):
        self._scene = medium.scene
        self._distance = world_opacity_distance(medium.scene)
        self._shape = np.array(medium.classified.shape_xyz)
        self.low, self.high = np.full(3, -1.0), self._shape.astype(np.float64)
        self._colors = None
        if medium.colors is not medium.classified.color:
            z, y, x = medium.indices
            self._colors, self._indices = medium.colors, (z * self._shape[1] + y) * self._shape[0] + x

    def cells(self, cell: np.ndarray) -> np.ndarray:
        """(P, 8, 4) extinction * RGB and extinction at the corners of cells; ``cell`` (P, 3): low corners x, y, z."""
        at = cell[:, None, :] + _CORNERS
        inside = ((at >= 0) & (at < self._shape)).all(axis=-1)
        x, y, z = np.moveaxis(np.clip(at, 0, self._shape - 1), -1, 0)
        volume = self._scene.volume
        values = volume.physical(volume.voxels[z, y, x])
        extinction, color = extinction_and_color(self._scene.transfer_function, values, self._distance)
        extinction = np.where(inside, extinction, 0.0)
        if self._colors is not None and len(self._indices):
            found = np.searchsorted(self._indices, (z * self._shape[1] + y) * self._shape[0] + x)
            color = self._colors[np.minimum(found, len(self._indices) - 1)]
        return np.concatenate((color * extinction[..., None], extinction[..., None]), axis=-1)


def probe_truth(medium: ShadedScene, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns and rows of about ``count`` random pixels, one in each cell of a grid, and their truth (N, 4) float64."""
    scene = medium.scene
    columns, rows = draw_pixels(scene.width, scene.height, count, seed)
    rays = camera_rays(scene.camera, scene.width, scene.height, columns + 0.5, rows + 0.5)
    limits = (scene.camera.clip_start, scene.camera.clip_end)
    rgba, _ = integrate(SparseMedium(medium), rays, scene.index_to_world, *limits, TOLERANCE)
    return columns, rows, rgba
