"""Voxels that post-classified sheets need: the corners of visible cells (algorithm.md 1.14).

Post-classified sheets interpolate the scalar first and classify then. Inside a cell of eight voxels the interpolated
value takes all values from the smallest to the largest. A cell is visible if the transfer function is above zero
anywhere in that range, and a voxel is kept if it is a corner of a visible cell. A sample that needs a voxel that is not
kept is transparent.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..runtime.bits import count_bits, eight_bytes, lowest_bit
from ..runtime.buffer_pool import empty
from ..runtime.jit import compiled, kernel, parallel_call, read_only, run_either
from ..runtime.parallel import share_out
from ..runtime.steps import drain
from ..volume.blocks import BLOCK_X, BLOCK_Y, BLOCK_Z, Blocks, cut_chunks
from . import reference
from .points import LARGEST, pieces, positive_intervals
from .reference import WORD, with_neighbors
from .visible import VisibleVoxels, row_offsets

NO_BITS, ONE_BIT = np.uint64(0), np.uint64(1)


@dataclass(frozen=True, eq=False)
class Reach:
    """Condition on a cell's smallest and largest stored value under which the cell is visible.

    Attributes
    ----------
    ends : (k, 2) ndarray of the volume's dtype
        A cell is visible if, for any row (a, b), its largest value is at least a and its smallest at most b. (a > b if
        the visible range lies between two neighboring numbers.)
    """

    ends: np.ndarray

    @classmethod
    def of(cls, volume, tf) -> Reach:
        """Reach of a TransferFunction on ``volume``."""
        return cls.of_values(volume, positive_intervals(pieces(tf.opacity)))

    @classmethod
    def of_values(cls, volume, shown) -> Reach:
        """Reach of ``shown``, (k, 2) ascending disjoint half-open intervals of physical values."""
        stored = volume.voxels.dtype, volume.slope, volume.intercept
        found = [_find_stored_ends(*stored, begin, end) for begin, end in np.asarray(shown).tolist()]
        kept = [ends for ends in found if ends is not None]
        return cls(np.array(kept, volume.voxels.dtype).reshape(-1, 2))

    @property
    def key(self) -> tuple:
        """Key for the stage cache."""
        return (self.ends.dtype.str, self.ends.tobytes())

    def covers(self, other: Reach) -> bool:
        """Whether this shows every cell that ``other`` shows."""
        inside = (self.ends[:, 0] <= other.ends[:, :1]) & (self.ends[:, 1] >= other.ends[:, 1:])
        return bool(inside.any(axis=1).all())

    def of_blocks(self, blocks: Blocks) -> np.ndarray:
        """(blocks along z, y, x) uint8: 0 where no voxel of a block is a corner of a visible cell."""
        low, high = blocks.low, blocks.high
        for axis in range(3):  # cells extend into the neighboring blocks
            low, high = with_neighbors(low, np.minimum, axis), with_neighbors(high, np.maximum, axis)
        shown = np.zeros(low.shape, bool)
        for least, most in self.ends:
            shown |= (high >= least) & (low <= most)
        return (shown & (low <= high)).astype(np.uint8)


class _Numbers:
    """The numbers of a type in ascending order, indexed by integers, for bisection."""

    def __init__(self, kind):
        self.kind = np.dtype(kind)
        self.bits = np.dtype(f"i{self.kind.itemsize}")
        if self.kind.kind == "f":
            self.first, self.last = self.order(-np.inf), self.order(np.inf)
        else:
            limits = np.iinfo(self.kind)
            self.first, self.last = int(limits.min), int(limits.max)

    def order(self, number) -> int:
        """Index of a number."""
        code = int(np.array(number, self.kind).view(self.bits))
        return code if code >= 0 else -(code & np.iinfo(self.bits).max) - 1

    def at(self, order: int):
        """Number with an index."""
        if self.kind.kind != "f":
            return self.kind.type(order)
        code = order if order >= 0 else (-(order + 1)) | np.iinfo(self.bits).min
        return np.array(code, self.bits).view(self.kind)[()]


@lru_cache(maxsize=64)
def _find_stored_ends(kind, slope: float, intercept: float, begin: float, end: float):
    """Row of ``Reach.ends`` for physical values [begin, end); None if no cell can reach them.

    ``kind``, ``slope``, ``intercept``: of the volume.  Kept, since most frames ask for the previous one's.
    """
    numbers = _Numbers(kind)

    def first_where(holds):
        """Index of the first number for which ``holds``; one past the last if there is none."""
        low, high = numbers.first - 1, numbers.last + 1
        while high - low > 1:
            middle = (low + high) // 2
            # Infinite values take the end values, so they lie inside an interval that extends to infinity.
            if holds(min(max(float(numbers.at(middle)) * slope + intercept, -LARGEST), LARGEST)):
                high = middle
            else:
                low = middle
        return high

    with np.errstate(over="ignore", invalid="ignore"):
        if slope > 0.0:
            least, past = first_where(lambda value: value >= begin), first_where(lambda value: value >= end)
        else:
            least, past = first_where(lambda value: value < end), first_where(lambda value: value < begin)
    if least > numbers.last or past - 1 < numbers.first:
        return None
    return numbers.at(least), numbers.at(past - 1)


def relevant_steps(volume, reach: Reach, blocks: Blocks, *, threads: int = 0):
    """Generator of fractions done: mark the voxels to keep.

    Parameters
    ----------
    volume : Volume
    threads : int
        0 for one per core.

    Returns
    -------
    (nz * ny, words) ndarray of uint64
        One bit per voxel of a row, lowest bit first.
    """
    nx, ny, nz = volume.shape_xyz
    bits = np.zeros((nz * ny, -(-nx // WORD)), np.uint64)
    voxels, near = read_only(np.asarray(volume.voxels)), reach.of_blocks(blocks)
    for first, last in cut_chunks(nz, ny * nx, multiple=BLOCK_Z):
        yield first / nz
        rows = slice(first // BLOCK_Z, -(-last // BLOCK_Z))
        if not near[rows].any():
            continue
        own = voxels, rows.start, rows.stop, near, reach.ends, bits
        run_either(threads, _mark_relevant, reference.mark_relevant, *own)
    return bits


def count_kept(bits: np.ndarray, *, threads: int = 0):
    """Count kept voxels.

    Parameters
    ----------
    bits : (nz * ny, words) ndarray of uint64
        As of ``relevant_steps``.
    threads : int
        0 for one per core.

    Returns
    -------
    counts : (nz * ny,) ndarray of int64
        Kept voxels of each row.
    row_pieces : (nz * ny,) ndarray of int32
        Connected pieces that they form.
    """
    counts, row_pieces = np.zeros(len(bits), np.int64), np.zeros(len(bits), np.int32)
    run_either(threads, _count_kept, reference.count_kept, bits, counts, row_pieces)
    return counts, row_pieces


def gather_kept(volume, bits, counted, blocks: Blocks, *, threads: int = 0) -> VisibleVoxels:
    """``gather_steps`` at once."""
    return drain(gather_steps(volume, bits, counted, blocks, threads=threads))


def gather_steps(volume, bits, counted, blocks: Blocks, *, threads: int = 0):
    """Generator of fractions done: list the kept voxels and their stored values.

    Parameters
    ----------
    volume : Volume
    bits : (nz * ny, words) ndarray of uint64
        As of ``relevant_steps``.
    counted : tuple
        What ``count_kept`` returned for ``bits``.
    threads : int
        0 for one per core.

    Returns
    -------
    VisibleVoxels
    """
    nx, ny, nz = volume.shape_xyz
    counts, row_pieces = counted
    row_start = row_offsets(counts)
    column = empty(row_start[-1], np.uint16 if nx <= 65536 else np.int32)
    stored = empty(row_start[-1], volume.voxels.dtype)
    rows = read_only(np.asarray(volume.voxels)).reshape(nz * ny, nx)
    word = f"u{stored.itemsize}"  # values are copied as they are: one kernel for each size
    for first, last in cut_chunks(nz, ny * nx, multiple=BLOCK_Z):
        yield first / nz
        part = slice(first * ny, last * ny)
        starts = row_start[first * ny : last * ny + 1]
        if compiled():
            with parallel_call(threads):
                _fill_kept(read_only(bits[part]), rows[part].view(word), starts, column, stored.view(word))
        else:
            own = slice(starts[0], starts[-1])
            reference.list_seen(reference.unpack(bits[part])[:, :nx] > 0, rows[part], column[own], stored[own])
    return VisibleVoxels(volume.shape_xyz, row_start, row_pieces, column, stored, blocks.nan_voxels, bits)


# --- kernels ----------------------------------------------------------------------------------------------------


@kernel
def _mark_relevant(voxels, first, last, near, ends, bits):
    """Mark planes of blocks [first, last) of ``voxels`` (nz, ny, nx). ``near``: blocks that may have kept voxels."""
    share_out(_mark_rows, (last - first) * near.shape[1], (voxels, first, near, ends, bits))


@kernel(inner=True, exact=True)
def _mark_rows(begin, end, voxels, first, near, ends, bits):
    """``_mark_relevant`` for rows of blocks [begin, end), numbered along y, then z, from plane ``first`` on.

    Cells that straddle two rows of blocks are tested for both, so that each row writes only its own voxels.
    """
    n_z, n_y, n_x = voxels.shape
    lowest, highest = np.empty(n_x, voxels.dtype), np.empty(n_x, voxels.dtype)
    seen = np.empty(n_x, np.uint8)
    kept = np.empty((BLOCK_Z, BLOCK_Y, bits.shape[1] * WORD), np.uint8)
    for row in range(begin, end):
        k, j = first + row // near.shape[1], row % near.shape[1]
        z0, y0 = k * BLOCK_Z, j * BLOCK_Y
        z1, y1 = min(z0 + BLOCK_Z, n_z), min(y0 + BLOCK_Y, n_y)
        kept[:] = np.uint8(0)
        some = False
        b = 0
        while b < near.shape[2]:
            if near[k, j, b] == 0:
                b += 1
                continue
            from_x = max(b * BLOCK_X - 1, 0)
            while b < near.shape[2] and near[k, j, b] != 0:
                b += 1
            to_x = min(b * BLOCK_X, n_x - 1)  # one past the last cell
            some = True
            for z in range(max(z0 - 1, 0), min(z1, n_z - 1)):
                for y in range(max(y0 - 1, 0), min(y1, n_y - 1)):
                    if not _see_cells(voxels, z, y, from_x, to_x, ends, lowest, highest, seen):
                        continue
                    _keep_in_rows(seen[from_x:to_x], kept[:, :, from_x : to_x + 1], z, y, z0, y0, z1, y1)
        if some:
            for z in range(z0, z1):
                for y in range(y0, y1):
                    _pack(kept[z - z0, y - y0], bits[z * n_y + y])


@kernel(inner=True, exact=True)
def _see_cells(voxels, z, y, from_x, to_x, ends, lowest, highest, seen):
    """Set seen[x] to whether cell (z, y, x) is visible, for x in [from_x, to_x); return whether any is."""
    a, b = voxels[z, y, from_x : to_x + 1], voxels[z, y + 1, from_x : to_x + 1]
    c, d = voxels[z + 1, y, from_x : to_x + 1], voxels[z + 1, y + 1, from_x : to_x + 1]
    low, high = lowest[: a.size], highest[: a.size]
    for x in range(a.size):  # NaN propagates, and compares as false below
        least = b[x] if b[x] < a[x] or b[x] != b[x] else a[x]
        least = c[x] if c[x] < least or c[x] != c[x] else least
        low[x] = d[x] if d[x] < least or d[x] != d[x] else least
        most = b[x] if b[x] > a[x] or b[x] != b[x] else a[x]
        most = c[x] if c[x] > most or c[x] != c[x] else most
        high[x] = d[x] if d[x] > most or d[x] != d[x] else most
    found = seen[from_x:to_x]
    found[:] = np.uint8(0)
    for k in range(ends.shape[0]):
        at_least, at_most = ends[k, 0], ends[k, 1]
        for x in range(found.size):
            # Smallest of both ends <= at_most and largest of both ends >= at_least, and neither is NaN.
            number = (low[x] == low[x]) & (low[x + 1] == low[x + 1])
            near = (low[x] <= at_most) | (low[x + 1] <= at_most)
            far = (high[x] >= at_least) | (high[x + 1] >= at_least)
            found[x] |= np.uint8(number & near & far)
    some = np.uint8(0)
    for x in range(found.size):
        some |= found[x]
    return some != np.uint8(0)


@kernel(inner=True, exact=True)
def _keep_in_rows(seen, kept, z, y, z0, y0, z1, y1):
    """As ``_keep_corners``, in those of the four rows around cells (z, y) that lie in the block of rows from (z0, y0)
    up to (z1, y1)."""
    for z_of in range(max(z, z0), min(z + 2, z1)):
        for y_of in range(max(y, y0), min(y + 2, y1)):
            _keep_corners(seen, kept[z_of - z0, y_of - y0])


@kernel(inline="always")
def _keep_corners(seen, kept):
    """Set both ends along x of the cells that are ``seen`` (n,), in ``kept`` (n + 1,)."""
    for x in range(seen.size):
        kept[x] |= seen[x]
    for x in range(seen.size):
        kept[x + 1] |= seen[x]


@kernel(inline="always")
def _pack(kept, bits):
    """Pack bytes of 0 and 1 to bits; eight bytes are read at once as a little-endian number."""
    gather = np.uint64(0x0102040810204080)
    for word in range(bits.size):
        packed = NO_BITS
        for part in range(8):
            packed |= ((eight_bytes(kept, 8 * (8 * word + part)) * gather) >> np.uint64(56)) << np.uint64(8 * part)
        bits[word] = packed


@kernel
def _count_kept(bits, counts, pieces):
    """Count the bits of each row, and the connected pieces that they form."""
    share_out(_count_rows, bits.shape[0], (bits, counts, pieces))


@kernel(inner=True)
def _count_rows(begin, end, bits, counts, pieces):
    """``_count_kept`` for rows [begin, end)."""
    for row in range(begin, end):
        count = piece = 0
        before = NO_BITS
        for word in range(bits.shape[1]):
            kept = bits[row, word]
            count += count_bits(kept)
            piece += count_bits(kept & ~((kept << ONE_BIT) | before))
            before = kept >> np.uint64(WORD - 1)
        counts[row] = count
        pieces[row] = piece


@kernel
def _fill_kept(bits, rows, row_start, column, stored):
    """Write ``column`` and ``stored`` of the voxels whose bits are set; ``rows`` (nz * ny, nx) stored values.

    Both as unsigned integers of their size.
    """
    share_out(_fill_rows, bits.shape[0], (bits, rows, row_start, column, stored))


@kernel(inner=True)
def _fill_rows(begin, end, bits, rows, row_start, column, stored):
    """``_fill_kept`` for rows [begin, end)."""
    for row in range(begin, end):
        at = row_start[row]
        for word in range(bits.shape[1]):
            kept = bits[row, word]
            while kept != NO_BITS:
                first = lowest_bit(kept)
                rest = ~(kept >> np.uint64(first))  # the run ends at the first bit that is not set
                count = lowest_bit(rest) if rest != NO_BITS else WORD
                count = min(count, WORD - first)
                x = word * WORD + first
                for i in range(count):
                    column[at + i] = x + i
                for i in range(count):
                    stored[at + i] = rows[row, x + i]
                at += count
                kept = kept & (kept + (ONE_BIT << np.uint64(first))) if first + count < WORD else NO_BITS
