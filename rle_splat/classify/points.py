"""Piecewise linear functions of the scalar, as flat arrays for kernels.

A repeated value is a step. Steps are right-continuous. Outside the points the end values hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..runtime.jit import kernel
from ..volume.volume import LARGEST_VALUE

LARGEST = LARGEST_VALUE  # +inf is clamped to it, and -inf to its negative, where the end values hold
SMALLEST_GAP = 1e-300  # closer points are a step, so that one over the gap is finite


@dataclass(frozen=True, eq=False)
class Pieces:
    """A piecewise linear function.

    Attributes
    ----------
    values : (n,) ndarray of float64
        Physical values of the points, ascending.
    heights : (n, channels) ndarray of float64
        Function values at the points.
    rates : (n,) ndarray of float64
        One over the gap to the next point; 0 after the last point and at a step.
    """

    values: np.ndarray
    heights: np.ndarray
    rates: np.ndarray


def pieces(points) -> Pieces:
    """Make Pieces from points.

    Parameters
    ----------
    points : sequence of (value, height, ...)
        In any order; equal values keep their order, so the last one is the upper end of the step.
    """
    table = np.array(points, dtype=np.float64)
    table = table[np.argsort(table[:, 0], kind="stable")]
    gaps = np.append(np.diff(table[:, 0]), 0.0)
    rates = np.divide(1.0, gaps, out=np.zeros_like(gaps), where=gaps > SMALLEST_GAP)
    return Pieces(np.ascontiguousarray(table[:, 0]), np.ascontiguousarray(table[:, 1:]), rates)


def positive_intervals(function: Pieces) -> np.ndarray:
    """Intervals of values in which the first channel is above 0.

    Only comparisons of values are used, so that rounding of the function cannot change which voxels are visible.

    Returns
    -------
    (k, 2) ndarray of float64
        Disjoint ascending half-open intervals [a, b).
    """
    x, y = function.values, function.heights[:, 0]
    found = []

    def add(low, high):
        """Append [low, high), merged with the previous interval if they touch."""
        if found and found[-1][1] == low:
            found[-1][1] = high
        elif low < high:
            found.append([low, high])

    if y[0] > 0.0:
        add(-np.inf, x[0])
    for i in range(len(x)):
        is_last = i + 1 == len(x)
        if not is_last and x[i + 1] == x[i]:
            continue
        after = np.nextafter(x[i], np.inf)
        if y[i] > 0.0:
            add(x[i], after)
        if is_last:
            if y[i] > 0.0:
                add(after, np.inf)
        elif y[i] > 0.0 or y[i + 1] > 0.0:
            add(after, x[i + 1])
    return np.array(found, dtype=np.float64).reshape(-1, 2)


@kernel(exact=True)
def piece_of(values, value):
    """Index of the last point at or below ``value`` (a finite physical scalar); -1 before the first."""
    low, high = -1, values.size
    while high - low > 1:
        middle = (low + high) // 2
        if values[middle] <= value:
            low = middle
        else:
            high = middle
    return low


@kernel(exact=True)
def height_at(heights, rates, values, piece, value, channel):
    """Height of one channel at ``value``, which lies in ``piece`` (see ``piece_of``)."""
    if piece < 0:
        return heights[0, channel]
    if rates[piece] == 0.0:
        return heights[piece, channel]
    share = min((value - values[piece]) * rates[piece], 1.0)
    return heights[piece, channel] * (1.0 - share) + heights[piece + 1, channel] * share
