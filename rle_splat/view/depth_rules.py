"""Depth rules: positions of the sheets along the principal axis, and the depth that each sheet represents.

Positions are in voxels along the principal axis. The classified medium is zero outside the grid. Footprints of the
first and last slice extend beyond it (the tent ramps over [-1, 0] and [n-1, n]), and so do the cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache

import numpy as np

from ..scene import NAMED_DEPTH_RULES, midpoints_of, preintegrated_of
from .footprints import FOOTPRINTS, VoxelKernel, footprint_weights

_INSET = 0.5 / np.sqrt(3.0)


# Quadrature nodes (position in a cell, weight) of each rule, for a cell of depth one; weights sum to one
# (algorithm.md 1.7).
NAMED_NODES = {
    "slice": ((0.0, 0.5), (1.0, 0.5)),
    "slice-2": ((0.0, 0.5), (1.0, 0.5)),
    "simpson": ((0.0, 1 / 6), (0.5, 2 / 3), (1.0, 1 / 6)),
    "gauss2": ((0.5 - _INSET, 0.5), (0.5 + _INSET, 0.5)),
}
assert tuple(NAMED_NODES) == NAMED_DEPTH_RULES, "scene/quality.py lists other depth rules"
# Depth of a cell in voxels, if it is not one. The ramps before the first and after the last slice have cells of depth
# one, and the last cell between them may be smaller.
CELL_DEPTHS = {"slice-2": 2}


def cell_nodes(rule: str) -> tuple:
    """Quadrature nodes of a depth rule.

    Parameters
    ----------
    rule : str
        A key of NAMED_NODES; midpoint-M for M midpoints of equal weight; or planes-M, see ``value_rule``.

    Returns
    -------
    tuple of (position, weight)
        For a cell of depth one.
    """
    m = midpoints_of(rule)
    if m is not None:
        return tuple(((i + 0.5) / m, 1.0 / m) for i in range(m))
    if rule.startswith(PLANES):
        m = int(rule.removeprefix(PLANES))
        return tuple((i / m, (0.5 if i in (0, m) else 1.0) / m) for i in range(m + 1))
    return NAMED_NODES[rule]


PLANES = "planes-"


def value_rule(rule: str) -> str:
    """Depth rule for the largest, smallest or mean value along a ray, about as expensive as ``rule``.

    This is planes-M: the slices, where voxels have their own values, and M - 1 sheets between neighboring slices.
    """
    slabs, midpoints = preintegrated_of(rule), midpoints_of(rule)
    between = {"slice": 1}.get(rule, 2) if slabs is None else 2 * slabs
    return f"{PLANES}{midpoints or between}"


# The cell that contains the eye is integrated from the eye on, and no sheet may contain the eye.
FIRST_CELL_NODES = NAMED_NODES["gauss2"]
# Voxels; a slice closer to the eye joins the next cell, because a sheet there would contain the eye or be magnified
# without bound.
NEAREST_SLICE = 1e-3


# What a post-classified sheet represents: OWN, the slab around it by its own samples; BEGINS, nothing, it only begins
# the next slab; BETWEEN, the slab from the previous sheet to itself, over which the scalar changes linearly; ALONE, as
# BETWEEN, but the previous sheet was left out because nothing reaches it.
OWN, BEGINS, BETWEEN, ALONE = 0, 1, 2, 3


@dataclass(frozen=True, eq=False)
class Sheets:
    """The sheets of one base plane, front to back. Every array has one entry per sheet.

    Attributes
    ----------
    position : (n,) ndarray of float64
        Along the principal axis, voxels.
    first_slice : (n,) ndarray of int64
        First slice whose footprint reaches the sheet; may be outside the grid.
    slice_weights : (n, taps) ndarray of float32
        Weights of that slice and the following ones.
    thickness : (n,) ndarray of float64
        Depth that the sheet represents, voxels.
    begin, end : (n,) ndarray of float64
        The slab that the sheet represents, in voxels along the viewing direction (``sign * position``), so that
        begin < end. Slabs follow each other without gaps.
    far : (n,) ndarray of float64
        Where its samples are no longer used: the end of its slab, or of the next one.
    kind : (n,) ndarray of int64
        OWN, BEGINS or BETWEEN.
    """

    position: np.ndarray
    first_slice: np.ndarray
    slice_weights: np.ndarray
    thickness: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    far: np.ndarray
    kind: np.ndarray

    def __len__(self) -> int:
        return len(self.position)

    @cached_property
    def deepest(self) -> float:
        """Most depth over which a sheet's samples are used, in voxels."""
        return float((self.far - self.begin).max(initial=0.0))

    def part(self, first: int, last: int) -> Sheets:
        """Sheets that show nothing but the slabs of the sheets [``first``, ``last``).

        A sheet whose slab begins at the sheet before follows that sheet, which then only begins it.
        """
        begins = int(self.kind[first] == BETWEEN)
        part = Sheets(*(getattr(self, column.name)[first - begins : last].copy() for column in fields(self)))
        part.far[-1] = part.end[-1]
        if begins:
            part.kind[0], part.thickness[0], part.begin[0] = BEGINS, 0.0, part.end[0]
        return part


def _cells(begin: float, ramp_end: float, ramp_begin: float, end: float, depth: int) -> np.ndarray:
    """Where the cells from ``begin`` to ``end`` begin: ``depth`` voxels apart between the ramps, one in the ramps."""
    inside = max(begin, ramp_end)
    parts = np.arange(begin, ramp_end), np.arange(inside, ramp_begin, depth), np.arange(max(inside, ramp_begin), end)
    return np.concatenate(parts)


def place_sheets(
    n_slices: int, sign: int, rule: str, eye_position: float | None, footprint: VoxelKernel = FOOTPRINTS["tent"],
    boxed: bool = False,
) -> Sheets:  # fmt: skip
    """Place the sheets of a depth rule.

    Parameters
    ----------
    sign : {1, -1}
        Viewing direction along the principal axis.
    rule : str
        Depth rule.
    eye_position : float or None
        The eye's coordinate along the axis; None for parallel rays. Sheets behind the eye are left out, and the cell
        around the eye is integrated from the eye on (algorithm.md 1.4).
    boxed : bool
        Whether the medium ends at the first and last slice, without the ramps of footprints.
    """
    _, first, last = _ends(n_slices, sign, footprint, boxed)
    eye = -np.inf if eye_position is None else sign * float(eye_position)
    # Clamp the eye, because all eyes before the first sheet have the same sheets, and so have all behind the last.
    eye = -np.inf if eye <= first - NEAREST_SLICE else min(eye, last)
    return _sheets_from(eye, n_slices, sign, rule, footprint, boxed)


def _ends(n_slices: int, sign: int, footprint: VoxelKernel, boxed: bool) -> tuple[int, float, float]:
    """Voxels by which the medium extends beyond the slices; where it begins and ends along the viewing direction."""
    past = 0 if boxed else math.ceil(footprint.radius)
    front, back = -float(past), n_slices - 1.0 + past
    return (past, front, back) if sign > 0 else (past, -back, -front)


@lru_cache(maxsize=32)
def _sheets_from(eye: float, n_slices: int, sign: int, rule: str, footprint: VoxelKernel, boxed: bool) -> Sheets:
    """``place_sheets`` for an eye along the viewing direction; cached, since most frames repeat the previous sheets."""
    past, first, last = _ends(n_slices, sign, footprint, boxed)
    position, thickness, kind = np.empty(0), np.empty(0), np.empty(0, np.int64)
    start = first
    slabs, depth = preintegrated_of(rule), CELL_DEPTHS.get(rule, 1)
    if eye >= last:
        cells = np.empty(0)
    elif eye > first - NEAREST_SLICE:
        start = max(eye, first)
        whole = math.floor(eye + NEAREST_SLICE) + 1.0
        along, weights = np.array(FIRST_CELL_NODES).T
        position, thickness, kind = start + along * (whole - start), weights * (whole - start), np.full(len(along), OWN)
        cells = _cells(whole, first + past, last - past, last, depth)
    else:
        cells = _cells(first, first + past, last - past, last, depth)
    if slabs is not None and len(cells):
        along = cells[0] + np.arange(len(cells) * slabs + 1) / slabs
        weights, kinds = np.diff(along, prepend=along[0]), np.full(len(along), BETWEEN)
        kinds[0] = BEGINS
    elif len(cells):
        nodes = np.array(cell_nodes(rule))
        depths = np.diff(np.append(cells, last))[:, None]
        along, weights = (cells[:, None] + depths * nodes[:, 0]).ravel(), (depths * nodes[:, 1]).ravel()
        if nodes[0, 0] == 0.0:  # the last node of a cell is the first of the next: merge them to one sheet
            last_of_cell = np.arange(len(nodes) - 1, len(along) - 1, len(nodes))
            weights[last_of_cell + 1] += weights[last_of_cell]
            along, weights = np.delete(along, last_of_cell), np.delete(weights, last_of_cell)
        kinds = np.full(len(along), OWN)
    if len(cells):
        position, thickness = np.concatenate((position, along)), np.concatenate((thickness, weights))
        kind = np.concatenate((kind, kinds))
    depth_before = np.cumsum(thickness)
    depth_before[1:] = depth_before[:-1]
    depth_before[:1] = 0.0
    begin = start + depth_before
    end = begin + thickness
    far = end.copy()
    np.copyto(far[:-1], end[1:], where=kind[1:] == BETWEEN)
    axis_position = sign * position
    reach = 0.5 if boxed else footprint.radius  # half a voxel keeps sheets that rounding puts beyond the last slice
    touches_data = (axis_position > -reach) & (axis_position < n_slices - 1 + reach)
    axis_position = np.clip(axis_position, 0.0, n_slices - 1.0) if boxed else axis_position
    columns = axis_position, thickness, begin, end, far, kind
    if not touches_data.all():
        columns = [column[touches_data] for column in columns]
    axis_position, *others = columns
    return Sheets(axis_position, *footprint_weights(footprint, axis_position), *others)
