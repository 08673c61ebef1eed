"""Which voxels a transfer function shows: the first half of classification, and all that run lengths depend on.

Two passes over the rows, count and fill, so that nothing of the volume's size is ever allocated; both skip the
blocks whose smallest and largest values are hidden.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..runtime.buffer_pool import empty
from ..runtime.jit import compiled, parallel_call, read_only
from ..volume.blocks import BLOCK_Z, VOXELS_AT_ONCE, Blocks, slabs
from . import classify_kernels as passes
from .points import LARGEST, pieces, positive_intervals
from .refined import FineVoxels
from .sizes import FINE_VOXELS_AT_ONCE


@dataclass(frozen=True, eq=False)
class VisibleVoxels:
    """The non-transparent voxels of a volume, in rows along x; row number ``z * ny + y``.

    ``row_start``: (nz * ny + 1,) int64, first voxel of each row in the lists below.
    ``row_pieces``: (nz * ny,) int32, the connected pieces that a row's visible voxels come in.
    ``column``: (m,) uint16 (int32 when nx > 65536), x of each voxel, ascending within a row.
    ``stored``: (m,) stored value of each voxel; 8- and 16-bit ones as unsigned bit patterns.
    ``nan_voxels``: how many voxels were NaN and therefore transparent.
    ``bits``: (nz * ny, words) uint64, a bit for each voxel of a row, where whoever found them has such; else None.
    """

    shape_xyz: tuple[int, int, int]
    row_start: np.ndarray
    row_pieces: np.ndarray
    column: np.ndarray
    stored: np.ndarray
    nan_voxels: int
    bits: np.ndarray | None = None

    def __post_init__(self):
        for array in (self.row_start, self.row_pieces, self.column, self.stored, self.bits):
            if array is not None:
                array.setflags(write=False)

    def __len__(self) -> int:
        return int(self.row_start[-1])

    @property
    def nbytes(self) -> int:
        lists = self.row_start.nbytes + self.row_pieces.nbytes + self.column.nbytes + self.stored.nbytes
        return lists + (0 if self.bits is None else self.bits.nbytes)


@dataclass(frozen=True, eq=False)
class Visibility:
    """The stored values of ``volume``, a RefinedVolume perhaps, that the transfer function ``tf`` shows.

    8- and 16-bit volumes go by a table of every stored value (``by_table``), others by the points themselves.
    """

    volume: object
    tf: object

    @property
    def by_table(self) -> bool:
        return self.volume.voxels.dtype.kind in "iu" and self.volume.voxels.dtype.itemsize <= 2

    @cached_property
    def pattern_values(self) -> np.ndarray:
        """(256 or 65536,) float64: the physical value of every bit pattern."""
        stored_type = self.volume.voxels.dtype
        patterns = np.arange(1 << (8 * stored_type.itemsize), dtype=f"u{stored_type.itemsize}")
        return self.volume.physical(patterns.view(stored_type))

    @cached_property
    def table(self) -> np.ndarray:
        """(256 or 65536,) uint8 by bit pattern: 1 where the opacity is above 0."""
        return (np.asarray(self.tf.alpha_at(self.pattern_values)) > 0.0).astype(np.uint8)

    @cached_property
    def intervals(self) -> np.ndarray:
        """(k, 2) float64: disjoint half-open intervals of the physical values with an opacity above 0."""
        return positive_intervals(pieces(self.tf.opacity))

    @property
    def key(self) -> str:
        """A hash of what is shown; two functions that show the same values have the same."""
        shown = self.table if self.by_table else self.intervals
        return hashlib.blake2b(shown.tobytes(), digest_size=16).hexdigest()

    def relevant(self, blocks: Blocks) -> np.ndarray:
        """(blocks along z, y, x) uint8: 0 where every voxel of a block is hidden."""
        if self.by_table:
            stored_type = self.volume.voxels.dtype
            lowest = np.iinfo(stored_type).min
            ascending = np.roll(self.table, -lowest)  # bit patterns of negative numbers come last
            shown_below = np.zeros(len(ascending) + 1, np.int64)
            np.cumsum(ascending, out=shown_below[1:])
            low, high = (end.astype(np.int64) - lowest for end in (blocks.low, blocks.high))
            return (shown_below[high + 1] > shown_below[low]).astype(np.uint8)
        with np.errstate(over="ignore"):
            ends = (np.clip(self.volume.physical(end), -LARGEST, LARGEST) for end in (blocks.low, blocks.high))
            low, high = ends if self.volume.slope > 0.0 else reversed(tuple(ends))
        shown = np.zeros(low.shape, bool)
        for begin, end in self.intervals:
            shown |= (begin <= high) & (low < end)
        return (shown & (blocks.low <= blocks.high)).astype(np.uint8)


def row_offsets(counts: np.ndarray) -> np.ndarray:
    """(n + 1,) int64 running totals of n counts, starting with 0."""
    offsets = np.zeros(len(counts) + 1, dtype=np.int64)
    np.cumsum(counts, out=offsets[1:], dtype=np.int64)
    return offsets


def count_steps(shown: Visibility, blocks: Blocks, *, backend: str = "auto", threads: int = 0):
    """Generator: yields the fraction done; returns (visible voxels, connected pieces) per row, each (nz * ny,)."""
    _, ny, nz = shown.volume.shape_xyz
    counts, row_pieces = np.zeros(nz * ny, np.int64), np.zeros(nz * ny, np.int32)
    for first, last, rows, relevant in _pieces_of_work(shown, blocks, backend, threads):
        yield first / nz
        out = counts[first * ny : last * ny], row_pieces[first * ny : last * ny]
        if not relevant.any():
            continue
        if not compiled(backend):
            seen = _seen_numpy(shown, rows)
            out[0][:] = seen.sum(axis=1)
            out[1][:] = (seen[:, 1:] & ~seen[:, :-1]).sum(axis=1) + seen[:, 0]
            continue
        with parallel_call(threads):
            if shown.by_table:
                passes.count_by_table(rows, ny, relevant, shown.table, *out)
            else:
                passes.count_by_points(rows, ny, relevant, *_scaling(shown), shown.intervals, *out)
    return counts, row_pieces


def fill_steps(shown: Visibility, blocks: Blocks, counted, *, backend: str = "auto", threads: int = 0):
    """Generator: yields the fraction done; returns the VisibleVoxels.  ``counted``: what ``count_steps`` returned."""
    nx, ny, nz = shown.volume.shape_xyz
    counts, row_pieces = counted
    row_start = row_offsets(counts)
    column = empty(row_start[-1], dtype=np.uint16 if nx <= 65536 else np.int32)
    stored = empty(row_start[-1], dtype=_list_type(shown))
    for first, last, rows, relevant in _pieces_of_work(shown, blocks, backend, threads):
        yield first / nz
        starts = row_start[first * ny : last * ny + 1]
        if starts[0] == starts[-1]:
            continue
        if not compiled(backend):
            seen = _seen_numpy(shown, rows)
            part = slice(starts[0], starts[-1])
            column[part], stored[part] = np.nonzero(seen)[1], rows[seen]
            continue
        with parallel_call(threads):
            if shown.by_table:
                passes.fill_by_table(rows, ny, relevant, shown.table, starts, column, stored)
            else:
                passes.fill_by_points(
                    rows, ny, relevant, *_scaling(shown), shown.intervals, starts, column, stored
                )
    return VisibleVoxels((nx, ny, nz), row_start, row_pieces, column, stored, blocks.nan_voxels)


def _list_type(shown: Visibility) -> np.dtype:
    own = shown.volume.voxels.dtype
    return np.dtype(f"u{own.itemsize}") if shown.by_table else own


def _scaling(shown: Visibility) -> tuple[float, float]:
    return float(shown.volume.slope), float(shown.volume.intercept)


def _pieces_of_work(shown: Visibility, blocks: Blocks, backend, threads):
    """(first plane, last plane, their rows, their relevant blocks), one piece after the other."""
    nx, ny, nz = shown.volume.shape_xyz
    voxels = shown.volume.voxels
    finer = isinstance(voxels, FineVoxels)
    if not finer:
        voxels = read_only(np.asarray(voxels)).view(_list_type(shown))
    relevant = shown.relevant(blocks)
    for first, last in slabs(nz, ny * nx, FINE_VOXELS_AT_ONCE if finer else VOXELS_AT_ONCE, multiple=BLOCK_Z):
        here = slice(first // BLOCK_Z, -(-last // BLOCK_Z))
        part = relevant[here]
        if finer and not part.any():
            continue
        if finer:
            planes = voxels.planes(first, last, part, blocks.low[here], backend=backend, threads=threads)
        else:
            planes = voxels[first:last]
        yield first, last, read_only(planes).reshape(-1, nx), part


def _seen_numpy(shown: Visibility, rows) -> np.ndarray:
    """Twin of the passes: (rows, nx) bool."""
    if shown.by_table:
        return shown.table[rows].astype(bool)
    slope, intercept = _scaling(shown)
    seen = np.zeros(rows.shape, bool)
    for row, stored in zip(seen, rows):  # row by row: no float64 copy of large volumes
        with np.errstate(over="ignore"):
            values = np.clip(stored.astype(np.float64) * slope + intercept, -LARGEST, LARGEST)
        row[:] = ((values[:, None] >= shown.intervals[:, 0]) & (values[:, None] < shown.intervals[:, 1])).any(axis=1)
    return seen
