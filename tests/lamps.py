"""Lamps of every kind, to light small volumes with."""

import numpy as np

from rle_splat.scene import Light


def placed(x, y, z, **fields):
    """A light there, which shines along -x, -y and z in equal parts."""
    axis = np.array((1.0, 1.0, -1.0)) / np.sqrt(3.0)
    right = np.cross((0.0, 0.0, 1.0), axis) / np.linalg.norm(np.cross((0.0, 0.0, 1.0), axis))
    matrix = np.eye(4)
    matrix[:3] = np.stack((right, np.cross(axis, right), axis, (x, y, z)), axis=1)
    return Light(matrix_world=matrix, color=(1.0, 0.7, 0.4), **fields)


def pose(position=(0, 0, 0), shines_along=(0, 0, -1), scale=1.0):
    """A light's matrix: -Z turned to ``shines_along``."""
    back = -np.asarray(shines_along, float) / np.linalg.norm(shines_along)
    side = np.cross((0.3, 1.0, 0.2), back)
    side /= np.linalg.norm(side)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack((side, np.cross(back, side), back), axis=1) * scale
    matrix[:3, 3] = position
    return matrix


def sun(along, **fields):
    return Light("SUN", matrix_world=pose(shines_along=along), **fields)


def point(position, **fields):
    return Light("POINT", matrix_world=pose(position), **fields)


LAMPS = {
    "sun": placed(0, 0, 0, type="SUN", energy=3.0),
    "point": placed(9.0, 4.0, -5.0, type="POINT", energy=2000.0),
    "spot": placed(9.0, 6.0, -5.0, type="SPOT", energy=9000.0, spot_size=1.5, spot_blend=0.4),
    "area": placed(9.0, 4.0, -5.0, type="AREA", energy=900.0, size=2.0),
    "inside": placed(1.0, 0.5, 0.0, type="POINT", energy=90.0),
}
