"""What happens to a block of pixels in one scanline of a sheet, beside the arithmetic of ``pixel_block``."""

from __future__ import annotations

import math

import numpy as np

from ..runtime.bits import lowest_bit
from ..runtime.jit import inner_loop
from ..runtime.lanes import add4
from ..view.footprints import first_tap, tap_weight, voxel_at
from .half_depth import half_way
from .pixel_block import BLOCK, BLUE, GREEN, RED, TRANSMITTANCE, planar
from .voxel_scanline import ALL_BITS, NO_BITS, ONE_BIT, WORD

_ONE, _HALF, _ZERO = np.float32(1.0), np.float32(0.5), np.float32(0.0)
_ALMOST_ONE = np.float32(1.0 - 2.0**-24)  # log1p(-1) has no value; this is the cap of the classification too


@inner_loop
def place_wide_taps(cells, weights, taps, kind, stretch, radius, first_pixel, shift, scale, margin, low, top):
    """Where the samples of one block lie for a footprint of any width: first voxel, and its ``taps`` weights.

    ``cells``: number of the first voxel, ``margin`` more.  ``weights[tap * BLOCK + i]`` float32, normalized by their
    sum over all voxels.  ``stretch``: how much wider than a voxel the footprint is made; ``radius``: stretched.
    ``first_pixel``, ``shift``, ``scale``: see ``voxel_at``.  ``low`` and ``top``: first and last position.
    """
    for i in range(BLOCK):
        x = min(max(voxel_at(first_pixel + i, shift, scale), low), top)
        first = first_tap(kind, x, radius)
        cells[i] = np.int32(first + margin)
        total = 0.0
        for tap in range(taps):
            weight = tap_weight(kind, x, first + tap, stretch)
            weights[tap * BLOCK + i] = weight
            total += weight
        over = np.float32(1.0 / total) if total > 0.0 else _ZERO
        for tap in range(taps):
            weights[tap * BLOCK + i] *= over


@inner_loop
def resample_wide(line, cells, weights, taps, samples, sheet, at):
    """A footprint of any width along one voxel scanline: one block, planar, to ``sheet[at:]``."""
    for i in range(4 * BLOCK):
        samples[i] = _ZERO
    for i in range(BLOCK):
        for tap in range(taps):
            add4(line, 4 * (np.intp(cells[i]) + tap), weights[tap * BLOCK + i], samples, 4 * i)
    planar(samples, sheet, at)


@inner_loop
def mix_blocks(sheet, upper, lower, down, to):
    """sheet[to:] = the block at ``upper``, mixed with the one at ``lower`` by the fraction ``down``."""
    for i in range(4 * BLOCK):
        sheet[to + i] = sheet[upper + i] + down * (sheet[lower + i] - sheet[upper + i])


@inner_loop
def composite_opacity(sheet, at, depth, deep, thickness, least, state, row, before):
    """One block of one sheet of opacity over the row: the paper's model.

    ``sheet[at:]``: opacity-weighted color and opacity, added over the overlapping footprints.  The opacity is
    clamped to one and raised to the power ``depth[deep:]`` times ``thickness`` of transmittance, the length of the
    ray's piece in reference distances: a' = -expm1(e * log1p(-a)).  An exponent of exactly one leaves it as the
    paper adds it.  In numbers of ``state``'s type.  Returns what ``composite_extinction`` does.
    """
    number = state.dtype.type
    one, almost_one = number(_ONE), number(_ALMOST_ONE)
    left = bright = 0
    for i in range(BLOCK):
        added = number(sheet[at + TRANSMITTANCE + i])
        before[i] = transmittance = state[row + TRANSMITTANCE + i]
        if added > _ZERO and transmittance >= least:
            opacity = min(added, one)
            exponent = number(depth[deep + i] * thickness)
            if exponent != one:
                opacity = number(-math.expm1(exponent * math.log1p(-min(opacity, almost_one))))
            weight = transmittance * opacity / added
            state[row + RED + i] += weight * sheet[at + RED + i]
            state[row + GREEN + i] += weight * sheet[at + GREEN + i]
            state[row + BLUE + i] += weight * sheet[at + BLUE + i]
            transmittance *= one - opacity
            state[row + TRANSMITTANCE + i] = transmittance
        left += transmittance >= least
        bright += transmittance >= _HALF
    return left + 256 * bright


@inner_loop
def note_half_depth(box, intervals, before, after, at, begin, end, half, v, first_pixel, count, parts):
    """Where the transmittance has just fallen below one half, note the depth inside the slab at which it did.

    ``box``, ``intervals``: Box and ray intervals, which may end a ray within the slab; None where neither does.
    ``before`` and ``after[at:]``: (BLOCK,) the transmittance ahead of this sheet and behind it.  ``begin``, ``end``: of
    the slab.  ``half``: (H, W) float32 depth along the viewing direction of the axis; ``count`` pixels of row ``v``
    from ``first_pixel`` on are looked at.  ``parts``: (BLOCK,) float32 scratch.
    """
    bits = half_way(before, after, at, parts) & (ALL_BITS >> np.uint64(WORD - count))
    while bits != NO_BITS:
        i = lowest_bit(bits)
        bits &= bits - ONE_BIT
        u, from_, to = first_pixel + i, begin, end
        if box is not None:
            from_, to = max(from_, box.columns[0, u], box.rows[0, v]), min(to, box.columns[1, u], box.rows[1, v])
        if intervals is not None:
            if intervals.size > 0:
                from_, to = max(from_, intervals[0, v, u]), min(to, intervals[1, v, u])
        half[v, u] = from_ + parts[i] * (to - from_)
