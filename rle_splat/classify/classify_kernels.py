"""Kernels of classification, parallel over rows (paper, section 2.1).

Their reference implementations are in visible.py and classification.py. Common arguments: ``rows`` (planes * ny, nx),
stored values of some planes; ``n_y``, rows per plane; ``relevant`` (blocks along z, y, x) uint8, 0 for blocks without
visible voxels; ``row_start`` (rows + 1,) int64, first list entry of each row; ``column`` (m,), x of each visible voxel;
``stored`` (m,), its value.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import kernel
from ..runtime.parallel import share_out
from ..volume.blocks import BLOCK_X, BLOCK_Y, BLOCK_Z
from .points import LARGEST, height_at, piece_of


@kernel
def count_by_table(rows, n_y, relevant, visible, counts, pieces):
    """Count the visible voxels of each row and the connected pieces that they form.

    ``rows``: unsigned bit patterns; ``visible`` (256 or 65536,) uint8 by bit pattern; writes ``counts`` and ``pieces``
    (rows,).
    """
    share_out(_count_by_table, rows.shape[0], (rows, n_y, relevant, visible, counts, pieces))


@kernel(inner=True)
def _count_by_table(begin, end, rows, n_y, relevant, visible, counts, pieces):
    """``count_by_table`` for rows [begin, end)."""
    width = rows.shape[1]
    for row in range(begin, end):
        z, y = row // n_y, row % n_y
        count = 0
        piece = 0
        for b in range(relevant.shape[2]):
            if relevant[z // BLOCK_Z, y // BLOCK_Y, b] == 0:
                continue
            first = b * BLOCK_X
            before = visible[rows[row, first - 1]] if first > 0 else np.uint8(0)
            for x in range(first, min(first + BLOCK_X, width)):
                seen = visible[rows[row, x]]
                count += seen
                piece += seen & (before ^ 1)
                before = seen
        counts[row] = count
        pieces[row] = piece


@kernel
def fill_by_table(rows, n_y, relevant, visible, row_start, column, stored):
    """Write ``column`` and ``stored`` of the visible voxels; other arguments as in ``count_by_table``."""
    share_out(_fill_by_table, rows.shape[0], (rows, n_y, relevant, visible, row_start, column, stored))


@kernel(inner=True)
def _fill_by_table(begin, end, rows, n_y, relevant, visible, row_start, column, stored):
    """``fill_by_table`` for rows [begin, end)."""
    width = rows.shape[1]
    for row in range(begin, end):
        at, stop = row_start[row], row_start[row + 1]
        z, y = row // n_y, row % n_y
        for b in range(relevant.shape[2]):
            if at == stop:
                break
            if relevant[z // BLOCK_Z, y // BLOCK_Y, b] == 0:
                continue
            for x in range(b * BLOCK_X, min((b + 1) * BLOCK_X, width)):
                if at == stop:
                    break
                # Always write, and advance only if visible: avoids a mispredicted branch.
                pattern = rows[row, x]
                column[at] = x
                stored[at] = pattern
                at += visible[pattern]


@kernel(exact=True, inline="always")
def _physical(stored, slope, intercept):
    """Physical value, with infinities clamped to the largest finite numbers; NaN stays NaN."""
    value = np.float64(stored) * slope + intercept
    if value > LARGEST:
        return LARGEST
    if value < -LARGEST:
        return -LARGEST
    return value


@kernel(exact=True, inline="always")
def _is_shown(value, intervals):
    """Whether a value lies in one of the half-open ``intervals`` (k, 2); False for NaN."""
    for i in range(intervals.shape[0]):
        if intervals[i, 0] <= value < intervals[i, 1]:
            return True
    return False


@kernel
def count_by_points(rows, n_y, relevant, slope, intercept, intervals, counts, pieces):
    """As ``count_by_table``; ``intervals`` (k, 2): physical values with an opacity above 0."""
    share_out(_count_by_points, rows.shape[0], (rows, n_y, relevant, slope, intercept, intervals, counts, pieces))


@kernel(exact=True, inner=True)
def _count_by_points(begin, end, rows, n_y, relevant, slope, intercept, intervals, counts, pieces):
    """``count_by_points`` for rows [begin, end)."""
    width = rows.shape[1]
    for row in range(begin, end):
        z, y = row // n_y, row % n_y
        count = 0
        piece = 0
        stop = -1  # one past the previous visible voxel
        for b in range(relevant.shape[2]):
            if relevant[z // BLOCK_Z, y // BLOCK_Y, b] == 0:
                continue
            for x in range(b * BLOCK_X, min((b + 1) * BLOCK_X, width)):
                if _is_shown(_physical(rows[row, x], slope, intercept), intervals):
                    count += 1
                    piece += x != stop
                    stop = x + 1
        counts[row] = count
        pieces[row] = piece


@kernel
def fill_by_points(rows, n_y, relevant, slope, intercept, intervals, row_start, column, stored):
    """Write ``column`` and ``stored`` of the visible voxels; other arguments as in ``count_by_points``."""
    arguments = (rows, n_y, relevant, slope, intercept, intervals, row_start, column, stored)
    share_out(_fill_by_points, rows.shape[0], arguments)


@kernel(exact=True, inner=True)
def _fill_by_points(begin, end, rows, n_y, relevant, slope, intercept, intervals, row_start, column, stored):
    """``fill_by_points`` for rows [begin, end)."""
    width = rows.shape[1]
    for row in range(begin, end):
        at = row_start[row]
        if row_start[row + 1] == at:
            continue
        z, y = row // n_y, row % n_y
        for b in range(relevant.shape[2]):
            if relevant[z // BLOCK_Z, y // BLOCK_Y, b] == 0:
                continue
            for x in range(b * BLOCK_X, min((b + 1) * BLOCK_X, width)):
                if _is_shown(_physical(rows[row, x], slope, intercept), intervals):
                    column[at] = x
                    stored[at] = rows[row, x]
                    at += 1


@kernel
def properties_by_points(
    stored, slope, intercept, opacity_values, opacity_heights, opacity_rates, color_values, color_heights, color_rates,
    alpha_cap, distance, properties,
):
    """Optical properties of ``stored`` values (m,) by the points of a transfer function.

    ``opacity_*``, ``color_*``: arrays of ``points.Pieces``; ``distance``: world length to which opacity refers. Writes
    ``properties`` (m, 5) float32: extinction in 1 / world length, opacity, red, green, blue.
    """
    arguments = (
        stored, slope, intercept, opacity_values, opacity_heights, opacity_rates, color_values, color_heights,
        color_rates, alpha_cap, distance, properties,
    )
    share_out(_properties_by_points, stored.size, arguments)


@kernel(exact=True, inner=True)
def _properties_by_points(
    begin, end, stored, slope, intercept, opacity_values, opacity_heights, opacity_rates, color_values, color_heights,
    color_rates, alpha_cap, distance, properties,
):
    """``properties_by_points`` for values [begin, end)."""
    for i in range(begin, end):
        value = _physical(stored[i], slope, intercept)
        piece = piece_of(opacity_values, value)
        alpha = height_at(opacity_heights, opacity_rates, opacity_values, piece, value, 0)
        properties[i, 0] = -np.log1p(-min(alpha, alpha_cap)) / distance
        properties[i, 1] = alpha
        piece = piece_of(color_values, value)
        for channel in range(3):
            properties[i, 2 + channel] = height_at(color_heights, color_rates, color_values, piece, value, channel)
