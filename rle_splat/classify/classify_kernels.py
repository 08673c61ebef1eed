"""Kernels of classification, parallel over rows (paper, section 2.1).

Common arguments: ``rows`` (planes * ny, nx), stored values of some planes; ``n_y``, rows per plane; ``relevant``
(blocks along z, y, x) uint8, 0 for blocks without visible voxels; ``bits`` (rows, words) uint64, zero on entry, one bit
per voxel, lowest bit first.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import kernel
from ..runtime.parallel import share_out
from ..volume.blocks import BLOCK_X, BLOCK_Y, BLOCK_Z
from .points import LARGEST, height_at, piece_of
from .reference import WORD

NO_BITS = np.uint64(0)


@kernel
def mark_by_table(rows, n_y, relevant, visible, bits):
    """Set the bits of the visible voxels.

    ``rows``: unsigned bit patterns; ``visible`` (256 or 65536,) uint8 by bit pattern.
    """
    share_out(_mark_by_table, rows.shape[0], (rows, n_y, relevant, visible, bits))


@kernel(inner=True)
def _mark_by_table(begin, end, rows, n_y, relevant, visible, bits):
    """``mark_by_table`` for rows [begin, end)."""
    width = rows.shape[1]
    for row in range(begin, end):
        z, y = row // n_y, row % n_y
        for b in range(relevant.shape[2]):
            if relevant[z // BLOCK_Z, y // BLOCK_Y, b] == 0:
                continue
            first, found = b * BLOCK_X, NO_BITS
            for x in range(first, min(first + BLOCK_X, width)):
                found |= np.uint64(visible[rows[row, x]]) << np.uint64(x - first)
            bits[row, first // WORD] |= found << np.uint64(first % WORD)


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
def mark_by_points(rows, n_y, relevant, slope, intercept, intervals, bits):
    """As ``mark_by_table``; ``intervals`` (k, 2): physical values with an opacity above 0."""
    share_out(_mark_by_points, rows.shape[0], (rows, n_y, relevant, slope, intercept, intervals, bits))


@kernel(exact=True, inner=True)
def _mark_by_points(begin, end, rows, n_y, relevant, slope, intercept, intervals, bits):
    """``mark_by_points`` for rows [begin, end)."""
    width = rows.shape[1]
    for row in range(begin, end):
        z, y = row // n_y, row % n_y
        for b in range(relevant.shape[2]):
            if relevant[z // BLOCK_Z, y // BLOCK_Y, b] == 0:
                continue
            first, found = b * BLOCK_X, NO_BITS
            for x in range(first, min(first + BLOCK_X, width)):
                seen = _is_shown(_physical(rows[row, x], slope, intercept), intervals)
                found |= np.uint64(seen) << np.uint64(x - first)
            bits[row, first // WORD] |= found << np.uint64(first % WORD)


@kernel
def properties_by_points(
    stored, slope, intercept, opacity_values, opacity_heights, opacity_rates, color_values, color_heights, color_rates,
    alpha_cap, distance, properties,
):  # fmt: skip
    """Optical properties of ``stored`` values (m,) by the points of a transfer function.

    ``opacity_*``, ``color_*``: arrays of ``points.Pieces``; ``distance``: world length to which opacity refers. Writes
    ``properties`` (m, 5) float32: extinction in 1 / world length, opacity, red, green, blue.
    """
    arguments = (
        stored, slope, intercept, opacity_values, opacity_heights, opacity_rates, color_values, color_heights,
        color_rates, alpha_cap, distance, properties,
    )  # fmt: skip
    share_out(_properties_by_points, stored.size, arguments)


@kernel(exact=True, inner=True)
def _properties_by_points(
    begin, end, stored, slope, intercept, opacity_values, opacity_heights, opacity_rates, color_values, color_heights,
    color_rates, alpha_cap, distance, properties,
):  # fmt: skip
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
