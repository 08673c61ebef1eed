"""Camera -> projection: world points to homogeneous pixels, exactly as Blender's camera does."""

from __future__ import annotations

import numpy as np

from ..scene import Camera


def world_to_camera(camera: Camera) -> np.ndarray:
    """(4, 4) float64: world to camera space (looking along -Z).

    The columns of ``matrix_world`` are normalised first: Blender ignores the scale of a camera and of its parents.
    """
    placed = np.array(camera.matrix_world)
    lengths = np.linalg.norm(placed[:3, :3], axis=0)
    placed[:3, :3] /= np.where(lengths > 0.0, lengths, 1.0)
    return np.linalg.inv(placed)


def depth_row(camera: Camera) -> np.ndarray:
    """(4,) float64: the row that takes a world point to its planar distance ahead of the camera, world units."""
    return -world_to_camera(camera)[2]


def fitted_pixels(camera: Camera, width: int, height: int) -> float:
    """The side of the picture that decides the scale, in widths of a pixel; shifts are fractions of it.

    A vertical fit counts rows by how tall a pixel is.
    """
    aspect_x, aspect_y = camera.pixel_aspect
    fit = camera.sensor_fit
    if fit == "AUTO":
        fit = "HORIZONTAL" if width * aspect_x >= height * aspect_y else "VERTICAL"
    return width if fit == "HORIZONTAL" else height * (aspect_y / aspect_x)


def world_to_pixel(camera: Camera, width: int, height: int) -> np.ndarray:
    """(3, 4) float64: world (x, y, z, 1) to homogeneous pixel (column, row, 1).

    Row 0 is on top; pixel (c, r) covers [c, c+1) x [r, r+1).  The third component is the planar depth for a
    perspective camera and 1 for an orthographic one.  Sensor fit, shift and pixel aspect follow Blender: the
    fitted side decides the scale, the shift is in fractions of that side, and a vertical fit uses the sensor
    height only when it is asked for by name.  What lies before or behind the plane of focus moves by ``slant``.
    """
    aspect_x, aspect_y = camera.pixel_aspect
    tallness = aspect_y / aspect_x  # height of a pixel in widths of a pixel
    fitted = fitted_pixels(camera, width, height)
    sensor = camera.sensor_height if camera.sensor_fit == "VERTICAL" else camera.sensor_width
    across = camera.ortho_scale if camera.type == "ORTHO" else sensor / camera.lens
    pixel = across / fitted  # width of a pixel: world units, or per unit of depth
    centre_column = 0.5 * width - camera.shift_x * fitted
    centre_row = 0.5 * height + camera.shift_y * fitted / tallness

    to_camera = world_to_camera(camera)
    right, up, ahead = to_camera[0], to_camera[1], -to_camera[2]
    if camera.type == "ORTHO":
        beyond = ahead - np.array((0.0, 0.0, 0.0, camera.focus_distance))
        right, up = right - camera.slant[0] * beyond, up - camera.slant[1] * beyond
    weight = ahead if camera.type == "PERSP" else np.array((0.0, 0.0, 0.0, 1.0))
    return np.stack((
        right / pixel + centre_column * weight,
        -up / (pixel * tallness) + centre_row * weight,
        weight,
    ))
