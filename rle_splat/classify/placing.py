"""Positions of the records of visible voxels in the scanlines of a principal axis.

A plane z of voxels meets one scanline per row, or, where scanlines run along y, one per column. Voxels keep their order
within a scanline, so one cursor per scanline of a plane suffices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..runtime.jit import kernel, read_only
from .visible import VisibleVoxels


@dataclass(frozen=True, eq=False)
class RecordPositions:
    """Planes of visible voxels, and the positions of their records.

    Attributes
    ----------
    first_plane : int
        The planes are [``first_plane``, ``first_plane + len(data_starts)``).
    across : bool
        Whether scanlines run along y.
    data_starts : (planes, ny) ndarray of int64; (planes, nx) if ``across``
        Position of the first record of each scanline.
    """

    voxels: VisibleVoxels
    first_plane: int
    across: bool
    data_starts: np.ndarray

    @classmethod
    def in_order(cls, voxels: VisibleVoxels, first_plane: int, last_plane: int) -> RecordPositions:
        """Records in the order of the voxels of planes [``first_plane``, ``last_plane``), from position 0 on."""
        ny = voxels.shape_xyz[1]
        starts = voxels.row_start[first_plane * ny : last_plane * ny]
        return cls(voxels, first_plane, False, (starts - starts[:1]).reshape(-1, ny))

    @property
    def span(self) -> tuple[int, int]:
        """Half-open range of the voxels of the planes."""
        ny = self.voxels.shape_xyz[1]
        ends = self.first_plane * ny, (self.first_plane + len(self.data_starts)) * ny
        return tuple(int(self.voxels.row_start[row]) for row in ends)

    @property
    def arguments(self) -> tuple:
        """Arguments of kernels: ny, first plane, row_start, column, across, data_starts."""
        voxels = self.voxels
        starts = read_only(np.ascontiguousarray(self.data_starts))
        return (
            voxels.shape_xyz[1], self.first_plane, read_only(voxels.row_start), read_only(voxels.column), self.across,
            starts,
        )  # fmt: skip


@kernel(inline="always")
def find_targets(across, first_row, row, row_start, column, at, count, cursors, targets):
    """Positions of the records of voxels [at, at + count) of one plane.

    ``row``: row of the first voxel; ``first_row``: first row of the plane; ``cursors``: next position in each scanline,
    advanced; writes ``targets`` (count,) uint64. Returns the row of the last voxel.
    """
    i = at
    while i < at + count:
        while row_start[row + 1] <= i:
            row += 1
        end = min(row_start[row + 1], at + count)
        if across:
            for j in range(i, end):
                x = np.uint64(column[j])
                targets[j - at] = cursors[x]
                cursors[x] += 1
        else:
            to = cursors[row - first_row]
            for j in range(end - i):
                targets[i - at + j] = to + j
            cursors[row - first_row] = to + end - i
        i = end
    return row
