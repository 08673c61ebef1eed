"""Prefilter of the cubic B-spline: coefficients with which it interpolates instead of blurring.

Interpolation divides by the spline's values at the nodes, (z + 4 + 1/z) / 6 along each axis (Unser, Aldroubi and
Eden 1993). The quotient, a power of the pole sqrt(3) - 2 on either side, is usually computed by a recursion over the
whole line. Here it is truncated after MARGIN samples and computed as a product:

    6 / (z + 4 + 1/z) = g (1 - (z + 1/z) / 4) (1 + (z^2 + z^-2) / 14) (1 + (z^4 + z^-4) / 194) ...

in which each denominator is the square of the previous one, minus two. Four factors reach 15 samples; the truncation
error is the pole's 16th power, 7e-10, a hundredth of float32's rounding error. So a coefficient is the same sum of the
same samples, bit for bit, in any window of an image that has MARGIN samples around it, and exactly zero where all
samples within MARGIN are zero.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import kernel, parallel_call
from ..runtime.parallel import share_out
from .reference import FACTORS, GAIN, MARGIN

ROWS, COLUMNS = 16, 8  # per worker at once: few enough for its cache, and columns of whole cache lines
ONE = np.float32(1.0)


@kernel(inner=True)
def _copy(source, at, target, to, count, factor):
    """target[to : to + count] = factor * source[at : at + count]."""
    taken, put = source[at : at + count], target[to : to + count]
    for i in range(count):
        put[i] = factor * taken[i]


@kernel(inner=True)
def _factor(source, target, shift, weight, count):
    """Apply 1 + weight (z^shift + z^-shift): target[i] is the result for sample i + shift, for ``count`` floats."""
    here, after = source[shift:], source[2 * shift :]
    for i in range(count):
        target[i] = here[i] + weight * (source[i] + after[i])


@kernel(inner=True)
def _filter_line(source, begin, target, start, step, count, lanes, to_alpha, gain, line, spare):
    """Filter ``lanes`` neighboring floats, each a line of ``count`` samples ``step`` apart.

    The lines begin at ``begin`` of the source and at ``start`` of the target.

    ``line``, ``spare``: scratch of (count + 2 MARGIN) * lanes floats. Two buffers, and shifts instead of centered sums,
    make the loops wide vectors.
    """
    runs, length = (1, count * lanes) if step == lanes else (count, lanes)
    for run in range(runs):
        _copy(source, begin + run * step, line, (MARGIN + run) * lanes, length, ONE)
    if to_alpha:
        for n in range(MARGIN, MARGIN + count):
            line[n * lanes + 3] = ONE - line[n * lanes + 3]
    for n in range(MARGIN):
        _copy(line, MARGIN * lanes, line, n * lanes, lanes, ONE)
        _copy(line, (MARGIN + count - 1) * lanes, line, (MARGIN + count + n) * lanes, lanes, ONE)
    _factor(line, spare, lanes, FACTORS[0][1], (count + 28) * lanes)
    _factor(spare, line, 2 * lanes, FACTORS[1][1], (count + 24) * lanes)
    _factor(line, spare, 4 * lanes, FACTORS[2][1], (count + 16) * lanes)
    _factor(spare, line, 8 * lanes, FACTORS[3][1], count * lanes)
    for run in range(runs):
        _copy(line, run * lanes, target, start + run * step, length, gain)


@kernel(inner=True)
def _filter_some(
    first_part, last_part, source, first, apart, target, together, pitch, end, step, count, lanes, to_alpha, gain
):
    """``_filter_lines`` for parts [first_part, last_part)."""
    line = np.empty((count + 2 * MARGIN) * lanes, np.float32)
    spare = np.empty((count + 2 * MARGIN) * lanes, np.float32)
    for n in range(first_part * together, last_part * together):
        start = n * pitch
        if start < end:
            here = lanes if lanes < end - start else end - start
            begin = first + n * apart
            _filter_line(source, begin, target, start, step, count, here, to_alpha, gain, line, spare)


@kernel
def _filter_lines(parts, arguments):
    """Filter lines of ``lanes`` floats, in ``parts`` of ``together`` lines; ``arguments``: of ``_filter_some``.

    The first line begins at 0 of the target, each next one ``pitch`` floats later, all before ``end``; in the source it
    begins at ``first``, each next one ``apart`` floats later.
    """
    share_out(_filter_some, parts, arguments)


def spline_coefficients(pixels, rows, columns, coefficients, threads=0):
    """Compute cubic B-spline coefficients of color and alpha, of a part of an image.

    Parameters
    ----------
    pixels : (H, W, 4) ndarray of float32
        Contiguous; color and transmittance. Beyond its border the part continues with its outermost pixels, which are
        transparent wherever it ends because the volume does.
    rows, columns : slice
        The part, of ``h`` rows and ``w`` columns.
    coefficients : (h, w, 4) ndarray of float32
        Contiguous; output.
    threads : int
        0 for one per core.
    """
    height, width = coefficients.shape[:2]
    source, target = pixels.reshape(-1), coefficients.reshape(-1)
    apart, pitch = 4 * pixels.shape[1], 4 * width
    first = rows.start * apart + 4 * columns.start
    with parallel_call(threads):
        along = source, first, apart, target, ROWS, pitch, height * pitch, 4, width, 4, True, ONE
        _filter_lines(-(-height // ROWS), along)
        lanes = 4 * COLUMNS
        across = target, 0, lanes, target, 1, lanes, pitch, pitch, height, lanes, False, GAIN
        _filter_lines(-(-width // COLUMNS), across)
