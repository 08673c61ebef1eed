"""Which voxels a transfer function shows: the first step of classification, on which all run lengths depend.

The voxels are looked at once and marked by a bit each; blocks whose range of values is hidden are skipped.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..runtime.jit import compiled, parallel_call, read_only
from ..volume.blocks import BLOCK_Z, Blocks, cut_chunks
from . import classify_kernels as passes
from . import reference
from .points import LARGEST, pieces, positive_intervals
from .reference import WORD

if TYPE_CHECKING:
    from ..volume.volume import Volume
    from .transfer_function import TransferFunction


@dataclass(frozen=True, eq=False)
class VisibleVoxels:
    """The visible voxels of a volume, in rows along x; row number ``z * ny + y``.

    Attributes
    ----------
    shape_xyz : (nx, ny, nz)
    row_start : (nz * ny + 1,) ndarray of int64
        First entry of each row in ``column`` and ``stored``.
    row_pieces : (nz * ny,) ndarray of int32
        Number of connected pieces that the visible voxels of a row form.
    column : (m,) ndarray of uint16 (int32 if nx > 65536)
        x of each voxel, ascending within a row.
    stored : (m,) ndarray
        Stored value of each voxel.
    nan_voxels : int
        Number of NaN voxels, which are transparent.
    bits : (nz * ny, words) ndarray of uint64 or None
        One bit per voxel of a row, if the voxels were found that way.
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
        """Bytes of all arrays."""
        lists = self.row_start.nbytes + self.row_pieces.nbytes + self.column.nbytes + self.stored.nbytes
        return lists + (0 if self.bits is None else self.bits.nbytes)


@dataclass(frozen=True, eq=False)
class Visibility:
    """The values of a volume that a transfer function shows.

    8- and 16-bit volumes use a lookup table over all stored values (``by_table``), others the points themselves.
    """

    volume: Volume
    tf: TransferFunction

    @property
    def by_table(self) -> bool:
        """Whether stored values have at most 16 bits, so that a lookup table is used."""
        return self.volume.voxels.dtype.kind in "iu" and self.volume.voxels.dtype.itemsize <= 2

    @property
    def pattern_type(self) -> np.dtype:
        """Type of the bit patterns that the lookup table is for; without one, of the stored values."""
        own = self.volume.voxels.dtype
        return np.dtype(f"u{own.itemsize}") if self.by_table else own

    @cached_property
    def pattern_values(self) -> np.ndarray:
        """(256 or 65536,) float64: physical value of every bit pattern."""
        stored_type = self.volume.voxels.dtype
        patterns = np.arange(1 << (8 * stored_type.itemsize), dtype=f"u{stored_type.itemsize}")
        return self.volume.physical(patterns.view(stored_type))

    @cached_property
    def table(self) -> np.ndarray:
        """(256 or 65536,) uint8 by bit pattern: 1 where the opacity is above 0."""
        return (np.asarray(self.tf.alpha_at(self.pattern_values)) > 0.0).astype(np.uint8)

    @cached_property
    def intervals(self) -> np.ndarray:
        """(k, 2) float64: disjoint half-open intervals of physical values with an opacity above 0."""
        return positive_intervals(pieces(self.tf.opacity))

    @property
    def key(self) -> str:
        """Hash of the visible values; transfer functions that show the same values have the same key."""
        shown = self.table if self.by_table else self.intervals
        return hashlib.blake2b(shown.tobytes(), digest_size=16).hexdigest()

    def relevant(self, blocks: Blocks) -> np.ndarray:
        """(blocks along z, y, x) uint8: 0 where all voxels of a block are hidden."""
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
    """(n + 1,) int64 running totals of n counts, beginning with 0."""
    offsets = np.zeros(len(counts) + 1, dtype=np.int64)
    np.cumsum(counts, out=offsets[1:], dtype=np.int64)
    return offsets


def mark_steps(shown: Visibility, blocks: Blocks, *, threads: int = 0):
    """Generator of fractions done: mark the visible voxels, for ``count_kept`` and ``gather_kept`` of ``relevant``.

    Parameters
    ----------
    blocks : Blocks
        Of the same volume.
    threads : int
        0 for one per core.

    Returns
    -------
    (nz * ny, words) ndarray of uint64
        One bit per voxel of a row, lowest bit first.
    """
    nx, ny, nz = shown.volume.shape_xyz
    bits = np.zeros((nz * ny, -(-nx // WORD)), np.uint64)
    for first, last, rows, relevant in _pieces_of_work(shown, blocks):
        yield first / nz
        part = bits[first * ny : last * ny]
        if not compiled():
            reference.pack(reference.find_seen(shown, rows), part)
            continue
        with parallel_call(threads):
            if shown.by_table:
                passes.mark_by_table(rows, ny, relevant, shown.table, part)
            else:
                scaling = float(shown.volume.slope), float(shown.volume.intercept)
                passes.mark_by_points(rows, ny, relevant, *scaling, shown.intervals, part)
    return bits


def _pieces_of_work(shown: Visibility, blocks: Blocks):
    """Yield (first plane, last plane, their rows, their relevant blocks) for pieces of the volume with any of these."""
    volume, relevant = shown.volume, shown.relevant(blocks)
    nx, ny, nz = volume.shape_xyz
    for first, last in cut_chunks(nz, ny * nx, multiple=BLOCK_Z):
        here = slice(first // BLOCK_Z, -(-last // BLOCK_Z))
        part = relevant[here]
        if part.any():
            planes = np.asarray(volume.voxels)[first:last]
            yield first, last, read_only(planes).view(shown.pattern_type).reshape(-1, nx), part
