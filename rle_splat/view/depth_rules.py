"""Depth rules: where the sheets lie along the principal axis, and how much depth each one stands for.

Positions are in voxels along the principal axis.  The classified medium is zero outside the grid, so the
footprints of the first and last slice ramp over [-1, 0] and [n-1, n], and cells run from -1 to n.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Nodes (position in a unit cell, weight) of each rule; the weights of a cell sum to one.  algorithm.md 1.7
CELL_NODES = {
    "slice": ((0.0, 0.5), (1.0, 0.5)),
    "simpson": ((0.0, 1 / 6), (0.5, 2 / 3), (1.0, 1 / 6)),
}
# The cell that the eye lies in is integrated from the eye on, and no sheet may lie in the eye itself.
_INSET = 0.5 / np.sqrt(3.0)
FIRST_CELL_NODES = ((0.5 - _INSET, 0.5), (0.5 + _INSET, 0.5))
# A slice closer to the eye than this, in voxels, joins the next cell: its own would be a sheet in the eye, or one
# that the slice map magnifies beyond number.
NEAREST_SLICE = 1e-3


@dataclass(frozen=True, eq=False)
class Sheets:
    """The sheets of one base plane, front to back; every array has one entry per sheet.

    ``position``: along the principal axis, voxels.  ``lower``: the slice at or below it (int64, may be -1),
    ``fraction``: how far it lies towards the next slice.  ``thickness``: voxels of depth it stands for.
    ``begin`` and ``end``: the slab it stands for, in voxels along the viewing direction of the axis
    (``sign * position``), so that ``begin < end`` and slabs follow each other without gaps.
    """

    position: np.ndarray
    lower: np.ndarray
    fraction: np.ndarray
    thickness: np.ndarray
    begin: np.ndarray
    end: np.ndarray

    def __len__(self) -> int:
        return len(self.position)


def place_sheets(n_slices: int, sign: int, rule: str, eye_position: float | None) -> Sheets:
    """The sheets of ``rule`` through ``n_slices`` slices, seen along ``sign`` (+1 or -1) of the principal axis.

    ``eye_position`` is the eye's coordinate along the axis, None for parallel rays; what lies behind the eye is
    left out and the cell around the eye is integrated from the eye on (algorithm.md 1.4).
    """
    first, last = (-1.0, float(n_slices)) if sign > 0 else (-float(n_slices), 1.0)  # in viewing order
    eye = -np.inf if eye_position is None else sign * float(eye_position)
    position, thickness = [], []
    start = first
    if eye >= last:
        cells = np.empty(0)
    elif eye > first:
        start = eye
        whole = np.floor(eye + NEAREST_SLICE) + 1.0
        for at, weight in FIRST_CELL_NODES:
            position.append(eye + at * (whole - eye))
            thickness.append(weight * (whole - eye))
        cells = np.arange(whole, last)
    else:
        cells = np.arange(first, last)
    if len(cells):
        nodes = np.array(CELL_NODES[rule])
        steps = len(nodes) - 1
        shared = np.zeros(len(cells) * steps + 1)
        for i, (_, weight) in enumerate(nodes):
            shared[i : i + steps * len(cells) : steps] += weight
        position.extend(cells[0] + np.arange(len(shared)) / steps)
        thickness.extend(shared)
    along, thickness = np.array(position), np.array(thickness)
    begin = start + np.concatenate(([0.0], np.cumsum(thickness)[:-1])) if len(along) else along
    end = begin + thickness
    place = sign * along
    lower = np.floor(place)
    touches_data = (place > -1.0) & (place < n_slices)
    columns = (place, lower.astype(np.int64), place - lower, thickness, begin, end)
    return Sheets(*(np.ascontiguousarray(column[touches_data]) for column in columns))
