"""Which label's function classifies a point, in kernels: ``classify.label_cells`` as they take it.

The functions' lookup tables are the first of ChannelLookups, those of the volume's own values.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..classify.label_cells import KINDS, LEAD_OF_ONE, NO_KIND, SEVERAL, WEIGHT_OF_ONE, LabelCells
from ..runtime.jit import inner_loop, kernel, read_only
from ..view.base_plane import BasePlane
from ..volume.axes import AXES

PER_WEIGHT = LEAD_OF_ONE / WEIGHT_OF_ONE
LEAST_LEAD = 1e-6  # of two ends of a slab together


class CellField(NamedTuple):
    """The arrays of LabelCells, flat, and the number of voxels along x, y, z."""

    numbers: np.ndarray
    leads: np.ndarray
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
    ``axis``.  ``counts`` and ``strides``: (3,) int64, of voxels along these three.  A ray moves at most ``steepest``
    voxels along any axis per voxel along the viewing direction.
    """

    cells: CellField
    along: np.ndarray
    across: np.ndarray
    sign: float
    axis: int
    counts: np.ndarray
    strides: np.ndarray
    steepest: float


# What stands for the cells and the field of a volume without labels, so that it shares a kernel with one with labels.
NO_CELLS = CellField(
    *(read_only(np.empty(0, kind)) for kind in ("uint16", "int8", "int64", "int32", "uint16", "int16")), 0, 0, 0
)  # fmt: skip
NO_LABELS = LabelField(
    NO_CELLS, read_only(np.empty((2, 0))), read_only(np.empty((2, 0))), 1.0, 0,
    read_only(np.empty(0, np.int64)), read_only(np.empty(0, np.int64)), 0.0,
)  # fmt: skip


@inner_loop
def are_cells(cells):
    """Whether a CellField is one of labels."""
    return cells.n_x > 0


def cell_field(cells: LabelCells) -> CellField:
    """The CellField of LabelCells."""
    flat = cells.kinds.reshape(-1), cells.weights.reshape(-1)
    return CellField(
        *map(read_only, (cells.numbers, cells.leads, cells.row_start, cells.column, *flat)),
        *map(int, cells.shape_xyz),
    )


def label_field(cells: LabelCells, plane: BasePlane) -> LabelField:
    """The LabelField of a base plane."""
    ways = (
        read_only(np.stack((at - plane.reference * slope, plane.sign * slope)))
        for at, slope in zip(plane.points, plane.ray_slopes)
    )
    (n_x, n_y, _), axes = cells.shape_xyz, list(AXES[plane.axis])
    counts, strides = (read_only(np.array(each, np.int64)[axes]) for each in (cells.shape_xyz, (1, n_x, n_x * n_y)))
    steepest = max(1.0, *(float(np.abs(slope).max()) for slope in plane.ray_slopes))
    return LabelField(cell_field(cells), *ways, float(plane.sign), int(plane.axis), counts, strides, steepest)


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
    """As ``label_at``, in a cell where more than two functions count."""
    a, c = _record_at(field, row, x), _record_at(field, row + field.n_y, x)
    b, d = _record_at(field, row + 1, x), _record_at(field, row + field.n_y + 1, x)
    most, second, found = -1e30, -1e30, -1
    for corner in range(8):
        at = first + (corner & 1) + field.n_x * ((corner >> 1 & 1) + field.n_y * (corner >> 2))
        number = int(field.numbers[at]) & NO_KIND
        if number == found:
            continue
        near = (1.0 - fy) * ((1.0 - fx) * _weight_of(field, a, number) + fx * _weight_of(field, a + 1, number))
        near += fy * ((1.0 - fx) * _weight_of(field, b, number) + fx * _weight_of(field, b + 1, number))
        far = (1.0 - fy) * ((1.0 - fx) * _weight_of(field, c, number) + fx * _weight_of(field, c + 1, number))
        far += fy * ((1.0 - fx) * _weight_of(field, d, number) + fx * _weight_of(field, d + 1, number))
        weight = (1.0 - fz) * near + fz * far
        if weight > most:
            most, second, found = weight, most, number
        else:
            second = max(second, weight)
    return found, (most - second) * PER_WEIGHT


@inner_loop
def _lead(field, at, number):
    """The lead of the function ``number`` in a voxel of it or of the only other one."""
    lead = np.float64(field.leads[at])
    return lead if int(field.numbers[at]) & NO_KIND == number else -lead


@inner_loop
def label_at(field, x, y, z):
    """Number of the function that a point belongs to, and its lead there; ``field``: CellField; ``x``, ``y``, ``z``:
    float64, voxels."""
    x, y, z = min(max(x, 0.0), field.n_x - 1.0), min(max(y, 0.0), field.n_y - 1.0), min(max(z, 0.0), field.n_z - 1.0)
    i, j, k = min(int(x), field.n_x - 2), min(int(y), field.n_y - 2), min(int(z), field.n_z - 2)
    row = k * field.n_y + j
    first = row * field.n_x + i
    fx, fy, fz = x - i, y - j, z - k
    word = int(field.numbers[first])
    number = word & NO_KIND
    if word & SEVERAL != 0:
        return _largest(field, first, row, i, fx, fy, fz)
    below, behind = first + field.n_x, first + field.n_x * field.n_y
    both = below + field.n_x * field.n_y
    a = (1.0 - fx) * _lead(field, first, number) + fx * _lead(field, first + 1, number)
    b = (1.0 - fx) * _lead(field, below, number) + fx * _lead(field, below + 1, number)
    c = (1.0 - fx) * _lead(field, behind, number) + fx * _lead(field, behind + 1, number)
    d = (1.0 - fx) * _lead(field, both, number) + fx * _lead(field, both + 1, number)
    lead = (1.0 - fz) * ((1.0 - fy) * a + fy * b) + fz * ((1.0 - fy) * c + fy * d)
    if lead >= 0.0:
        return number, lead
    other = number
    for corner in range(1, 8):
        at = first + (corner & 1) + field.n_x * ((corner >> 1 & 1) + field.n_y * (corner >> 2))
        own = int(field.numbers[at]) & NO_KIND
        other = own if own != number else other
    return other, -lead


@inner_loop
def crossing(near_lead, far_lead):
    """Where two functions are alike between two points, of which each leads at one; 0 to 1."""
    return near_lead / max(near_lead + far_lead, LEAST_LEAD)


@inner_loop
def refine_crossing(share, near, near_lead, far, far_lead, number, lead):
    """A ``crossing`` of the functions ``near`` and ``far``, with what was found there: ``number`` and its ``lead``."""
    if number == near:
        return share + (1.0 - share) * crossing(lead, far_lead)
    return share * crossing(near_lead, lead) if number == far else share


@inner_loop
def label_on_ray(field, u, v, s):
    """``label_at`` of a pixel's ray, ``s`` voxels along the viewing direction; ``field``: LabelField."""
    a, b = field.along[0, u] + s * field.along[1, u], field.across[0, v] + s * field.across[1, v]
    c = field.sign * s
    x, y, z = c, a, b
    if field.axis == 2:
        x, y, z = a, b, c
    elif field.axis == 1:
        x, y, z = a, c, b
    return label_at(field.cells, x, y, z)


@inner_loop
def scanline_at(field, v, s, offset, last):
    """Where the numbers of a scanline begin, the one of a row's rays ``s`` voxels along the viewing direction.

    ``offset``: 0.5 for the nearest, 0 for the first of a cell; ``last``: voxels at the end that do not count.
    """
    b, c = field.across[0, v] + s * field.across[1, v] + offset, field.sign * s + offset
    line = field.strides[1] * min(max(int(b), 0), field.counts[1] - 1 - last)
    return line + field.strides[2] * min(max(int(c), 0), field.counts[2] - 1 - last)


@inner_loop
def word_on_ray(field, u, line, s, offset, last):
    """Number and bits of the voxel of ``scanline_at`` that a pixel's ray is at."""
    a = field.along[0, u] + s * field.along[1, u] + offset
    return int(field.cells.numbers[line + field.strides[0] * min(max(int(a), 0), field.counts[0] - 1 - last)])
