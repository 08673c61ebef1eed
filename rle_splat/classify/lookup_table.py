"""Lookup table of a transfer function over stored values, by which post-classified sheets classify.

    entry i  ->  (extinction * RGB, extinction) of the stored value  first + i / rate

The nearest entry is used. The table spans the visible values. One more entry, after the last, is transparent, for all
other values and for samples that need a voxel that is not kept.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..runtime.steps import drain
from ..scene import RleSplatError
from ..volume.counts import counts_values
from .classification import optical_depth
from .points import LARGEST, pieces, positive_intervals

FEWEST, MOST = 1 << 10, 1 << 14  # entries; the part of a large table that is in use fits into the L2 cache
FINEST = 1.0 / 512.0  # wanted difference of opacity between neighboring entries on the steepest ramp
AT_ONCE = 1 << 16  # values of large types that are looked up at once
FOUND_AT_ONCE = 1 << 19  # values that are looked up between two chances to cancel, 2 ms of small types
BEYOND = 2.0  # a table extends this many times the span of a function's points beyond them
ROUNDING = 1e-6  # rounding error of float32 sums, relative to the largest value
LARGEST_SUM = 256.0  # of the values that are rounded at a function's points, relative to the largest point

LARGEST_RATE = 1e37  # within float32, and so is the number of an entry before it is limited to the table


@dataclass(frozen=True, eq=False)
class LookupTable:
    """Lookup table of a transfer function.

    Attributes
    ----------
    entries : (n + 1, 4) ndarray of float32
        Scene-linear (extinction * RGB, extinction) in 1 / world length; the last entry is transparent.
    sums : (n + 1, 4) ndarray of float32
        Sum of all entries before each, for the mean over a range of values.
    origin : float
        Stored value at which the first entry begins.
    rate : float
        Entries per stored value.
    least : float
        A value below all stored values.
    low, high : float
        Stored values beyond which nothing is visible.
    nearest, furthest : float
        Values beyond these are clamped to them: the table ends there, and the function has its end values.
    most_color : float
        Largest channel of any visible color.
    """

    entries: np.ndarray
    sums: np.ndarray
    origin: float
    rate: float
    least: float
    low: float
    high: float
    nearest: float
    furthest: float
    most_color: float

    def __post_init__(self):
        self.entries.setflags(write=False)
        self.sums.setflags(write=False)

    @property
    def nbytes(self) -> int:
        """Bytes of the table."""
        return self.entries.nbytes + self.sums.nbytes


def lookup_table(volume, tf, value_range, distance: float, entries: int = 0) -> LookupTable:
    """Make the lookup table of a transfer function.

    Parameters
    ----------
    volume : Volume
    tf : TransferFunction
    value_range : (low, high)
        Smallest and largest finite stored value.
    distance : float
        World length to which opacity refers.
    entries : int
        Approximate number of entries; 0 for as many as the steepest ramp needs.

    Raises
    ------
    RleSplatError
        Where the values shown are too close to each other to be distinct in float32.
    """
    with np.errstate(over="ignore"):
        shown = (np.clip(positive_intervals(pieces(tf.opacity)), -LARGEST, LARGEST) - volume.intercept) / volume.slope
    least, most = (float(end) for end in value_range)
    first, last = max(float(shown.min(initial=np.inf)), least), min(float(shown.max(initial=-np.inf)), most)
    # Stored values
    points = [(value - volume.intercept) / volume.slope for value, *_ in (*tf.opacity, *tf.color)]
    slack = ROUNDING * min(max(abs(least), abs(most)), LARGEST_SUM * max(map(abs, points)))
    if not first <= last:  # no stored value is visible
        nothing = np.zeros((2, 4), np.float32)
        return LookupTable(nothing, nothing, least, 0.0, least, math.inf, -math.inf, -math.inf, math.inf, 0.0)
    first, last, nearest, furthest = _within_reach(points, first, last)
    wanted = entries or _entries_for(tf, abs(volume.slope) * (last - first))
    if volume.voxels.dtype.kind in "iu":
        # Integers are at the center of an entry, never at the border of two, where rounding would choose.
        first, last = math.floor(first), math.ceil(last)
        span = last - first
        rate = float(math.ceil(wanted / max(span, 1))) if wanted >= span else 1.0 / (int(span / wanted) | 1)
    else:
        rate = wanted / (last - first) if last > first else 1.0
    if rate > LARGEST_RATE:
        raise RleSplatError(
            f"The stored values that the transfer function shows lie within {last - first:.3g} of each other, too "
            "close for the classification post; scale the values, or choose the classification pre."
        )
    count = math.ceil((last - first) * rate) + 1
    values = volume.physical(first + np.arange(count) / rate)
    alpha = np.asarray(tf.alpha_at(values), np.float64)
    color = np.asarray(tf.color_at(values), np.float64)
    made = np.zeros((count + 1, 4), np.float32)
    made[:count, 3] = optical_depth(alpha) / distance
    made[:count, :3] = made[:count, 3:] * color
    most_color = float(color[alpha > 0.0].max(initial=0.0))
    low, high = max(float(shown.min()), least) - slack, float(shown.max()) + slack
    low, high = min(low, furthest), max(high, nearest)  # include the values to which others are clamped
    sums = np.zeros((count + 1, 4))
    np.cumsum(made[:count], axis=0, dtype=np.float64, out=sums[1:])
    sums, below = sums.astype(np.float32), least - ROUNDING * max(abs(least), abs(most)) - 1e-6
    return LookupTable(made, sums, first - 0.5 / rate, rate, below, low, high, nearest, furthest, most_color)


def extinction_steps(table: LookupTable, stored, kind, infinite=()):
    """Generator of fractions done: find the extinction of stored values.

    Parameters
    ----------
    stored : (m,) ndarray
        Stored values; those of 8- and 16-bit types may be unsigned bit patterns.
    kind : dtype
        Type of the stored values.
    infinite : (low, high) or ()
        Values that replace minus and plus infinity, if any.

    Returns
    -------
    (m,) ndarray of float32
        1 / world length.
    """
    kind, found = np.dtype(kind), np.empty(len(stored), np.float32)
    stored = stored.view(kind) if counts_values(kind) else stored
    if counts_values(kind) and len(stored) >= 1 << (8 * kind.itemsize):
        patterns = np.arange(1 << (8 * kind.itemsize), dtype=f"u{kind.itemsize}")
        of_patterns, stored = _look_up(table, patterns.view(kind).astype(np.float64)), stored.view(patterns.dtype)
        for first in range(0, len(stored), FOUND_AT_ONCE):
            yield first / len(stored)
            found[first : first + FOUND_AT_ONCE] = of_patterns[stored[first : first + FOUND_AT_ONCE]]
        return found
    for first in range(0, len(stored), AT_ONCE):
        if first % FOUND_AT_ONCE == 0:
            yield first / len(stored)
        values = stored[first : first + AT_ONCE].astype(np.float64)
        found[first : first + AT_ONCE] = _look_up(table, np.clip(values, *infinite) if infinite else values)
    return found


def extinction_of(table: LookupTable, stored, kind, infinite=()) -> np.ndarray:
    """(m,) float32: as ``extinction_steps``, at once."""
    return drain(extinction_steps(table, stored, kind, infinite))


def _look_up(table: LookupTable, values) -> np.ndarray:
    """(n,) float32 extinction of stored values (n,) float64."""
    shown = (values >= table.low) & (values <= table.high)
    entry = (np.clip(values, table.nearest, table.furthest) - table.origin) * table.rate
    last = len(table.entries) - 1  # the transparent entry
    entry = np.where(shown, np.clip(np.nan_to_num(entry), 0.0, last - 1.0), last)
    return table.entries[entry.astype(np.int64), 3]


def _within_reach(points, first: float, last: float):
    """Limit the ends of a table to the neighborhood of a function's points, so that entries between them suffice.

    Returns the two ends, and the values to which values beyond are clamped (infinite where the ends are not limited).
    """
    reach = BEYOND * (max(points) - min(points)) or math.inf
    nearest, furthest = min(points) - reach, max(points) + reach
    ends = nearest if nearest > first else -math.inf, furthest if furthest < last else math.inf
    return (*(min(max(end, nearest), furthest) for end in (first, last)), *ends)


def _entries_for(tf, width: float) -> int:
    """Entries over ``width`` physical values such that neighbors differ by FINEST in opacity, FEWEST to MOST."""
    table = np.array(sorted(tf.opacity, key=lambda point: point[0]), np.float64)
    gaps, rises = np.diff(table[:, 0]), np.abs(np.diff(table[:, 1]))
    steepest = float(np.divide(rises, gaps, out=np.zeros_like(gaps), where=gaps > 0.0).max(initial=0.0))
    return int(min(max(steepest * width / FINEST, FEWEST), MOST))
