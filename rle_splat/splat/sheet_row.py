"""What happens in one scanline of a sheet: classified voxels in, composited pixels out.

The row is kept in blocks of BLOCK pixels, planar inside a block (red, green, blue, transmittance), in one flat
array: with constant distances between the planes LLVM can prove that the streams do not overlap, and the
compositing loops become wide SIMD.
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import kernel
from ..lanes import add4, mix2x2
from ..view.footprints import first_tap, footprint_weight

BLOCK = 16  # pixels handled together; a multiple of every SIMD width in use

RED, GREEN, BLUE, CLEAR = 0, BLOCK, 2 * BLOCK, 3 * BLOCK  # planes of a block of the row; CLEAR is transmittance

_LOG2E = np.float32(1.4426950408889634)
# 2**r - 1 on [-1/2, 1/2]: minimax-like Taylor terms ln(2)**n / n!, relative error below float32's rounding.
_E1, _E2, _E3, _E4, _E5, _E6, _E7 = (np.float32(math.log(2.0) ** n / math.factorial(n)) for n in range(1, 8))
_ONE, _HALF, _ZERO = np.float32(1.0), np.float32(0.5), np.float32(0.0)
_ALMOST_ONE = np.float32(1.0 - 2.0**-24)  # log1p(-1) has no value; this is the cap of the classification too
_TINY = np.float32(1e-37)  # keeps 0/0 out of colour = associated colour / extinction
_MOST = np.float32(126.0)  # exponent at which a sheet is opaque and 2**-n is still a normal number


@kernel
def place_taps(cells, fractions, start, step, top):
    """Where the samples of one block lie on a scanline: float index of the left voxel, fraction to the right one.

    ``start``, ``step`` and ``top``, the last valid coordinate: float64, in voxels, shifted by one: index 0 of a
    scanline is voxel -1, and the outermost voxels are zero.
    """
    for i in range(BLOCK):
        x = min(max(start + i * step, 0.0), top)
        cell = np.int32(x)
        cells[i] = np.int32(4) * cell
        fractions[i] = np.float32(x - cell)


@kernel
def gather_samples(samples, lines, line, pitch, down, cells, fractions):
    """The tent footprint: one block of samples between two voxel scanlines.

    ``samples`` and ``lines``: flat float32, four channels a pixel or voxel.  ``line``: index of the upper
    scanline's first float, the lower one lies ``pitch`` floats on, ``down`` (float32) is the fraction towards it.
    """
    for i in range(BLOCK):
        mix2x2(lines, line + np.intp(cells[i]), pitch, fractions[i], down, samples, 4 * i)


@kernel
def place_wide_taps(cells, weights, taps, kind, stretch, radius, start, step, low, top):
    """Where the samples of one block lie for a footprint of any width: first voxel, and its ``taps`` weights.

    ``weights[tap * BLOCK + i]`` float32, normalised by their sum over all voxels.  ``stretch``: how much wider than
    a voxel the footprint is made; ``radius``: stretched.  ``low`` and ``top``: first and last shifted coordinate.
    """
    for i in range(BLOCK):
        x = min(max(start + i * step, low), top)
        first = first_tap(kind, x, radius)
        cells[i] = np.int32(first)
        total = 0.0
        for tap in range(taps):
            weight = footprint_weight(kind, (x - (first + tap)) / stretch)
            weights[tap * BLOCK + i] = weight
            total += weight
        scale = np.float32(1.0 / total) if total > 0.0 else _ZERO
        for tap in range(taps):
            weights[tap * BLOCK + i] *= scale


@kernel
def gather_wide(samples, lines, line, cells, weights, taps):
    """A footprint of any width along one voxel scanline: one block of samples."""
    for i in range(4 * BLOCK):
        samples[i] = _ZERO
    for i in range(BLOCK):
        for tap in range(taps):
            add4(lines, line + 4 * (np.intp(cells[i]) + tap), weights[tap * BLOCK + i], samples, 4 * i)


@kernel
def composite_extinction(row, samples, depth, thickness, before, least):
    """One block of one sheet of extinction over the row: the exact solution of a homogeneous slab.

    ``row``: flat float32, a block (RED, GREEN, BLUE, CLEAR).  ``samples``: associated colour and extinction.
    ``depth``: (BLOCK,) float32 world length of the slab.  ``least``: transmittance at which a pixel is opaque.
    C += T * (1 - exp(-tau)) * Q / tau ;  T *= exp(-tau)   (algorithm.md 1.6).  1 - exp is formed without
    cancellation, as (1 - 2**-n) - 2**-n * (2**r - 1).
    """
    for i in range(BLOCK):
        sigma = samples[4 * i + 3]
        tau2 = min(sigma * (depth[i] * thickness) * _LOG2E, _MOST)
        whole = np.int32(tau2 + _HALF)
        r = np.float32(whole) - tau2
        p = r * (_E1 + r * (_E2 + r * (_E3 + r * (_E4 + r * (_E5 + r * (_E6 + r * _E7))))))
        power = np.int32((np.int32(127) - whole) << np.int32(23)).view(np.float32)  # 2**-whole
        clear = row[CLEAR + i]
        before[i] = clear
        alive = clear >= least
        absorbed = (_ONE - power) - power * p
        weight = (clear if alive else _ZERO) * absorbed / max(sigma, _TINY)
        row[RED + i] += weight * samples[4 * i]
        row[GREEN + i] += weight * samples[4 * i + 1]
        row[BLUE + i] += weight * samples[4 * i + 2]
        row[CLEAR + i] = clear * (power + power * p) if alive else clear


@kernel
def composite_opacity(row, samples, depth, thickness, before, least):
    """One block of one sheet of opacity over the row: the paper's model.

    ``samples``: opacity-weighted colour and opacity, added over the overlapping footprints.  The opacity is
    clamped to one and raised to the power ``exponent`` (BLOCK,) of transmittance, the length of the ray's piece
    in reference distances: a' = -expm1(e * log1p(-a)).  An exponent of exactly one leaves it as the paper adds it.
    """
    for i in range(BLOCK):
        added = samples[4 * i + 3]
        clear = row[CLEAR + i]
        before[i] = clear
        if added <= _ZERO or clear < least:
            continue
        opacity = min(added, _ONE)
        exponent = depth[i] * thickness
        if exponent != _ONE:
            opacity = np.float32(-math.expm1(exponent * math.log1p(-min(opacity, _ALMOST_ONE))))
        weight = clear * opacity / added
        row[RED + i] += weight * samples[4 * i]
        row[GREEN + i] += weight * samples[4 * i + 1]
        row[BLUE + i] += weight * samples[4 * i + 2]
        row[CLEAR + i] = clear * (_ONE - opacity)


@kernel
def note_half_depth(row, before, slab_begin, slab_end, half, count):
    """Where the transmittance has just fallen below one half, note the depth inside the slab at which it did.

    ``before``: (BLOCK,) the transmittance ahead of this sheet.  ``half``: (count,) float32 depth along the
    viewing direction of the axis.  Inside a homogeneous slab the transmittance is exponential in depth.
    """
    for i in range(count):
        ahead, behind = before[i], row[CLEAR + i]
        if ahead >= _HALF and behind < _HALF:
            part = math.log(2.0 * ahead) / math.log(ahead / behind) if behind > 0.0 else 0.0
            half[i] = slab_begin + part * (slab_end - slab_begin)


@kernel
def tally(row, least):
    """How many pixels of a block are not yet opaque, and how many have more than half their light left."""
    alive = 0
    bright = 0
    for i in range(BLOCK):
        alive += np.int32(row[CLEAR + i] >= least)
        bright += np.int32(row[CLEAR + i] >= _HALF)
    return alive, bright
