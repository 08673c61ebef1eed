"""Rays without compositing: the largest, smallest or mean value, or the optical depth (algorithm.md 4.2).

None of these depends on the order of the sheets or needs an exponential per sheet.  They are stored in a block of the
row behind the sheets, where composited pixels have color and transmittance:

    values   RED the largest, or smallest, value so far, counted from an origin, or the sum of value * length; GREEN the
             sum of lengths; TRANSMITTANCE 0 as soon as there is a sample
    depths   RED the optical depth
"""

from __future__ import annotations

import math

import numpy as np

from ..runtime.jit import inner_loop
from .pixel_block import BLOCK, GREEN, RED, TRANSMITTANCE
from .rays_in_box import interval_in_box
from .scalar_block import ROW_BITS

HALF = np.float32(math.log(2.0))  # optical depth at which half the light is left
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


@inner_loop
def sheet_depth(position, begin, end):
    """Where a sheet at ``position`` of the principal axis lies along the viewing direction, which is one of the axis or
    against it: inside its slab [``begin``, ``end``]."""
    return position if begin <= position <= end else -position


@inner_loop
def gather_values(
    sheet, upper, lower, down, sign, origin, least, length, deep, thickness, state, row, depth, cut, box_columns,
    box_rows, intervals, v, first_pixel, count, found, half,
):  # fmt: skip
    """One block of one sheet of the scalar: ``sign`` 1 for the largest value, -1 the smallest, 0 the mean.

    ``sheet``: blocks of the scanlines at ``upper`` and ``lower``, ``down`` the fraction towards the latter.  ``least``:
    what is below is no sample.  ``origin``: of ``sign`` times the value, or of the value.  ``length[deep:]``, times
    ``thickness``: of the rays in the slab; where it is zero, or less, a ray does not come by.  ``depth``: of the sheet,
    which goes to ``half`` (H, W), row ``v`` from ``first_pixel`` on, where the sheet has the largest value so far;
    within the ray where it is ``cut``.  ``found`` (BLOCK,): scratch.
    """
    share = _ONE - down
    if sign == _ZERO:
        for i in range(BLOCK):
            value = sheet[upper + i] * share + sheet[lower + i] * down
            weight = length[deep + i] * thickness if value >= least else _ZERO
            state[row + RED + i] += (value - origin) * weight
            state[row + GREEN + i] += weight
            state[row + TRANSMITTANCE + i] = _ZERO if weight > _ZERO else state[row + TRANSMITTANCE + i]
        return
    better = 0
    for i in range(BLOCK):
        value = sheet[upper + i] * share + sheet[lower + i] * down
        counts = value >= least and length[deep + i] > _ZERO
        over = sign * value - origin
        most = state[row + RED + i]
        more = counts and over > most
        found[i] = _ONE if more else _ZERO
        better += more
        state[row + RED + i] = over if more else most
        state[row + TRANSMITTANCE + i] = _ZERO if counts else state[row + TRANSMITTANCE + i]
    if better == 0:
        return
    for i in range(count):
        if found[i] > _ZERO:
            at = depth
            if cut:
                enter, leave = interval_in_box(box_columns, box_rows, intervals, v, first_pixel, i)
                at = min(max(depth, enter), leave)
            half[v, first_pixel + i] = at


@inner_loop
def add_depths(
    table, sums, entries, spans, shares, seen, length, deep, thickness, state, row, begin, end, cut, box_columns,
    box_rows, intervals, v, first_pixel, count, before, half,
):  # fmt: skip
    """One block of one slab: its optical depth.

    ``table`` and ``sums``: extinction of the lookup table's entries, and sums of it.  ``entries``, ``spans``,
    ``shares``, ``seen``: of ``scalar_block.look_up`` or ``look_between``.  Where half the light is gone in this slab,
    the depth at which it is goes to ``half``.  ``before`` (BLOCK,): scratch.  The others: see ``gather_values``.
    """
    spanned = seen >> 8 > 0
    crossed = 0
    for i in range(BLOCK):
        extinction = table[entries[i] >> ROW_BITS]
        if spanned and shares[2 * BLOCK + i] > _ZERO:
            mean = (sums[spans[BLOCK + i] >> ROW_BITS] - sums[spans[i] >> ROW_BITS]) * shares[2 * BLOCK + i]
            extinction = max(mean, _ZERO)
        so_far = state[row + RED + i]
        before[i] = so_far
        after = so_far + extinction * (length[deep + i] * thickness * shares[i])
        state[row + RED + i] = after
        crossed += so_far < HALF and after >= HALF
    if crossed == 0:
        return
    for i in range(count):
        after = state[row + RED + i]
        if before[i] < HALF and after >= HALF:
            from_, to = begin, end
            if cut:
                enter, leave = interval_in_box(box_columns, box_rows, intervals, v, first_pixel, i)
                from_, to = max(begin, enter), min(end, leave)
            half[v, first_pixel + i] = from_ + (HALF - before[i]) / (after - before[i]) * (to - from_)


@inner_loop
def thin_slab(
    sheet, upper, lower, down, before, upper_before, lower_before, down_before, plane, shares, length, deep, thinned
):
    """One block of one slab whose extinction is multiplied by a factor that sheets carry, ``plane`` numbers behind the
    scalar: the rays are as much shorter, in ``thinned`` (BLOCK,), which may be ``length`` itself.

    ``shares``: of this sheet in the slab, BLOCK numbers on (``scalar_block.look_between``).  ``before``: the sheet
    before, likewise.  The others: see ``gather_values``.
    """
    for i in range(BLOCK):
        here = sheet[upper + plane + i] * (_ONE - down) + sheet[lower + plane + i] * down
        there = before[upper_before + plane + i] * (_ONE - down_before) + before[lower_before + plane + i] * down_before
        share = shares[BLOCK + i]
        thinned[i] = length[deep + i] * (here * share + there * (_ONE - share))
