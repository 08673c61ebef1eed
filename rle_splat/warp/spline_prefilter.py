"""B-spline coefficients of an image: what makes the cubic B-spline interpolate instead of blur.

Interpolation divides by the spline's values at the nodes, (z + 4 + 1/z) / 6 along each axis (Unser, Aldroubi and
Eden 1993).  The quotient, a power of the pole sqrt(3) - 2 to either side, is usually run as a recursion over the
whole line.  Here it is cut off beyond MARGIN samples, and its doubling product is used instead:

    6 / (z + 4 + 1/z) = g (1 - (z + 1/z) / 4) (1 + (z^2 + z^-2) / 14) (1 + (z^4 + z^-4) / 194) ...

whose denominators are each the square of the one before, less two.  Four factors reach 15 samples; what is left
out is the pole's 16th power, 7e-10, a hundredth of float32's rounding.  So a coefficient is the same sum of the same
samples in any window of an image that has MARGIN samples around it, to the bit, and where there is nothing within
MARGIN samples it is exactly zero.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import kernel, parallel_call
from ..runtime.parallel import share_out

# Samples to each side that a coefficient depends on, along each axis: 1 + 2 + 4 + 8.
MARGIN = 15
FACTORS = tuple((1 << n, np.float32(c)) for n, c in enumerate((-1.0 / 4.0, 1.0 / 14.0, 1.0 / 194.0, 1.0 / 37634.0)))
# Both axes' g: a constant image is its own coefficients.
GAIN = np.float32(np.prod([1.0 + 2.0 * float(weight) for _, weight in FACTORS]) ** -2)
ROWS, COLUMNS = 16, 8  # by one thread at a time: few enough to stay in its cache, and columns of whole cache lines
ONE = np.float32(1.0)


@kernel(inner=True)
def _copy(source, at, target, to, count, factor):
    taken, put = source[at : at + count], target[to : to + count]
    for i in range(count):
        put[i] = factor * taken[i]


@kernel(inner=True)
def _factor(source, target, shift, weight, count):
    """target[i] = sample i + shift of ``source`` times 1 + weight (z^shift + z^-shift), for ``count`` floats."""
    here, after = source[shift:], source[2 * shift :]
    for i in range(count):
        target[i] = here[i] + weight * (source[i] + after[i])


@kernel(inner=True)
def _filter_line(source, target, start, step, count, lanes, to_alpha, gain, line, spare):
    """Filter ``lanes`` neighbouring floats, each a line of ``count`` samples ``step`` apart, from ``start`` on.

    ``line`` and ``spare``: scratch of (count + 2 MARGIN) * lanes floats.  There are two, and shifts in place of
    centred sums, so that the loops become wide vectors.
    """
    runs, length = (1, count * lanes) if step == lanes else (count, lanes)
    for run in range(runs):
        _copy(source, start + run * step, line, (MARGIN + run) * lanes, length, ONE)
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
    first_part, last_part, source, target, together, pitch, end, step, count, lanes, to_alpha, gain
):
    """Some of the lines of ``_filter_lines``: parts of ``together`` lines."""
    line = np.empty((count + 2 * MARGIN) * lanes, np.float32)
    spare = np.empty((count + 2 * MARGIN) * lanes, np.float32)
    for n in range(first_part * together, last_part * together):
        start = n * pitch
        if start < end:
            here = lanes if lanes < end - start else end - start
            _filter_line(source, target, start, step, count, here, to_alpha, gain, line, spare)


@kernel
def _filter_lines(parts, arguments):
    """Filter lines of ``lanes`` floats, the first at 0, the next ``pitch`` floats on, all before ``end``, in ``parts``
    of ``together`` lines; ``arguments``: see ``_filter_some``."""
    share_out(_filter_some, parts, arguments)


def spline_coefficients(pixels, coefficients, threads=0):
    """Fill ``coefficients`` with the cubic B-spline coefficients of colour and *alpha*.

    Both (H, W, 4) float32 contiguous; ``pixels``: colour and transmittance.  Beyond its border the image goes on as
    its outermost pixels, which are transparent wherever the image ends because the volume does.
    """
    height, width = pixels.shape[:2]
    source, target = pixels.reshape(-1), coefficients.reshape(-1)
    pitch = 4 * width
    with parallel_call(threads):
        _filter_lines(-(-height // ROWS), (source, target, ROWS, pitch, height * pitch, 4, width, 4, True, ONE))
        lanes = 4 * COLUMNS
        _filter_lines(-(-width // COLUMNS), (target, target, 1, lanes, pitch, pitch, height, lanes, False, GAIN))


def spline_coefficients_numpy(pixels, coefficients):
    """The numpy twin of ``spline_coefficients``."""
    lines = pixels.copy()
    lines[..., 3] = 1 - lines[..., 3]
    for axis in (1, 0):
        edges = [(MARGIN, MARGIN) if a == axis else (0, 0) for a in range(3)]
        lines = np.moveaxis(np.pad(lines, edges, mode="edge"), axis, 0)
        for stride, weight in FACTORS:
            lines = lines[stride:-stride] + weight * (lines[: -2 * stride] + lines[2 * stride :])
        lines = np.moveaxis(lines, 0, axis)
    np.multiply(GAIN, lines, out=coefficients)
