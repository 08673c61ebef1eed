"""Slices: the volume's values on a plane in any position, and the gray levels of a window.

A plane's own space has x and y from -1 to 1 over its rectangle, and z = 0. A matrix takes it to voxel indices.
"""

from __future__ import annotations

import numpy as np

from ..scene import RleSplatError
from .interpolate import interpolate
from .orientation import nearest_axes
from .volume import PATIENT, Volume

SLICE_NAMES = ("sagittal", "coronal", "axial")  # perpendicular to axis 0, 1, 2 of patient space (LPS)
MOST_ACROSS = 1024  # pixels along each side of a slice
PIXELS_A_STEP = 1 << 16  # interpolated at a time, in about 10 ms
NEAR_EDGE = 1e-3  # voxels: single precision of Blender's matrices must not take a pixel out of the volume


def slice_axis(volume: Volume, name: str) -> int:
    """The voxel axis that an axial, coronal or sagittal slice is perpendicular to.

    Parameters
    ----------
    volume : Volume
    name : {"axial", "coronal", "sagittal"}

    Returns
    -------
    int
        0, 1 or 2. In patient space the voxel axis nearest to the patient's, so that the slice holds the voxels as they
        were acquired. Else z, y or x.
    """
    wanted = SLICE_NAMES.index(name)
    if volume.space != PATIENT:
        return wanted
    return [axis for axis, _ in nearest_axes(volume.affine)].index(wanted)


def slice_matrix(volume: Volume, axis: int) -> np.ndarray:
    """The plane through the middle of a volume, perpendicular to a voxel axis.

    Parameters
    ----------
    volume : Volume
    axis : int
        0, 1 or 2.

    Returns
    -------
    (4, 4) ndarray of float64
        The plane's space to voxel indices. The rectangle covers the whole voxels of one layer, the upper one of the two
        in the middle; z points along the axis, a voxel long.
    """
    counts = np.array(volume.shape_xyz, dtype=np.float64)
    matrix = np.zeros((4, 4))
    for column, along in enumerate(other for other in range(3) if other != axis):
        matrix[along, column] = 0.5 * counts[along]
    matrix[axis, 2] = 1.0
    matrix[:3, 3] = 0.5 * (counts - 1.0)
    matrix[axis, 3] = counts[axis] // 2
    matrix[3, 3] = 1.0
    return matrix


def slice_size(volume: Volume, matrix: np.ndarray, most: int | None = None) -> tuple[int, int]:
    """Pixels of a slice: one for the smallest voxel spacing, at most MOST_ACROSS along each side.

    Parameters
    ----------
    volume : Volume
    matrix : (4, 4) ndarray
        The plane's space to voxel indices.
    most : int, optional
        Pixels of a draft at most; where there would be more, each is larger.

    Returns
    -------
    width, height : int

    Raises
    ------
    RleSplatError
        If the matrix is not finite.
    """
    sides = 2.0 * np.linalg.norm(volume.affine[:3, :3] @ matrix[:3, :2], axis=0) / volume.spacing.min()
    if not np.isfinite(matrix).all():
        raise RleSplatError("The place of a slice is not finite; reset its location, rotation and scale.")
    width, height = (int(np.clip(np.rint(side), 1, MOST_ACROSS)) for side in sides)
    if most is not None and width * height > most:
        share = np.sqrt(most / (width * height))
        width, height = (max(int(share * side), 1) for side in (width, height))
    return width, height


def resample_steps(volume: Volume, matrix: np.ndarray, width: int, height: int):
    """Generator of fractions done: the values of a volume at the pixels of a slice, interpolated linearly.

    Parameters
    ----------
    volume : Volume
    matrix : (4, 4) ndarray
        The plane's space to voxel indices.
    width, height : int
        Pixels.

    Returns
    -------
    values : (height, width) ndarray of float64
        Physical values at the centers of the pixels, 0 outside the volume. Row 0 is at y = 1.
    inside : (height, width) ndarray of bool
        Which pixels lie in the volume: half a voxel beyond the outermost centers at most.
    """
    x = (2.0 * np.arange(width) + 1.0) / width - 1.0
    y = 1.0 - (2.0 * np.arange(height)[:, None] + 1.0) / height
    result, inside = np.zeros((height, width)), np.zeros((height, width), bool)
    rows = max(PIXELS_A_STEP // width, 1)
    for begin in range(0, height, rows):
        band = slice(begin, begin + rows)
        places = [row[0] * x + row[1] * y[band] + row[3] for row in matrix[:3]]
        for place, count in zip(places, volume.shape_xyz):
            for edge in (-0.5, count - 0.5):
                place[np.abs(place - edge) <= NEAR_EDGE] = edge
        values, inside[band] = interpolate(volume.voxels, places)
        result[band][inside[band]] = volume.physical(values)
        yield min(begin + rows, height) / height
    return result, inside


def gray_levels(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Gray levels from 0 to 1 of physical values in a window from ``low`` to ``high``; 0 for NaN."""
    return np.nan_to_num(np.clip((values - low) / (high - low), 0.0, 1.0), nan=0.0)


def cut_polygon(shape_xyz, matrix: np.ndarray) -> np.ndarray:
    """The part of a slice's rectangle that lies in the volume.

    Parameters
    ----------
    shape_xyz : tuple of int
        Number of voxels along x, y and z.
    matrix : (4, 4) ndarray
        The plane's space to voxel indices.

    Returns
    -------
    (n, 2) ndarray of float64
        Corners of a convex polygon in the plane's x and y, in order; n is 0, or 3 and more.
    """
    polygon = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    for row, count in zip(matrix[:3], shape_xyz):
        for sign, bound in ((1.0, 0.5), (-1.0, count - 0.5)):  # sign * index + bound >= 0 in the volume
            room = sign * (polygon @ row[:2] + row[3]) + bound
            polygon = _clip(polygon, np.where(np.abs(room) <= NEAR_EDGE, 0.0, room))
            if len(polygon) == 0:
                return polygon
    return polygon


def _clip(polygon: np.ndarray, room: np.ndarray) -> np.ndarray:
    """The part of a convex polygon where ``room``, linear and known at its corners, is not negative."""
    corners = []
    for i, here in enumerate(room):
        before = room[i - 1]
        if (here < 0.0) != (before < 0.0):
            corners.append(polygon[i - 1] + (polygon[i] - polygon[i - 1]) * (before / (before - here)))
        if here >= 0.0:
            corners.append(polygon[i])
    return np.array(corners) if len(corners) > 2 else np.empty((0, 2))
