"""The two passes of classification, count and fill, parallel over rows (paper 2.1; twins in classification.py).

Throughout: ``rows`` (nz * ny, nx) stored values; ``row_start`` (nz * ny + 1,) int64; ``column`` (m,), x of each
visible voxel; ``extinction`` (m,) float32 in 1 / world length; ``opacity`` (m,) float32; ``color`` (m, 3) float32.
"""

from __future__ import annotations

import numpy as np

from ..jit import kernel, prange
from .points import LARGEST, height_at, piece_of


@kernel(parallel=True)
def count_by_table(rows, visible, counts):
    """``rows`` as unsigned bit patterns index ``visible`` (256 or 65536,) bool; writes ``counts`` per row."""
    for row in prange(rows.shape[0]):
        count = 0
        for x in range(rows.shape[1]):
            count += visible[rows[row, x]]
        counts[row] = count


@kernel(parallel=True)
def fill_by_table(rows, visible, records, row_start, column, extinction, opacity, color):
    """``records`` (256 or 65536, 5) float32: extinction, opacity, red, green, blue per bit pattern."""
    for row in prange(rows.shape[0]):
        at = row_start[row]
        if row_start[row + 1] == at:
            continue
        for x in range(rows.shape[1]):
            pattern = rows[row, x]
            if visible[pattern]:
                column[at] = x
                extinction[at] = records[pattern, 0]
                opacity[at] = records[pattern, 1]
                color[at, 0] = records[pattern, 2]
                color[at, 1] = records[pattern, 3]
                color[at, 2] = records[pattern, 4]
                at += 1


@kernel(exact=True, inline="always")
def _physical(stored, slope, intercept):
    """Physical value with infinities brought to the largest finite numbers; NaN stays NaN."""
    value = np.float64(stored) * slope + intercept
    if value > LARGEST:
        return LARGEST
    if value < -LARGEST:
        return -LARGEST
    return value


@kernel(exact=True, inline="always")
def _is_shown(value, intervals):
    """Whether a value lies in one of the half-open ``intervals`` (k, 2); never for NaN."""
    for i in range(intervals.shape[0]):
        if intervals[i, 0] <= value < intervals[i, 1]:
            return True
    return False


@kernel(parallel=True, exact=True)
def count_by_points(rows, slope, intercept, intervals, counts, nan_counts):
    """Visible voxels and NaN voxels of each row; ``intervals`` (k, 2) physical values with an opacity above 0."""
    for row in prange(rows.shape[0]):
        count = 0
        nans = 0
        for x in range(rows.shape[1]):
            value = _physical(rows[row, x], slope, intercept)
            if _is_shown(value, intervals):
                count += 1
            elif value != value:
                nans += 1
        counts[row] = count
        nan_counts[row] = nans


@kernel(parallel=True, exact=True)
def fill_by_points(
    rows, slope, intercept, intervals, opacity_values, opacity_heights, opacity_rates,
    color_values, color_heights, color_rates, alpha_cap, distance, row_start, column, extinction, opacity, color,
):
    """Points as in ``points.Pieces``; ``distance``: world length that opacity refers to."""
    for row in prange(rows.shape[0]):
        at = row_start[row]
        if row_start[row + 1] == at:
            continue
        for x in range(rows.shape[1]):
            value = _physical(rows[row, x], slope, intercept)
            if not _is_shown(value, intervals):
                continue
            piece = piece_of(opacity_values, value)
            alpha = height_at(opacity_heights, opacity_rates, opacity_values, piece, value, 0)
            column[at] = x
            opacity[at] = alpha
            extinction[at] = -np.log1p(-min(alpha, alpha_cap)) / distance
            piece = piece_of(color_values, value)
            for channel in range(3):
                color[at, channel] = height_at(color_heights, color_rates, color_values, piece, value, channel)
            at += 1
