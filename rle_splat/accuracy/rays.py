"""Cameras of the truths: from Blender's camera fields to world rays.

Nothing here is shared with ``rle_splat.view``, so that a mistake in one of them shows as a difference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..scene import Camera


@dataclass(frozen=True, eq=False)
class WorldRays:
    """N world rays, parametrized by planar depth (distance along the camera's axis).

    Attributes
    ----------
    origin : (N, 3) float64
        World point at depth 0.
    direction : (N, 3) float64
        Unit world vectors.
    length_per_depth : (N,) float64
        World length of the ray per unit of planar depth, at least 1 for a rigid camera.
    """

    origin: np.ndarray
    direction: np.ndarray
    length_per_depth: np.ndarray

    @property
    def step(self) -> np.ndarray:
        """(N, 3) world displacement per unit of planar depth."""
        return self.direction * self.length_per_depth[:, None]

    def at_depth(self, depth) -> np.ndarray:
        """(N, 3) world points at the given planar depths."""
        return self.origin + self.step * np.broadcast_to(depth, self.length_per_depth.shape)[:, None]

    def __getitem__(self, chosen) -> WorldRays:
        return WorldRays(self.origin[chosen], self.direction[chosen], self.length_per_depth[chosen])


def pixel_centers(width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Column and row coordinates of all pixel centers, row by row from the top, each (H * W,) float64."""
    rows, columns = np.mgrid[0:height, 0:width]
    return columns.ravel() + 0.5, rows.ravel() + 0.5


def rigid(matrix_world) -> np.ndarray:
    """The matrix with its first three columns normalized: Blender ignores a camera's scale."""
    matrix = np.array(matrix_world, dtype=np.float64)
    matrix[:3, :3] /= np.sqrt((matrix[:3, :3] ** 2).sum(axis=0))
    return matrix


def camera_rays(camera: Camera, width: int, height: int, columns=None, rows=None) -> WorldRays:
    """Rays of a camera through pixel positions.

    Blender's rules: the sensor fits the wider side of the image *with* its pixel aspect (AUTO), or the named side.
    That side's size in pixels is the unit of the lens shift.  AUTO always uses the sensor's width.

    Parameters
    ----------
    width, height : int
        Of the picture, in pixels.
    columns, rows : (N,) float, optional
        From the left and the top, pixel centers at + 0.5; all pixel centers by default.
    """
    if columns is None:
        columns, rows = pixel_centers(width, height)
    columns, rows = np.broadcast_arrays(np.asarray(columns, np.float64), np.asarray(rows, np.float64))
    columns, rows = columns.ravel(), rows.ravel()
    tallness = camera.pixel_aspect[1] / camera.pixel_aspect[0]  # height of a pixel in pixel widths
    fit = camera.sensor_fit
    if fit == "AUTO":
        fits_across = width * camera.pixel_aspect[0] >= height * camera.pixel_aspect[1]
        sensor = camera.sensor_width
    else:
        fits_across = fit == "HORIZONTAL"
        sensor = camera.sensor_width if fits_across else camera.sensor_height
    fitted_side = width if fits_across else height * tallness
    full = camera.ortho_scale if camera.type == "ORTHO" else sensor / camera.lens
    right = (columns - 0.5 * width + camera.shift_x * fitted_side) * (full / fitted_side)
    up = ((0.5 * height - rows) * tallness + camera.shift_y * fitted_side) * (full / fitted_side)
    zero, ahead = np.zeros_like(right), -np.ones_like(right)
    if camera.type == "ORTHO":
        start, step = np.stack((right, up, zero), -1), np.stack((zero, zero, ahead), -1)
    else:
        start, step = np.zeros((right.size, 3)), np.stack((right, up, ahead), -1)
    matrix = rigid(camera.matrix_world)
    step = step @ matrix[:3, :3].T
    length = np.sqrt((step**2).sum(axis=1))
    return WorldRays(start @ matrix[:3, :3].T + matrix[:3, 3], step / length[:, None], length)
