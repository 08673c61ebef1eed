"""Piecewise linear functions of the scalar as flat arrays that kernels can read.

A repeated value is a step and steps are right-continuous; outside the points the end values hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..runtime.jit import kernel
from ..volume.volume import LARGEST_VALUE

LARGEST = LARGEST_VALUE  # stands for +inf, and its opposite for -inf: the end values hold there
SMALLEST_GAP = 1e-300  # points closer than this are a step: one over the gap has to be a number


@dataclass(frozen=True, eq=False)
class Pieces:
    """``values`` (n,) ascending; ``heights`` (n, channels) at them; ``rates`` (n,), one over the gap to the next
    point, 0 after the last one and at a step.  All float64, values physical."""

    values: np.ndarray
    heights: np.ndarray
    rates: np.ndarray


def pieces(points) -> Pieces:
    """Points ((value, height...), ...) in any order; equal values keep their order, so the last one is the step's
    upper end."""
    table = np.array(points, dtype=np.float64)
    table = table[np.argsort(table[:, 0], kind="stable")]
    gaps = np.append(np.diff(table[:, 0]), 0.0)
    rates = np.divide(1.0, gaps, out=np.zeros_like(gaps), where=gaps > SMALLEST_GAP)
    return Pieces(np.ascontiguousarray(table[:, 0]), np.ascontiguousarray(table[:, 1:]), rates)


def positive_intervals(function: Pieces) -> np.ndarray:
    """(k, 2) float64 disjoint ascending half-open intervals [a, b) of values where the first channel is above 0.

    Found by comparing values only, so no rounding of the function can flip a voxel between visible and not.
    """
    x, y = function.values, function.heights[:, 0]
    found = []

    def add(low, high):
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
    """Height of one channel at ``value``, which lies in piece number ``piece`` (see ``piece_of``)."""
    if piece < 0:
        return heights[0, channel]
    if rates[piece] == 0.0:
        return heights[piece, channel]
    share = min((value - values[piece]) * rates[piece], 1.0)
    return heights[piece, channel] * (1.0 - share) + heights[piece + 1, channel] * share


def heights_at_numpy(function: Pieces, values: np.ndarray) -> np.ndarray:
    """(m, channels) float64 heights at (m,) finite physical values, by the same arithmetic as the kernels."""
    piece = np.searchsorted(function.values, values, side="right") - 1
    inside = np.maximum(piece, 0)
    after = np.minimum(inside + 1, len(function.values) - 1)
    with np.errstate(over="ignore"):  # far from points that are close together: infinite, and cut off
        share = np.minimum((values - function.values[inside]) * function.rates[inside], 1.0)
    share = np.where(piece < 0, 0.0, share)[:, None]
    return function.heights[inside] * (1.0 - share) + function.heights[after] * share
