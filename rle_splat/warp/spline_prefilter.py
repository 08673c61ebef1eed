"""B-spline coefficients of an image: what makes the cubic B-spline interpolate instead of blur.

The recursive filter of Unser, Aldroubi and Eden (1993), pole sqrt(3) - 2, mirrored at the borders, run in place
along both image axes; four channels a pixel.
"""

from __future__ import annotations

import numpy as np

from ..jit import kernel, prange

POLE = np.float32(np.sqrt(3.0) - 2.0)
GAIN = np.float32(6.0)  # (1 - pole)(1 - 1 / pole)
LAST = POLE / (POLE * POLE - np.float32(1.0))  # starts the way back at the mirrored far end
FADED = np.float32(1e-18)  # beside what is seen the recursion would fade into slow denormal numbers
ZERO = np.float32(0.0)
STRIP = 16  # columns filtered together
HORIZON = 14  # pole ** 14 is below float32's rounding


@kernel
def _filter_lines(data, start, stride, count, lanes):
    """In-place prefilter of ``lanes`` neighbouring floats at once, each a line of ``count`` elements ``stride`` apart.

    Lanes are contiguous so that the loops over them are wide vectors and whole cache lines.
    """
    if count < 2:
        return
    period = 2 * count - 2
    for lane in range(lanes):
        first = data[start + lane]
        power = POLE
        for n in range(1, HORIZON + 1):
            mirrored = n % period
            mirrored = min(mirrored, period - mirrored)
            first += power * data[start + mirrored * stride + lane]
            power *= POLE
        data[start + lane] = GAIN * first
    for n in range(1, count):
        now = data[start + n * stride : start + n * stride + lanes]
        before = data[start + (n - 1) * stride : start + (n - 1) * stride + lanes]
        for lane in range(lanes):
            value = GAIN * now[lane] + POLE * before[lane]
            now[lane] = value if abs(value) > FADED else ZERO
    now = data[start + (count - 1) * stride : start + (count - 1) * stride + lanes]
    before = data[start + (count - 2) * stride : start + (count - 2) * stride + lanes]
    for lane in range(lanes):
        now[lane] = LAST * (now[lane] + POLE * before[lane])
    for n in range(count - 2, -1, -1):
        now = data[start + n * stride : start + n * stride + lanes]
        after = data[start + (n + 1) * stride : start + (n + 1) * stride + lanes]
        for lane in range(lanes):
            value = POLE * (after[lane] - now[lane])
            now[lane] = value if abs(value) > FADED else ZERO


@kernel(parallel=True)
def spline_coefficients(image):
    """Replace ``image``, (H, W, 4) float32 contiguous, by its cubic B-spline coefficients."""
    height, width = image.shape[0], image.shape[1]
    data = image.reshape(-1)
    for row in prange(height):
        _filter_lines(data, 4 * width * row, 4, width, 4)
    strips = (width + STRIP - 1) // STRIP
    for strip in prange(strips):
        columns = min(STRIP, width - strip * STRIP)
        _filter_lines(data, 4 * STRIP * strip, 4 * width, height, 4 * columns)


def spline_coefficients_numpy(image):
    """The numpy twin of ``spline_coefficients``."""
    for lines in (image.transpose(1, 0, 2), image):  # the recursion runs along the first axis of a view
        count = len(lines)
        if count < 2:
            continue
        powers = POLE ** np.arange(HORIZON + 1, dtype=np.float32)
        ahead = np.arange(HORIZON + 1) % (2 * count - 2)
        lines[0] = np.tensordot(powers, lines[np.minimum(ahead, 2 * count - 2 - ahead)], axes=1)
        lines *= GAIN
        for n in range(1, count):
            lines[n] += POLE * lines[n - 1]
        lines[-1] = LAST * (lines[-1] + POLE * lines[-2])
        for n in range(count - 2, -1, -1):
            lines[n] = POLE * (lines[n + 1] - lines[n])
