"""Geometry of a stack of slices, as pure functions: order, steps, gaps and the affine, all in LPS millimeters.

The third column of the affine is (last - first) / steps, from ImagePositionPatient alone. So a tilted gantry becomes a
sheared affine, exactly. SliceThickness, SpacingBetweenSlices and GantryDetectorTilt are nominal and are not used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .refusals import Refused

SAME_PLACE = 2e-3  # mm; positions closer than this are the same
EVEN_MM, EVEN_FRACTION = 0.01, 0.01  # a slice may be this far from an even step, in mm and in steps
OFF_LINE_MM = 0.1  # slices further from the straight line through the first and the last are no stack
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
    off_line : float
        Largest distance of a slice from the straight line, in mm.
    """

    affine: np.ndarray
    below: np.ndarray
    weight: np.ndarray
    kind: str
    off_line: float = 0.0

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


def sorted_along(positions, normal) -> np.ndarray:
    """Indices that sort positions (n, 3) along ``normal``; equal ones keep their order."""
    return np.argsort(np.asarray(positions, dtype=np.float64) @ normal, kind="stable")


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
    order = np.lexsort((*np.round(positions / SAME_PLACE).T, np.round(positions @ normal / SAME_PLACE)))
    found = np.empty(len(positions), dtype=np.int64)
    number, before = -1, None
    for i in order:
        if before is None or np.linalg.norm(positions[i] - before) > SAME_PLACE:
            number += 1
            before = positions[i]
        found[i] = number
    return found


def parallel_lines(positions, row, column) -> np.ndarray:
    """Number of the line, along the normal, that each position is on.

    All numbers are 0 if the positions are on one straight line, of any direction. Otherwise positions with equal
    offsets within the slice share a number.
    """
    positions = np.asarray(positions, dtype=np.float64)
    if _off_line(positions[sorted_along(positions, np.cross(row, column))]) <= OFF_LINE_MM:
        return np.zeros(len(positions), dtype=np.int64)
    offsets = np.round(np.stack([positions @ row, positions @ column], axis=1) / OFF_LINE_MM)
    return np.unique(offsets, axis=0, return_inverse=True)[1].reshape(-1)


def stack(positions, orientation, spacing) -> Stack:
    """Find the regular grid of slices.

    Parameters
    ----------
    positions : (n, 3) array_like
        ImagePositionPatient, sorted along the normal, at least two.
    orientation : (6,) array_like
    spacing : (2,) array_like
        PixelSpacing: distance between rows, then between columns.

    Returns
    -------
    Stack

    Raises
    ------
    Refused
        If the slices lie on no straight line, or the line is within their plane.
    """
    positions = np.asarray(positions, dtype=np.float64)
    row, column, normal = axes(orientation)
    whole = positions[-1] - positions[0]
    length = float(np.linalg.norm(whole))
    if whole @ normal <= 1e-3 * length:
        raise Refused("The slices of this series lie in one plane; a volume needs slices at different depths.")
    off_line = _off_line(positions)
    if off_line > OFF_LINE_MM:
        raise Refused(
            f"The slices of this series are up to {off_line:.2f} mm off a straight line; choose a series with parallel "
            "slices one above the other."
        )
    along = (positions - positions[0]) @ normal * (length / (whole @ normal))
    kind, steps = _steps(along)
    affine = np.eye(4)
    affine[:3, 0] = row * spacing[1]
    affine[:3, 1] = column * spacing[0]
    affine[:3, 2] = whole / steps
    affine[:3, 3] = positions[0]
    below, weight = _weights(along, steps, kind)
    return Stack(affine, below, weight, kind, off_line)


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
    return max(EVEN_MM, EVEN_FRACTION * step)


def _steps(along) -> tuple[str, int]:
    """Kind of a stack and its number of steps, from distances (n,) along the line, ascending from 0."""
    count, length = len(along), float(along[-1])
    gaps = np.diff(along)
    if np.abs(along - np.linspace(0.0, length, count)).max() <= _tolerance(length / (count - 1)):
        return "even", count - 1
    smallest = gaps.min()
    smallest = float(gaps[gaps <= smallest + 2.0 * _tolerance(smallest)].mean())
    for fraction in FRACTIONS_OF_GAP:
        steps = round(length * fraction / smallest)
        if steps >= MOST_TIMES * count:
            break
        step = length / steps
        numbers = np.round(along / step)
        if np.diff(numbers).min() >= 1 and np.abs(along - numbers * step).max() <= _tolerance(step):
            return "missing", steps
    steps = int(np.ceil(length / smallest * (1.0 - 1e-9)))
    return "irregular", min(steps, MOST_TIMES * count - 1)


def _weights(along, steps: int, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """``below`` and ``weight`` of Stack."""
    step = float(along[-1]) / steps
    if kind != "irregular":
        numbers = np.round(along / step)
    else:
        numbers = along / step
    grid = np.arange(steps + 1, dtype=np.float64)
    below = np.clip(np.searchsorted(numbers, grid + 1e-9, side="right") - 1, 0, len(along) - 1)
    after = np.minimum(below + 1, len(along) - 1)
    gap = np.where(after > below, numbers[after] - numbers[below], 1.0)
    weight = np.clip((grid - numbers[below]) / gap, 0.0, 1.0)
    weight[weight < 1e-9] = 0.0
    return below.astype(np.int64), weight
