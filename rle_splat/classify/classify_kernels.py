"""The passes of classification, parallel over rows (paper 2.1; twins in visible.py and classification.py).

Throughout: ``rows`` (planes * ny, nx) stored values of some planes; ``relevant`` (blocks along z, y, x) uint8, which
blocks may hold a visible voxel; ``row_start`` (rows + 1,) int64 places in the lists; ``column`` (m,), x of each visible
voxel; ``stored`` (m,), its value.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import kernel
from ..runtime.parallel import share_out
from ..volume.blocks import BLOCK_X, BLOCK_Y, BLOCK_Z
from .points import LARGEST, height_at, piece_of


@kernel
def count_by_table(rows, n_y, relevant, visible, counts, pieces):
    """``rows`` as unsigned bit patterns index ``visible`` (256 or 65536,) uint8; writes the visible voxels of each
    row and the number of connected pieces they come in."""
    share_out(_count_by_table, rows.shape[0], (rows, n_y, relevant, visible, counts, pieces))


@kernel(inner=True)
def _count_by_table(begin, end, rows, n_y, relevant, visible, counts, pieces):
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
    """Writes ``column`` and ``stored``; see ``count_by_table``."""
    share_out(_fill_by_table, rows.shape[0], (rows, n_y, relevant, visible, row_start, column, stored))


@kernel(inner=True)
def _fill_by_table(begin, end, rows, n_y, relevant, visible, row_start, column, stored):
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
                # Written whether visible or not, kept by moving on: no branch to mispredict.
                pattern = rows[row, x]
                column[at] = x
                stored[at] = pattern
                at += visible[pattern]


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


@kernel
def count_by_points(rows, n_y, relevant, slope, intercept, intervals, counts, pieces):
    """As ``count_by_table``; ``intervals`` (k, 2): the physical values with an opacity above 0."""
    share_out(_count_by_points, rows.shape[0], (rows, n_y, relevant, slope, intercept, intervals, counts, pieces))


@kernel(exact=True, inner=True)
def _count_by_points(begin, end, rows, n_y, relevant, slope, intercept, intervals, counts, pieces):
    width = rows.shape[1]
    for row in range(begin, end):
        z, y = row // n_y, row % n_y
        count = 0
        piece = 0
        stop = -1  # one past the last visible voxel
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
    """Writes ``column`` and ``stored``; see ``count_by_points``."""
    arguments = (rows, n_y, relevant, slope, intercept, intervals, row_start, column, stored)
    share_out(_fill_by_points, rows.shape[0], arguments)


@kernel(exact=True, inner=True)
def _fill_by_points(begin, end, rows, n_y, relevant, slope, intercept, intervals, row_start, column, stored):
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
def looks_by_points(
    stored, slope, intercept, opacity_values, opacity_heights, opacity_rates, color_values, color_heights, color_rates,
    alpha_cap, distance, looks,
):
    """``looks`` (m, 5) float32 of (m,) stored values: extinction in 1 / world length, opacity, red, green, blue.

    Points as in ``points.Pieces``; ``distance``: world length that opacity refers to.
    """
    arguments = (
        stored, slope, intercept, opacity_values, opacity_heights, opacity_rates, color_values, color_heights,
        color_rates, alpha_cap, distance, looks,
    )
    share_out(_looks_by_points, stored.size, arguments)


@kernel(exact=True, inner=True)
def _looks_by_points(
    begin, end, stored, slope, intercept, opacity_values, opacity_heights, opacity_rates, color_values, color_heights,
    color_rates, alpha_cap, distance, looks,
):
    for i in range(begin, end):
        value = _physical(stored[i], slope, intercept)
        piece = piece_of(opacity_values, value)
        alpha = height_at(opacity_heights, opacity_rates, opacity_values, piece, value, 0)
        looks[i, 0] = -np.log1p(-min(alpha, alpha_cap)) / distance
        looks[i, 1] = alpha
        piece = piece_of(color_values, value)
        for channel in range(3):
            looks[i, 2 + channel] = height_at(color_heights, color_rates, color_values, piece, value, channel)
