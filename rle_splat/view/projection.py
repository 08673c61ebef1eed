"""Projection of a camera: world points to homogeneous pixels, as in Blender."""

from functools import lru_cache

import numpy as np

from ..scene import Camera
from ..volume.triples import cross, dot, unit


@lru_cache(maxsize=8)
def world_to_camera(camera: Camera) -> np.ndarray:
    """(4, 4) float64 read-only matrix from world to camera space (looking along -Z).

    The columns of ``matrix_world`` are normalized first, because Blender ignores the scale of a camera and its parents.
    Kept for the latest cameras, each of which is asked for several times a frame.
    """
    *axes, place = (column[:3] for column in camera.matrix_world.T.tolist())
    right, up, back = map(unit, axes)
    rows = cross(up, back), cross(back, right), cross(right, up)
    volume = dot(right, rows[0])
    inverse = [[part / volume for part in row] for row in rows]
    found = np.array([*([*row, -dot(row, place)] for row in inverse), (0.0, 0.0, 0.0, 1.0)])
    found.flags.writeable = False
    return found


def depth_row(camera: Camera) -> np.ndarray:
    """(4,) float64: world point (x, y, z, 1) to planar distance ahead of the camera, world units."""
    return -world_to_camera(camera)[2]


def find_fitted_side(camera: Camera, width: int, height: int) -> float:
    """Length of the side of the picture that determines the scale, in pixel widths; shifts are fractions of it.

    For a vertical fit, rows are weighted by the height of a pixel.
    """
    aspect_x, aspect_y = camera.pixel_aspect
    fit = camera.sensor_fit
    if fit == "AUTO":
        fit = "HORIZONTAL" if width * aspect_x >= height * aspect_y else "VERTICAL"
    return width if fit == "HORIZONTAL" else height * (aspect_y / aspect_x)


def world_to_pixel(camera: Camera, width: int, height: int) -> np.ndarray:
    """(3, 4) float64 matrix from world (x, y, z, 1) to homogeneous pixel (column, row, 1).

    Row 0 is at the top; pixel (c, r) covers [c, c+1) x [r, r+1). Sensor fit, shift and pixel aspect follow Blender: the
    fitted side determines the scale, the shift is a fraction of that side, and the sensor height is used only for the
    sensor fit VERTICAL. Points off the focus plane are moved by ``slant``.

    Parameters
    ----------
    width, height : int
        Size of the picture in pixels.

    Returns
    -------
    (3, 4) ndarray of float64
        The third component is the planar depth for a perspective camera and 1 for an orthographic one.
    """
    aspect_x, aspect_y = camera.pixel_aspect
    tallness = aspect_y / aspect_x  # height of a pixel in widths of a pixel
    fitted = find_fitted_side(camera, width, height)
    sensor = camera.sensor_height if camera.sensor_fit == "VERTICAL" else camera.sensor_width
    across = camera.ortho_scale if camera.type == "ORTHO" else sensor / camera.lens
    pixel = across / fitted  # width of a pixel: world units, or per unit of depth
    center_column = 0.5 * width - camera.shift_x * fitted
    center_row = 0.5 * height + camera.shift_y * fitted / tallness

    # In plain Python: for rows of four numpy's overhead per call is larger.
    right, up, back, _ = world_to_camera(camera).tolist()
    ahead = [-part for part in back]
    if camera.focus_distance is not None and any(camera.slant):
        beyond = (*ahead[:3], ahead[3] - camera.focus_distance)
        right, up = ([a - slant * b for a, b in zip(one, beyond)] for one, slant in zip((right, up), camera.slant))
    weight = ahead if camera.type == "PERSP" else (0.0, 0.0, 0.0, 1.0)
    return np.array((
        [a / pixel + center_column * b for a, b in zip(right, weight)],
        [-a / (pixel * tallness) + center_row * b for a, b in zip(up, weight)],
        weight,
    ))  # fmt: skip
