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

from ..jit import kernel, prange

# Samples to each side that a coefficient depends on, along each axis: 1 + 2 + 4 + 8.
MARGIN = 15
FACTORS = tuple((1 << n, np.float32(c)) for n, c in enumerate((-1.0 / 4.0, 1.0 / 14.0, 1.0 / 194.0, 1.0 / 37634.0)))
# Both axes' g: a constant image is its own coefficients.
GAIN = np.float32(np.prod([1.0 + 2.0 * float(weight) for _, weight in FACTORS]) ** -2)
ROWS, COLUMNS = 16, 8  # filtered together: few enough to stay in the cache, and columns of whole cache lines


@kernel
def _factor(source, target, shift, weight, count):
    """target[i] = sample i + shift of ``source`` times 1 + weight (z^shift + z^-shift), for ``count`` floats."""
    here, after = source[shift:], source[2 * shift :]
    for i in range(count):
        target[i] = here[i] + weight * (source[i] + after[i])


@kernel
def _divide(line, spare, pitch, count):
    """Divide by the spline's values: ``line`` holds ``count`` floats after MARGIN * pitch others and before as many;
    the result begins at 0.  Samples are ``pitch`` floats apart.  ``spare``: as long, for use meanwhile.

    Two arrays, and shifts in place of centred sums, so that the loops become wide vectors.
    """
    _factor(line, spare, pitch, FACTORS[0][1], count + 28 * pitch)
    _factor(spare, line, 2 * pitch, FACTORS[1][1], count + 24 * pitch)
    _factor(line, spare, 4 * pitch, FACTORS[2][1], count + 16 * pitch)
    _factor(spare, line, 8 * pitch, FACTORS[3][1], count)


@kernel
def _filter_rows(pixels, coefficients, first, last):
    """Rows ``first`` to ``last`` of ``coefficients`` from colour and transmittance; along the rows only."""
    width = pixels.shape[1]
    line = np.empty(4 * (width + 2 * MARGIN), np.float32)
    spare = np.empty_like(line)
    for row in range(first, last):
        samples = line[4 * MARGIN : 4 * (MARGIN + width)]
        source = pixels[row].reshape(-1)
        for i in range(4 * width):
            samples[i] = source[i]
        for n in range(width):
            samples[4 * n + 3] = np.float32(1.0) - samples[4 * n + 3]
        for n in range(MARGIN):
            for channel in range(4):
                line[4 * n + channel] = samples[channel]
                line[4 * (MARGIN + width + n) + channel] = samples[4 * width - 4 + channel]
        _divide(line, spare, 4, 4 * width)
        target = coefficients[row].reshape(-1)
        for i in range(4 * width):
            target[i] = line[i]


@kernel
def _filter_columns(coefficients, first, last):
    """Columns ``first`` to ``last`` of ``coefficients`` in place, along the columns only, and both axes' gain."""
    height, width = coefficients.shape[0], coefficients.shape[1]
    pitch = 4 * (last - first)
    data = coefficients.reshape(-1)
    line = np.empty((height + 2 * MARGIN) * pitch, np.float32)
    spare = np.empty_like(line)
    for n in range(-MARGIN, height + MARGIN):
        row = min(max(n, 0), height - 1)
        source = data[4 * (row * width + first) : 4 * (row * width + last)]
        target = line[(n + MARGIN) * pitch : (n + MARGIN + 1) * pitch]
        for i in range(pitch):
            target[i] = source[i]
    _divide(line, spare, pitch, height * pitch)
    for row in range(height):
        source = line[row * pitch : (row + 1) * pitch]
        target = data[4 * (row * width + first) : 4 * (row * width + last)]
        for i in range(pitch):
            target[i] = GAIN * source[i]


@kernel(parallel=True)
def spline_coefficients(pixels, coefficients):
    """Fill ``coefficients`` with the cubic B-spline coefficients of colour and *alpha*.

    Both (H, W, 4) float32 contiguous; ``pixels``: colour and transmittance.  Beyond its border the image goes on as
    its outermost pixels, which are transparent wherever the image ends because the volume does.
    """
    height, width = pixels.shape[0], pixels.shape[1]
    for band in prange((height + ROWS - 1) // ROWS):
        _filter_rows(pixels, coefficients, band * ROWS, min((band + 1) * ROWS, height))
    for strip in prange((width + COLUMNS - 1) // COLUMNS):
        _filter_columns(coefficients, strip * COLUMNS, min((strip + 1) * COLUMNS, width))


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
