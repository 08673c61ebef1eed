"""Slices: the volume's values on a plane in any position, and the gray levels of a window.

A plane's own space has x and y from -1 to 1 over its rectangle, and z = 0. A matrix takes it to voxel indices.
"""

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


def slice_size(volume: Volume, matrix: np.ndarray, most: int | None = None, finer: float = 1.0) -> tuple[int, int]:
    """Pixels of a slice: so many for the smallest voxel spacing, at most MOST_ACROSS along each side.

    Parameters
    ----------
    matrix : (4, 4) ndarray
        The plane's space to voxel indices.
    most : int, optional
        Pixels of a draft at most; where there would be more, each is larger.
    finer : float
        Pixels along the smallest voxel spacing.

    Returns
    -------
    width, height : int

    Raises
    ------
    RleSplatError
        If the matrix is not finite.
    """
    sides = 2.0 * finer * np.linalg.norm(volume.affine[:3, :3] @ matrix[:3, :2], axis=0) / volume.spacing.min()
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


def positive_part(levels: np.ndarray) -> np.ndarray:
    """The part of a slice where its levels, interpolated linearly between pixels, are above 0.

    Each square between four pixels is two triangles, and each of these is clipped where its level is 0.

    Parameters
    ----------
    levels : (height, width) ndarray of float
        At the centers of the pixels, row 0 at y = 1; constant beyond the outermost centers.

    Returns
    -------
    (n, 3, 2) ndarray of float64
        Triangles in the plane's x and y.
    """
    height, width = levels.shape
    x = np.clip((2.0 * np.arange(-1, width + 1) + 1.0) / width - 1.0, -1.0, 1.0)
    y = np.clip(1.0 - (2.0 * np.arange(-1, height + 1) + 1.0) / height, -1.0, 1.0)
    levels = np.pad(levels, 1, mode="edge")
    above = levels > 0.0
    four = above[:-1, :-1].astype(np.int8) + above[:-1, 1:] + above[1:, :-1] + above[1:, 1:]
    steps = np.diff(np.pad(four == 4, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    (rows, begin), (_, end) = np.nonzero(steps == 1), np.nonzero(steps == -1)  # rows of whole squares
    pieces = [_triangle(x, y, (rows, begin), (rows + 1, begin), (rows, end)),
              _triangle(x, y, (rows + 1, end), (rows, end), (rows + 1, begin))]  # fmt: skip
    row, column = np.nonzero((four > 0) & (four < 4))
    corner, below, beside, far = (row, column), (row + 1, column), (row, column + 1), (row + 1, column + 1)
    for half in ((corner, below, beside), (far, beside, below)):
        pieces += _clip_triangles(_triangle(x, y, *half), np.stack([levels[at] for at in half], axis=1))
    return np.concatenate(pieces)


def _triangle(x: np.ndarray, y: np.ndarray, *corners) -> np.ndarray:
    """(n, 3, 2) triangles from three pairs of n rows and n columns."""
    return np.stack([np.stack((x[column], y[row]), axis=1) for row, column in corners], axis=1)


def _clip_triangles(triangles: np.ndarray, levels: np.ndarray) -> list[np.ndarray]:
    """The parts of (n, 3, 2) triangles where the level, linear and known at their corners, is above 0."""
    above = levels > 0.0
    parts = [triangles[above.all(axis=1)]]
    for alone in (above, ~above):  # one corner differs from the other two
        chosen = alone.sum(axis=1) == 1
        order = (np.argmax(alone[chosen], axis=1)[:, None] + np.arange(3)) % 3
        one, second, third = np.moveaxis(np.take_along_axis(triangles[chosen], order[..., None], 1), 1, 0)
        at_one, at_second, at_third = np.take_along_axis(levels[chosen], order, 1).T
        to_second = one + (second - one) * (at_one / (at_one - at_second))[:, None]
        to_third = one + (third - one) * (at_one / (at_one - at_third))[:, None]
        quad = (to_second, second, third, to_third) if alone is not above else (one, to_second, to_third)
        parts += [np.stack((quad[0], quad[n], quad[n + 1]), axis=1) for n in range(1, len(quad) - 1)]
    return parts


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
