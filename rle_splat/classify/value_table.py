"""A transfer function baked into a table over stored values: what sheets of the scalar are classified by.

    entry i  ->  (extinction * RGB, extinction) of the stored value  first + i / rate

The nearest entry is taken.  The table spans the values that are shown; one more entry, behind the last, is transparent,
for all others and for samples that need a voxel which is not kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .classification import optical_depth
from .points import pieces, positive_intervals

FEWEST, MOST = 1 << 10, 1 << 14  # entries; what is in use of the larger still fits the second cache
FINEST = 1.0 / 512.0  # of opacity, from one entry to the next on the steepest ramp, if there is room
AT_ONCE = 1 << 16  # values of large types that are looked up together
BEYOND = 2.0  # times the distance between a function's first and last point: how far a table goes beyond these
ROUNDING = 1e-6  # of the largest value: what float32 sums of it may be off by


@dataclass(frozen=True, eq=False)
class ValueTable:
    """``entries``: (n + 1, 4) float32, scene-linear, extinction in 1 / world length; the last one is transparent.

    ``sums``: (n + 1, 4) float32, of all entries before each, for the mean over a range of values.
    ``origin``, ``rate``: stored value where the first entry begins, entries per stored value.  ``least``: below all
    there is.  ``low``, ``high``: stored values beyond which nothing is shown.  ``nearest``, ``furthest``: values beyond
    stand for these, where the function shows its end values far beyond its points.  ``most_color``: largest channel of
    any visible colour.
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
        return self.entries.nbytes + self.sums.nbytes


def value_table(volume, tf, value_range, distance: float, entries: int = 0) -> ValueTable:
    """The table of ``tf`` over the stored values of ``volume``.

    ``value_range``: smallest and largest finite stored value there is.  ``distance``: world length that opacity refers
    to.  ``entries``: about how many, 0 for as many as the function's steepest ramp asks for.
    """
    shown = (np.clip(positive_intervals(pieces(tf.opacity)), -1e300, 1e300) - volume.intercept) / volume.slope
    least, most = (float(end) for end in value_range)
    first, last = max(float(shown.min(initial=np.inf)), least), min(float(shown.max(initial=-np.inf)), most)
    slack = ROUNDING * max(abs(least), abs(most))
    if not first <= last:  # nothing that there is is shown
        nothing = np.zeros((2, 4), np.float32)
        return ValueTable(nothing, nothing, least, 0.0, least, math.inf, -math.inf, -math.inf, math.inf, 0.0)
    first, last, nearest, furthest = _within_reach(volume, tf, first, last)
    wanted = entries or _entries_for(tf, abs(volume.slope) * (last - first))
    if volume.voxels.dtype.kind in "iu":
        # Whole numbers lie inside entries, never where two meet, or rounding would choose between the two.
        first, last = math.floor(first), math.ceil(last)
        span = last - first
        rate = float(math.ceil(wanted / max(span, 1))) if wanted >= span else 1.0 / (int(span / wanted) | 1)
    else:
        rate = wanted / (last - first) if last > first else 1.0
    count = math.ceil((last - first) * rate) + 1
    values = volume.physical(first + np.arange(count) / rate)
    alpha = np.asarray(tf.alpha_at(values), np.float64)
    color = np.asarray(tf.color_at(values), np.float64)
    made = np.zeros((count + 1, 4), np.float32)
    made[:count, 3] = optical_depth(alpha) / distance
    made[:count, :3] = made[:count, 3:] * color
    most_color = float(color[alpha > 0.0].max(initial=0.0))
    low, high = max(float(shown.min()), least) - slack, float(shown.max()) + slack
    low, high = min(low, furthest), max(high, nearest)  # as are the values that these stand for
    sums = np.zeros((count + 1, 4))
    np.cumsum(made[:count], axis=0, dtype=np.float64, out=sums[1:])
    sums, below = sums.astype(np.float32), least - slack - 1e-6
    return ValueTable(made, sums, first - 0.5 / rate, rate, below, low, high, nearest, furthest, most_color)


def extinction_of(table: ValueTable, stored, kind, infinite=()) -> np.ndarray:
    """(m,) float32 extinction by ``table`` of ``stored`` values (m,) of type ``kind``; 8- and 16-bit ones may come as
    unsigned bit patterns.  ``infinite``: what stands for minus and plus infinity, no numbers where nothing does."""
    kind = np.dtype(kind)
    if kind.kind in "iu" and kind.itemsize <= 2:
        patterns = np.arange(1 << (8 * kind.itemsize), dtype=f"u{kind.itemsize}")
        return _looked_up(table, patterns.view(kind).astype(np.float64))[stored.view(patterns.dtype)]
    found = np.empty(len(stored), np.float32)
    for first in range(0, len(stored), AT_ONCE):
        values = stored[first : first + AT_ONCE].astype(np.float64)
        found[first : first + AT_ONCE] = _looked_up(table, np.clip(values, *infinite) if infinite else values)
    return found


def _looked_up(table: ValueTable, values) -> np.ndarray:
    """(n,) float32 extinction of float64 stored values."""
    shown = (values >= table.low) & (values <= table.high)
    place = (np.clip(values, table.nearest, table.furthest) - table.origin) * table.rate
    last = len(table.entries) - 1  # the transparent one
    place = np.where(shown, np.clip(np.nan_to_num(place), 0.0, last - 1.0), last)
    return table.entries[place.astype(np.int64), 3]


def _within_reach(volume, tf, first: float, last: float):
    """The ends of a table, not so far beyond the points of ``tf`` that its entries would be too few between them; and
    the ends that stand for values beyond, infinite where there are none."""
    points = [(value - volume.intercept) / volume.slope for value, *_ in (*tf.opacity, *tf.color)]
    reach = BEYOND * (max(points) - min(points)) or math.inf
    nearest, furthest = min(points) - reach, max(points) + reach
    ends = nearest if nearest > first else -math.inf, furthest if furthest < last else math.inf
    return (*(min(max(end, nearest), furthest) for end in (first, last)), *ends)


def _entries_for(tf, width: float) -> int:
    """So many entries over ``width`` physical values that neighbours differ little in opacity, within limits."""
    table = np.array(sorted(tf.opacity, key=lambda point: point[0]), np.float64)
    gaps, rises = np.diff(table[:, 0]), np.abs(np.diff(table[:, 1]))
    steepest = float(np.divide(rises, gaps, out=np.zeros_like(gaps), where=gaps > 0.0).max(initial=0.0))
    return int(min(max(steepest * width / FINEST, FEWEST), MOST))
