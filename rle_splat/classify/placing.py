"""Where the records of visible voxels go: to the scanlines of a principal axis, which may run across their own rows.

A plane z of voxels meets one scanline for each of its rows, or, where scanlines run along y, one for each of its
columns.  Within a scanline the voxels keep their order, so a cursor for each scanline of a plane is all it takes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..runtime.jit import kernel, read_only
from .visible import VisibleVoxels


@dataclass(frozen=True, eq=False)
class Places:
    """The planes [``first_plane``, ``first_plane + len(data_starts)``) of visible voxels, and where their records go.

    ``across``: whether scanlines run along y.  ``data_starts``: (planes, ny), or (planes, nx) across, int64: where the
    records of each scanline begin.
    """

    voxels: VisibleVoxels
    first_plane: int
    across: bool
    data_starts: np.ndarray

    @classmethod
    def in_order(cls, voxels: VisibleVoxels, first_plane: int, last_plane: int) -> Places:
        """One after the other, as the voxels are, from 0 on."""
        ny = voxels.shape_xyz[1]
        starts = voxels.row_start[first_plane * ny : last_plane * ny]
        return cls(voxels, first_plane, False, (starts - starts[:1]).reshape(-1, ny))

    @property
    def span(self) -> tuple[int, int]:
        """First voxel, and one past the last."""
        ny = self.voxels.shape_xyz[1]
        ends = self.first_plane * ny, (self.first_plane + len(self.data_starts)) * ny
        return tuple(int(self.voxels.row_start[row]) for row in ends)

    @property
    def arguments(self) -> tuple:
        """What kernels take of it: ny, first plane, row_start, column, across, data_starts."""
        voxels = self.voxels
        starts = read_only(np.ascontiguousarray(self.data_starts))
        return (
            voxels.shape_xyz[1], self.first_plane, read_only(voxels.row_start), read_only(voxels.column), self.across,
            starts,
        )

    def targets_numpy(self) -> np.ndarray:
        """Twin of ``find_targets``: (n,) int64 place of each voxel's record."""
        ny = self.voxels.shape_xyz[1]
        first, last = self.span
        rows = np.arange(self.first_plane * ny, (self.first_plane + len(self.data_starts)) * ny)
        row = np.repeat(rows, np.diff(self.voxels.row_start)[rows])
        key = self.voxels.column[first:last].astype(np.int64) if self.across else row % ny
        line = (row // ny - self.first_plane) * self.data_starts.shape[1] + key
        order = np.argsort(line, kind="stable")
        line = line[order]
        in_line = np.arange(len(line)) - np.searchsorted(line, line, side="left")
        targets = np.empty(len(line), np.int64)
        targets[order] = self.data_starts.reshape(-1)[line] + in_line
        return targets


@kernel(inline="always")
def find_targets(across, first_row, row, row_start, column, at, count, cursors, targets):
    """Places of the records of voxels [at, at + count), which lie in rows of one plane, ``row`` and on.

    ``first_row``: of the plane; ``cursors``: where the next record of each scanline goes, moved along; writes
    ``targets`` (count,) uint64.  Returns the row of the last voxel.
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
