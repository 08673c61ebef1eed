"""Geometry of a stack of slices, as pure functions: order, steps, gaps and the affine, all in LPS millimeters.

The third column of the affine is (last - first) / steps, from ImagePositionPatient alone. So a tilted gantry becomes a
sheared affine, exactly. SliceThickness, SpacingBetweenSlices and GantryDetectorTilt are nominal and are not used.

Numbers of files are rounded, or jitter. No tolerance here is a rounding: what is close is never parted by a border.
"""

from dataclasses import dataclass

import numpy as np

from .refusals import Refused

SAME_PLACE = 2e-3  # mm; positions closer than this are the same
EVEN_FRACTION, EVEN_MM = 0.05, 0.01  # a slice may be this far from an even step, in steps or in mm, and at most
MOST_MM = 0.1  # this far; slices further from the straight line through the first and the last are no stack
MOST_PIXELS = 3.0  # corners of slices may be this far from where the common directions and spacings put them
MOST_TIMES = 8  # a stack is resampled to at most this many times its slices
FRACTIONS_OF_GAP = (1, 2)  # the step of a stack with missing slices: the smallest gap over one of these
UNIT_TOLERANCE = 1e-2  # direction cosines may be this far from orthonormal


@dataclass(frozen=True)
class Stack:
    """How sorted slices make a regular grid.

    Attributes
    ----------
    affine : (4, 4) ndarray
        Voxel index (column, row, slice) to LPS millimeters.
    below : (slices,) ndarray of int64
        For each slice of the grid, the file's slice at or before it.
    weight : (slices,) ndarray of float64
        Share of the file's slice ``below + 1``, in [0, 1).
    kind : {"even", "missing", "irregular"}
    moved : float
        No pixel of a slice in the file is further from its place in the grid, in mm. Slices at irregular distances are
        resampled, so of their positions only what is across their line counts.
    """

    affine: np.ndarray
    below: np.ndarray
    weight: np.ndarray
    kind: str
    moved: float = 0.0

    @property
    def slices(self) -> int:
        """Number of slices of the grid."""
        return len(self.below)

    @property
    def filled(self) -> np.ndarray:
        """Indices of slices that are interpolated."""
        return np.flatnonzero(self.weight > 0.0)


def axes(orientation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions of a row, of a column and of their cross product.

    Parameters
    ----------
    orientation : (6,) array_like
        ImageOrientationPatient.

    Returns
    -------
    row, column, normal : (3,) ndarray

    Raises
    ------
    Refused
        If the directions are not two perpendicular unit vectors.
    """
    row, column = np.asarray(orientation, dtype=np.float64).reshape(2, 3)
    sizes = np.array([row @ row - 1.0, column @ column - 1.0, row @ column])
    if not np.all(np.abs(sizes) < UNIT_TOLERANCE):
        raise Refused("The directions of rows and columns are not perpendicular unit vectors; export the series again.")
    return row, column, np.cross(row, column)


def sort_along(positions, normal) -> np.ndarray:
    """Indices that sort positions (n, 3) along ``normal``; equal ones keep their order."""
    return np.argsort(np.asarray(positions, dtype=np.float64) @ normal, kind="stable")


def parts_at_gaps(points, gap: float) -> np.ndarray:
    """Number of the part of each point; parts are separated by a gap in one coordinate or several.

    Points of different parts differ by more than ``gap`` in some coordinate. Points that differ by at most ``gap`` in
    each coordinate are in one part, whatever their order and wherever they lie.

    Parameters
    ----------
    points : (n, d) array_like

    Returns
    -------
    (n,) ndarray of int64
        Ascending along the first coordinate.
    """
    points = np.asarray(points, dtype=np.float64)
    found, count = np.zeros(len(points), dtype=np.int64), 0
    while True:
        for coordinate in points.T:
            order = np.lexsort((coordinate, found))
            begins = (np.diff(found[order]) > 0) | (np.diff(coordinate[order]) > gap)
            found[order] = np.concatenate([[0], np.cumsum(begins)])
        if found.max() == count:
            return found
        count = found.max()


def places(positions, normal) -> np.ndarray:
    """Number of the place of each position, counted along ``normal``; positions at one place share a number.

    Parameters
    ----------
    positions : (n, 3) array_like
    normal : (3,) ndarray

    Returns
    -------
    (n,) ndarray of int64
    """
    positions = np.asarray(positions, dtype=np.float64)
    return parts_at_gaps(np.column_stack([positions @ normal, positions]), SAME_PLACE)


def parallel_lines(positions, row, column) -> np.ndarray:
    """Number of the line, along the normal, that each position is on.

    All numbers are 0 if the positions are on one straight line, of any direction. Otherwise positions with equal
    offsets within the slice share a number.
    """
    positions = np.asarray(positions, dtype=np.float64)
    if _off_line(positions[sort_along(positions, np.cross(row, column))]) <= MOST_MM:
        return np.zeros(len(positions), dtype=np.int64)
    return parts_at_gaps(np.stack([positions @ row, positions @ column], axis=1), MOST_MM)


def common_orientation(orientations) -> np.ndarray:
    """ImageOrientationPatient (6,) of slices (n, 6) that differ by little: the median, which one odd slice leaves."""
    return np.median(np.asarray(orientations, dtype=np.float64), axis=0)


def stack(positions, orientations, spacings, size) -> Stack:
    """Find the regular grid of slices.

    Parameters
    ----------
    positions : (n, 3) array_like
        ImagePositionPatient, sorted along the normal, at least two.
    orientations : (m, 6) array_like
        ImageOrientationPatient of pictures; the grid has their median.
    spacings : (m, 2) array_like
        PixelSpacing of pictures: distance between rows, then between columns; the grid has their median.
    size : (rows, columns)

    Raises
    ------
    Refused
        If the slices lie on no straight line, the line is within their plane, or their directions or pixel spacings
        differ by more than MOST_PIXELS at their corners.
    """
    positions = np.asarray(positions, dtype=np.float64)
    spacing = np.median(np.asarray(spacings, dtype=np.float64), axis=0)
    row, column, normal = axes(common_orientation(orientations))
    whole = positions[-1] - positions[0]
    length = float(np.linalg.norm(whole))
    if whole @ normal <= 1e-3 * length or np.diff(positions @ normal).min() <= SAME_PLACE:
        raise Refused("Slices of this series lie in one plane; a volume needs slices at different depths.")
    off_line = _off_line(positions)
    if off_line > MOST_MM:
        raise Refused(
            f"The slices of this series are up to {off_line:.2f} mm off a straight line; choose a series with parallel "
            "slices one above the other."
        )
    corners = _corners(orientations, spacings, size) - _corners([(*row, *column)], [spacing], size)
    turned = float(np.linalg.norm(corners, axis=2).max())
    if turned > MOST_PIXELS * spacing.max():
        raise Refused(
            f"The slices of this series turn or scale, so that their corners are up to {turned:.2f} mm off; choose a "
            "series with parallel slices of one pixel spacing."
        )
    along = (positions - positions[0]) @ normal * (length / (whole @ normal))
    kind, steps = _steps(along)
    affine = np.eye(4)
    affine[:3, 0] = row * spacing[1]
    affine[:3, 1] = column * spacing[0]
    affine[:3, 2] = whole / steps
    affine[:3, 3] = positions[0]
    numbers = along * steps / length
    if kind != "irregular":
        numbers = np.round(numbers)
    moves = positions - positions[0] - numbers[:, None] * affine[:3, 2]
    moved = float(np.linalg.norm(moves, axis=1).max())
    return Stack(affine, *_weights(numbers, steps), kind, moved + turned)


def _corners(orientations, spacings, size) -> np.ndarray:
    """(m, 3, 3): from the first pixel of each picture to its other corners, in mm."""
    edges = np.asarray(spacings, dtype=np.float64) * (np.asarray(size) - 1)
    row, column = np.moveaxis(np.asarray(orientations, dtype=np.float64).reshape(-1, 2, 3) * edges[:, ::-1, None], 1, 0)
    return np.stack([row, column, row + column], axis=1)


def stack_without_positions(count: int, spacing) -> Stack:
    """The grid of ``count`` slices whose files say no positions; ``spacing``: (sx, sy, sz) in mm."""
    return Stack(np.diag((*spacing, 1.0)), np.arange(count), np.zeros(count), "even")


def _off_line(positions) -> float:
    """Largest distance of sorted positions (n, 3) from the straight line through the first and the last."""
    whole = positions[-1] - positions[0]
    length = np.linalg.norm(whole)
    if length == 0.0:
        return 0.0
    return float(np.linalg.norm(np.cross(positions - positions[0], whole / length), axis=1).max())


def _tolerance(step: float) -> float:
    """How far a slice may be from an even step; a gap of two steps is never taken for one."""
    return min(max(EVEN_FRACTION * step, min(EVEN_MM, step / 4.0)), MOST_MM)


def _steps(along) -> tuple[str, int]:
    """Kind of a stack and its number of steps, from distances (n,) along the line, ascending from 0."""
    count, length = len(along), float(along[-1])
    gaps = np.diff(along)
    if np.abs(along - np.linspace(0.0, length, count)).max() <= _tolerance(length / (count - 1)):
        return "even", count - 1
    smallest = gaps.min()
    smallest = float(gaps[gaps <= smallest + 2.0 * _tolerance(smallest)].mean())
    for fraction in FRACTIONS_OF_GAP:
        each = np.round(gaps * fraction / smallest)  # gap by gap, so that jitter does not add up
        steps = int(each.sum())
        if steps >= MOST_TIMES * count:
            break
        off = along[1:] - np.cumsum(each) * length / steps
        if each.min() >= 1 and np.abs(off).max() <= _tolerance(length / steps):
            return "missing", steps
    steps = int(np.ceil(length / smallest * (1.0 - 1e-9)))
    return "irregular", min(steps, MOST_TIMES * count - 1)


def _weights(numbers, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """``below`` and ``weight`` of Stack; ``numbers`` (n,): the places of the file's slices in the grid."""
    grid = np.arange(steps + 1, dtype=np.float64)
    below = np.clip(np.searchsorted(numbers, grid + 1e-9, side="right") - 1, 0, len(numbers) - 1)
    after = np.minimum(below + 1, len(numbers) - 1)
    gap = np.where(after > below, numbers[after] - numbers[below], 1.0)
    weight = np.clip((grid - numbers[below]) / gap, 0.0, 1.0)
    weight[weight < 1e-9] = 0.0
    return below.astype(np.int64), weight
