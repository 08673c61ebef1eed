"""Which label's function classifies a point, in kernels: ``classify.label_cells`` as they take it.

The functions' lookup tables are ChannelLookups, all of the volume's own values.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..classify.label_cells import KINDS, MIXED, NO_KIND, LabelCells
from ..runtime.jit import inner_loop, kernel, read_only
from ..view.base_plane import BasePlane

HALVINGS = 5  # of a stretch in which the function changes: so its boundary is found to 1/64


class CellField(NamedTuple):
    """The arrays of LabelCells, flat, and the number of voxels along x, y, z."""

    numbers: np.ndarray
    row_start: np.ndarray
    column: np.ndarray
    kinds: np.ndarray
    weights: np.ndarray
    n_x: int
    n_y: int
    n_z: int


class LabelField(NamedTuple):
    """Cells, and where the rays of a base plane's pixels are in them.

    At ``s`` voxels along the viewing direction the ray through pixel (u, v) is at ``along[0, u] + s * along[1, u]`` of
    the scanlines' axis, ``across[0, v] + s * across[1, v]`` of the axis across them, and ``sign * s`` of the principal
    ``axis``.
    """

    cells: CellField
    along: np.ndarray
    across: np.ndarray
    sign: float
    axis: int


def cell_field(cells: LabelCells) -> CellField:
    """The CellField of LabelCells."""
    flat = cells.kinds.reshape(-1), cells.weights.reshape(-1)
    return CellField(
        *map(read_only, (cells.numbers, cells.row_start, cells.column, *flat)), *map(int, cells.shape_xyz)
    )


def label_field(cells: LabelCells, plane: BasePlane) -> LabelField:
    """The LabelField of a base plane."""
    ways = (
        read_only(np.stack((at - plane.reference * slope, plane.sign * slope)))
        for at, slope in zip(plane.points(), plane.ray_slopes)
    )
    return LabelField(cell_field(cells), *ways, float(plane.sign), int(plane.axis))


@inner_loop
def _record_at(field, row, x):
    """The record of voxel ``x`` of a row, which has one."""
    low, high = field.row_start[row], field.row_start[row + 1] - 1
    while low < high:
        middle = (low + high) >> 1
        if field.column[middle] < x:
            low = middle + 1
        else:
            high = middle
    return low


@inner_loop
def _weight_of(field, record, number):
    """The weight of a function in a record."""
    for slot in range(KINDS * record, KINDS * record + KINDS):
        if field.kinds[slot] == number:
            return np.float64(field.weights[slot])
    return 0.0


# Not a part of the loops that call it, which would take minutes to compile: few samples come here.
@kernel(inner=True)
def _largest(field, first, row, x, fx, fy, fz):
    """The function with the largest weight at a point of a mixed cell; see ``number_at``."""
    a, c = _record_at(field, row, x), _record_at(field, row + field.n_y, x)
    b, d = _record_at(field, row + 1, x), _record_at(field, row + field.n_y + 1, x)
    most, found = -1e30, 0
    for corner in range(8):
        at = first + (corner & 1) + field.n_x * ((corner >> 1 & 1) + field.n_y * (corner >> 2))
        number = int(field.numbers[at]) & NO_KIND
        if number == found and corner > 0:
            continue
        near = (1.0 - fy) * ((1.0 - fx) * _weight_of(field, a, number) + fx * _weight_of(field, a + 1, number))
        near += fy * ((1.0 - fx) * _weight_of(field, b, number) + fx * _weight_of(field, b + 1, number))
        far = (1.0 - fy) * ((1.0 - fx) * _weight_of(field, c, number) + fx * _weight_of(field, c + 1, number))
        far += fy * ((1.0 - fx) * _weight_of(field, d, number) + fx * _weight_of(field, d + 1, number))
        weight = (1.0 - fz) * near + fz * far
        if weight > most:
            most, found = weight, number
    return found


@inner_loop
def number_at(field, x, y, z):
    """Number of the function that a point belongs to; ``field``: CellField; ``x``, ``y``, ``z``: float64, voxels."""
    x, y, z = min(max(x, 0.0), field.n_x - 1.0), min(max(y, 0.0), field.n_y - 1.0), min(max(z, 0.0), field.n_z - 1.0)
    i, j, k = min(int(x), field.n_x - 2), min(int(y), field.n_y - 2), min(int(z), field.n_z - 2)
    row = k * field.n_y + j
    first = row * field.n_x + i
    number = int(field.numbers[first])
    if number & MIXED == 0:
        return number
    return _largest(field, first, row, i, x - i, y - j, z - k)


@inner_loop
def number_on_ray(field, u, v, s):
    """``number_at`` of a pixel's ray, ``s`` voxels along the viewing direction; ``field``: LabelField."""
    a, b = field.along[0, u] + s * field.along[1, u], field.across[0, v] + s * field.across[1, v]
    c = field.sign * s
    if field.axis == 2:
        return number_at(field.cells, a, b, c)
    if field.axis == 1:
        return number_at(field.cells, a, c, b)
    return number_at(field.cells, c, a, b)


@inner_loop
def share_on_ray(field, u, v, begin, end, number):
    """How much of a stretch of a ray belongs to the function ``number``, to which it belongs at its begin alone."""
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if number_on_ray(field, u, v, begin + middle * (end - begin)) == number:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
