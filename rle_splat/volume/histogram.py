"""How often each value occurs: histogram and percentiles of a volume, slice by slice, in physical values.

No second copy of the volume is made.  Values that are not finite are left out and counted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..scene import RleSplatError
from .counts import counts_values, stored_values
from .volume import LARGEST_VALUE, Volume

DIGIT_BITS = 16  # one pass of the radix selection fixes this many bits; 2^16 counters fit in the cache


@dataclass(frozen=True, eq=False)
class Histogram:
    """Counts of physical values.

    ``counts``: (n,) int64.  ``edges``: (n + 1,) float64 ascending, physical; bin b holds values v with
    edges[b] <= v < edges[b + 1], the last bin its upper edge too.  ``below`` and ``above`` count finite values
    outside the edges, ``not_finite`` NaN and infinities.
    """

    counts: np.ndarray
    edges: np.ndarray
    below: int = 0
    above: int = 0
    not_finite: int = 0

    @property
    def centers(self) -> np.ndarray:
        """(n,) float64: the middle of each bin."""
        return 0.5 * (self.edges[:-1] + self.edges[1:])

    @property
    def total(self) -> int:
        """How many voxels were looked at."""
        return int(self.counts.sum()) + self.below + self.above + self.not_finite


def histogram(volume: Volume, bins: int = 256, limits: tuple[float, float] | None = None) -> Histogram:
    """The histogram of a volume's physical values in at most ``bins`` bins, over ``limits`` or the whole range.

    Integer volumes get bins a whole number of stored steps wide, centred on the stored values, so that no bin is
    empty merely because it falls between two of them; that may need fewer bins than were asked for.
    """
    if bins < 1:
        raise RleSplatError("A histogram needs at least one bin.")
    low, high = volume.value_range if limits is None else (float(limits[0]), float(limits[1]))
    if not (np.isfinite(low) and np.isfinite(high) and low <= high):
        raise RleSplatError("The limits of a histogram must be two finite numbers, the lower one first.")
    edges = _integer_edges(volume, bins, low, high) if volume.voxels.dtype.kind in "iu" else None
    if edges is None:
        # A constant volume: one value in the middle of a bin of width one.  No bin is narrower than float64 resolves.
        width = max(1.0 if low == high else 0.0, 2.0 * bins * np.spacing(max(abs(low), abs(high))))
        if high - low < width:
            low, high = 0.5 * (low + high) - 0.5 * width, 0.5 * (low + high) + 0.5 * width
        edges = np.linspace(low, high, bins + 1)
    if counts_values(volume.voxels.dtype):
        return _from_counts(volume, edges)
    counts = np.zeros(edges.size - 1, dtype=np.int64)
    below = above = not_finite = 0
    for stored in volume.voxels:
        values = volume.physical(stored).ravel()
        finite = np.isfinite(values)
        if not finite.all():
            not_finite += int(values.size - finite.sum())
            values = values[finite]
        below += int((values < edges[0]).sum())
        above += int((values > edges[-1]).sum())
        counts += np.histogram(values, bins=edges.size - 1, range=(edges[0], edges[-1]))[0]
    return Histogram(counts, edges, below, above, not_finite)


def _from_counts(volume: Volume, edges: np.ndarray) -> Histogram:
    """The same from how often each stored value occurs, without another look at the voxels."""
    occurs = volume.value_counts
    values = volume.physical(stored_values(volume.voxels.dtype))
    counts = np.histogram(values, bins=edges.size - 1, range=(edges[0], edges[-1]), weights=occurs)[0]
    below, above = int(occurs[values < edges[0]].sum()), int(occurs[values > edges[-1]].sum())
    return Histogram(counts.astype(np.int64), edges, below, above)


def _integer_edges(volume: Volume, bins: int, low: float, high: float) -> np.ndarray:
    """Edges half a stored step off the stored values, each bin the same whole number of steps wide."""
    step = abs(volume.slope)
    steps = max(1, round((high - low) / step) + 1)
    width = -(-steps // bins)
    n = -(-steps // width)
    return low - 0.5 * step + step * width * np.arange(n + 1, dtype=np.float64)


def percentiles(volume: Volume, percents=(1.0, 99.9)) -> np.ndarray:
    """Exact percentiles of the finite values, physical, float64 (len(percents),).

    The q-th percentile is the smallest value that at least q % of the finite voxels do not exceed (numpy's
    "inverted_cdf"), found by a radix selection in one pass over the volume for each 16 bits of a voxel.
    With no finite voxel every percentile is 0.
    """
    percents = np.atleast_1d(np.asarray(percents, dtype=np.float64))
    if not ((percents >= 0.0) & (percents <= 100.0)).all():
        raise RleSplatError("Percentiles are asked for by numbers from 0 to 100.")
    if counts_values(volume.voxels.dtype):
        total, first_counts = volume.voxels.size, volume.value_counts[None]
    else:
        total, first_counts = _digit_counts(volume, {0: 0}, 0)
    if total == 0:
        return np.zeros(percents.size)
    if volume.slope < 0.0:  # physical order is the stored order backwards
        ranks = total - np.maximum(1, np.ceil(percents / 100.0 * total)).astype(np.int64)
    else:
        ranks = np.maximum(1, np.ceil(percents / 100.0 * total)).astype(np.int64) - 1
    prefixes, ranks = _descend(np.zeros(percents.size, dtype=np.uint64), ranks, first_counts, {0: 0})
    for digit in range(1, _digits(volume.voxels.dtype)):
        slots = {int(p): s for s, p in enumerate(np.unique(prefixes))}
        _, counts = _digit_counts(volume, slots, digit)
        prefixes, ranks = _descend(prefixes, ranks, counts, slots)
    with np.errstate(over="ignore"):
        values = volume.physical(_from_keys(prefixes, volume.voxels.dtype))
    return np.clip(values, -LARGEST_VALUE, LARGEST_VALUE)


def _digits(dtype: np.dtype) -> int:
    return max(1, dtype.itemsize * 8 // DIGIT_BITS)


def _descend(prefixes, ranks, counts, slots):
    """One digit further: the digit in which each rank falls, and its rank among the values that share it."""
    longer, left = np.empty_like(prefixes), np.empty_like(ranks)
    for i, (prefix, rank) in enumerate(zip(prefixes, ranks)):
        reached = np.cumsum(counts[slots[int(prefix)]])
        digit = int(np.searchsorted(reached, rank, side="right"))
        left[i] = rank - (reached[digit - 1] if digit else 0)
        longer[i] = (int(prefix) << DIGIT_BITS) | digit
    return longer, left


def _digit_counts(volume: Volume, slots: dict, digit: int):
    """How often each 16-bit digit follows each prefix in ``slots``; also the number of finite voxels."""
    bits = max(DIGIT_BITS, volume.voxels.dtype.itemsize * 8)
    shift = bits - DIGIT_BITS * (digit + 1)
    counts = np.zeros((len(slots), 1 << DIGIT_BITS), dtype=np.int64)
    total = 0
    for plane in volume.voxels:
        keys = _keys(plane)
        total += keys.size
        if digit == 0:
            counts[0] += np.bincount(_low_digit(keys >> keys.dtype.type(shift)), minlength=1 << DIGIT_BITS)
            continue
        prefix_of = keys >> keys.dtype.type(shift + DIGIT_BITS)
        for prefix, slot in slots.items():
            chosen = keys[prefix_of == keys.dtype.type(prefix)] >> keys.dtype.type(shift)
            counts[slot] += np.bincount(_low_digit(chosen), minlength=1 << DIGIT_BITS)
    return total, counts


def _low_digit(keys: np.ndarray) -> np.ndarray:
    return (keys & keys.dtype.type((1 << DIGIT_BITS) - 1)).astype(np.intp)


def _keys(plane: np.ndarray) -> np.ndarray:
    """Unsigned integers in the order of the finite values of ``plane``: sign bit flipped, and for floats below
    zero all bits flipped, since their patterns run backwards."""
    if plane.dtype.kind == "f":
        finite = plane[np.isfinite(plane)]
        unsigned = np.dtype(f"u{plane.dtype.itemsize}").type
        patterns = finite.view(unsigned)
        sign = unsigned(1) << unsigned(plane.dtype.itemsize * 8 - 1)
        return np.where(patterns & sign, ~patterns, patterns | sign)
    flat = np.ravel(plane)
    if plane.dtype.kind == "u":
        return flat if plane.dtype.itemsize > 1 else flat.astype(np.uint16)
    unsigned = np.dtype(f"u{plane.dtype.itemsize}").type
    keys = flat.view(unsigned) ^ (unsigned(1) << unsigned(plane.dtype.itemsize * 8 - 1))
    return keys if plane.dtype.itemsize > 1 else keys.astype(np.uint16)


def _from_keys(keys: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """The stored values whose keys (see ``_keys``) are given as uint64."""
    unsigned = np.dtype(f"u{dtype.itemsize}").type
    patterns = keys.astype(unsigned)
    if dtype.kind == "u":
        return patterns
    sign = unsigned(1) << unsigned(dtype.itemsize * 8 - 1)
    if dtype.kind == "i":
        return (patterns ^ sign).view(dtype)
    return np.where(patterns & sign, patterns ^ sign, ~patterns).view(dtype)
