"""Histogram and percentiles of a volume in physical values, computed slice by slice.

The volume is not copied. Values that are not finite are left out and counted separately.
"""

from dataclasses import dataclass

import numpy as np

from ..runtime.steps import drain
from ..scene import RleSplatError
from .counts import counts_values, list_stored_values
from .volume import LARGEST_VALUE, Volume

DIGIT_BITS = 16  # bits per pass of the radix selection; 2^16 counters fit in the cache


@dataclass(frozen=True, eq=False)
class Histogram:
    """Counts of physical values.

    Attributes
    ----------
    counts : (n,) ndarray of int64
    edges : (n + 1,) ndarray of float64
        Ascending, physical values. Bin b holds values v with edges[b] <= v < edges[b + 1]; the last bin includes its
        upper edge.
    below, above : int
        Number of finite values outside the edges.
    not_finite : int
        Number of NaN and infinite values.
    """

    counts: np.ndarray
    edges: np.ndarray
    below: int = 0
    above: int = 0
    not_finite: int = 0

    @property
    def centers(self) -> np.ndarray:
        """(n,) float64: the center of each bin."""
        return 0.5 * (self.edges[:-1] + self.edges[1:])

    @property
    def total(self) -> int:
        """Number of voxels, including those outside the edges."""
        return int(self.counts.sum()) + self.below + self.above + self.not_finite


def histogram(volume: Volume, bins: int = 256, limits: tuple[float, float] | None = None) -> Histogram:
    """Histogram of a volume's physical values.

    Bins of integer volumes are a whole number of stored steps wide and centered on stored values, so that no bin is
    empty only because it lies between two values. There may be fewer than ``bins``.

    Parameters
    ----------
    bins : int
        Largest number of bins.
    limits : (low, high) or None
        Physical range; None for the whole range of the volume.

    Raises
    ------
    RleSplatError
        If ``bins`` is below 1 or the limits are not two finite, ascending numbers.
    """
    return drain(histogram_steps(volume, bins, limits))


def histogram_steps(volume: Volume, bins: int = 256, limits: tuple[float, float] | None = None):
    """Generator of fractions done: ``histogram``."""
    if bins < 1:
        raise RleSplatError(f"A histogram needs at least one bin, not {bins}.")
    low, high = volume.value_range if limits is None else (float(limits[0]), float(limits[1]))
    if not (np.isfinite(low) and np.isfinite(high) and low <= high):
        raise RleSplatError(f"The limits of a histogram must be finite and ascending, not {low:g} and {high:g}.")
    edges = _integer_edges(volume, bins, low, high) if volume.voxels.dtype.kind in "iu" else None
    if edges is None:
        # A constant volume gets one bin of width one around its value. No bin is narrower than float64 resolves.
        width = max(1.0 if low == high else 0.0, 2.0 * bins * np.spacing(max(abs(low), abs(high))))
        if high - low < width:
            low, high = 0.5 * (low + high) - 0.5 * width, 0.5 * (low + high) + 0.5 * width
        edges = np.linspace(low, high, bins + 1)
    if counts_values(volume.voxels.dtype):
        return _from_counts(volume, edges)
    counts = np.zeros(edges.size - 1, dtype=np.int64)
    below = above = not_finite = 0
    for z, stored in enumerate(volume.voxels):
        yield z / len(volume.voxels)
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
    """Histogram from the counts of stored values, without reading the voxels again."""
    occurs = volume.value_counts
    values = volume.physical(list_stored_values(volume.voxels.dtype))
    counts = np.histogram(values, bins=edges.size - 1, range=(edges[0], edges[-1]), weights=occurs)[0]
    below, above = int(occurs[values < edges[0]].sum()), int(occurs[values > edges[-1]].sum())
    return Histogram(counts.astype(np.int64), edges, below, above)


def _integer_edges(volume: Volume, bins: int, low: float, high: float) -> np.ndarray:
    """Edges half a stored step off the stored values; all bins have the same whole number of steps."""
    step = abs(volume.slope)
    steps = max(1, round((high - low) / step) + 1)
    width = -(-steps // bins)
    n = -(-steps // width)
    return low - 0.5 * step + step * width * np.arange(n + 1, dtype=np.float64)


def percentiles(volume: Volume, percents=(1.0, 99.9)) -> np.ndarray:
    """Exact percentiles of the finite values of a volume; RleSplatError if a percentage is outside 0 to 100.

    The q-th percentile is the smallest value that at least q % of the finite voxels do not exceed (numpy's
    "inverted_cdf"). It is found by radix selection, with one pass over the volume for every 16 bits of a voxel.

    Parameters
    ----------
    percents : sequence of float
        0 to 100.

    Returns
    -------
    (len(percents),) ndarray of float64
        Physical values; 0 if no voxel is finite.
    """
    return drain(percentile_steps(volume, percents))


def percentile_steps(volume: Volume, percents=(1.0, 99.9)):
    """Generator of fractions done: ``percentiles``."""
    percents = np.atleast_1d(np.asarray(percents, dtype=np.float64))
    if not ((percents >= 0.0) & (percents <= 100.0)).all():
        raise RleSplatError("Percentiles must be numbers from 0 to 100.")
    if counts_values(volume.voxels.dtype):
        total, first_counts = volume.voxels.size, volume.value_counts[None]
    else:
        total, first_counts = yield from _digit_count_steps(volume, {0: 0}, 0)
    if total == 0:
        return np.zeros(percents.size)
    if volume.slope < 0.0:  # the physical order is the reverse of the stored order
        ranks = total - np.maximum(1, np.ceil(percents / 100.0 * total)).astype(np.int64)
    else:
        ranks = np.maximum(1, np.ceil(percents / 100.0 * total)).astype(np.int64) - 1
    prefixes, ranks = _descend(np.zeros(percents.size, dtype=np.uint64), ranks, first_counts, {0: 0})
    for digit in range(1, _digits(volume.voxels.dtype)):
        slots = {int(p): s for s, p in enumerate(np.unique(prefixes))}
        _, counts = yield from _digit_count_steps(volume, slots, digit)
        prefixes, ranks = _descend(prefixes, ranks, counts, slots)
    with np.errstate(over="ignore"):
        values = volume.physical(_from_keys(prefixes, volume.voxels.dtype))
    return np.clip(values, -LARGEST_VALUE, LARGEST_VALUE)


def _digits(dtype: np.dtype) -> int:
    """Number of 16-bit digits of a voxel type."""
    return max(1, dtype.itemsize * 8 // DIGIT_BITS)


def _descend(prefixes, ranks, counts, slots):
    """Refine by one digit: append to each prefix the digit that holds its rank; return prefixes and remaining ranks."""
    longer, left = np.empty_like(prefixes), np.empty_like(ranks)
    for i, (prefix, rank) in enumerate(zip(prefixes, ranks)):
        reached = np.cumsum(counts[slots[int(prefix)]])
        digit = int(np.searchsorted(reached, rank, side="right"))
        left[i] = rank - (reached[digit - 1] if digit else 0)
        longer[i] = (int(prefix) << DIGIT_BITS) | digit
    return longer, left


def _digit_count_steps(volume: Volume, slots: dict, digit: int):
    """Generator of fractions done: (number of finite voxels, counts of each 16-bit digit after each prefix).

    ``slots``: prefix -> row of the counts.
    """
    bits = max(DIGIT_BITS, volume.voxels.dtype.itemsize * 8)
    shift = bits - DIGIT_BITS * (digit + 1)
    counts = np.zeros((len(slots), 1 << DIGIT_BITS), dtype=np.int64)
    total = 0
    for z, plane in enumerate(volume.voxels):
        yield (digit + z / len(volume.voxels)) / _digits(volume.voxels.dtype)
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
    """The lowest 16 bits of ``keys``, as indices."""
    return (keys & keys.dtype.type((1 << DIGIT_BITS) - 1)).astype(np.intp)


def _keys(plane: np.ndarray) -> np.ndarray:
    """Unsigned integers in the order of the finite values of ``plane``.

    The sign bit is flipped; for negative floats all bits are flipped, since their patterns are in reverse order.
    """
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
    """Stored values of type ``dtype`` from their uint64 keys (see ``_keys``)."""
    unsigned = np.dtype(f"u{dtype.itemsize}").type
    patterns = keys.astype(unsigned)
    if dtype.kind == "u":
        return patterns
    sign = unsigned(1) << unsigned(dtype.itemsize * 8 - 1)
    if dtype.kind == "i":
        return (patterns ^ sign).view(dtype)
    return np.where(patterns & sign, patterns ^ sign, ~patterns).view(dtype)
