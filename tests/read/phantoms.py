"""Volumes whose stored values encode patient coordinates, so that any reader's array and affine judge each other.

The value of a voxel is 10 times a coordinate of its center in LPS millimeters, plus 2000: writers get the affine, and
whoever reads the file must find each value where it says.
"""

import numpy as np

SHAPE = (9, 7, 5)  # x, y, z; all different, so that no order of axes passes by chance
LEAST_ERROR = 0.1  # mm; values are rounded to 0.05


def rotation(degrees, axis):
    """4x4 rotation about an axis of space."""
    a, b = [i for i in range(3) if i != axis]
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.eye(4)
    matrix[[a, a, b, b], [a, b, a, b]] = c, -s, s, c
    return matrix


def _placed(axes, origin):
    matrix = np.eye(4)
    matrix[:3, :3] = axes
    matrix[:3, 3] = origin
    return matrix


# Voxel indices to LPS millimeters.
AFFINES = {
    "axial": _placed(np.diag((0.8, 0.8, 2.5)), (-30.0, -20.0, 10.0)),
    "mirrored": _placed(np.diag((-0.8, 0.8, 2.5)), (30.0, -20.0, 10.0)),
    "coronal": _placed(np.array([(1.5, 0, 0), (0, 0, 3.0), (0, -1.0, 0)]), (-12.0, 5.0, 40.0)),
    "sagittal": _placed(np.array([(0, 0, 2.0), (1.2, 0, 0), (0, -0.9, 0)]), (-10.0, -50.0, 33.0)),
    "oblique": _placed((rotation(25, 0) @ rotation(-40, 2))[:3, :3] @ np.diag((1.1, 0.9, 3.0)), (7.0, -8.0, 9.0)),
    "sheared": _placed(np.array([(1.0, 0, 0.0), (0, 1.25, 0.9), (0, 0, 3.0)]), (-4.0, 6.0, -20.0)),
}


def coordinates(affine, shape=SHAPE) -> np.ndarray:
    """(3, nx, ny, nz) int16: the encoded coordinate of each voxel along each axis of space."""
    indices = np.indices(shape).reshape(3, -1)
    points = np.asarray(affine)[:3, :3] @ indices + np.asarray(affine)[:3, 3:]
    return np.round(10.0 * points + 2000.0).astype(np.int16).reshape(3, *shape)


def worst_error(volumes) -> float:
    """Largest distance in mm between where three volumes place a voxel and the coordinates that their values state."""
    worst = 0.0
    for axis, volume in enumerate(volumes):
        nz, ny, nx = volume.voxels.shape
        indices = np.indices((nx, ny, nz)).reshape(3, -1)
        point = (volume.affine[:3, :3] @ indices + volume.affine[:3, 3:])[axis].reshape(nx, ny, nz)
        stated = (volume.physical(volume.voxels).transpose(2, 1, 0) - 2000.0) / 10.0
        worst = max(worst, float(np.abs(point - stated).max()))
    return worst


def ras(affine):
    """LPS to RAS, as programs of neuroscience have it."""
    return np.diag((-1.0, -1.0, 1.0, 1.0)) @ affine
