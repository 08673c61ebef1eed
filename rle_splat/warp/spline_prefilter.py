"""B-spline coefficients of an image: what makes the cubic B-spline interpolate instead of blur.

The recursive filter of Unser, Aldroubi and Eden (1993), pole sqrt(3) - 2, mirrored at the borders, run in place
along both image axes; four channels a pixel.
"""

from __future__ import annotations

import numpy as np

from ..jit import kernel, prange

POLE = np.float32(np.sqrt(3.0) - 2.0)
GAIN = np.float32(6.0)  # (1 - pole)(1 - 1 / pole)
HORIZON = 14  # pole ** 14 is below float32's rounding


@kernel
def _filter_line(data, start, stride, count):
    """In-place prefilter of ``count`` elements, four channels each, ``stride`` floats apart."""
    if count < 2:
        return
    period = 2 * count - 2
    for c in range(4):
        first = data[start + c]
        power = POLE
        for n in range(1, HORIZON + 1):
            mirrored = n % period
            mirrored = min(mirrored, period - mirrored)
            first += power * data[start + mirrored * stride + c]
            power *= POLE
        data[start + c] = GAIN * first
    for n in range(1, count):
        at = start + n * stride
        for c in range(4):
            data[at + c] = GAIN * data[at + c] + POLE * data[at - stride + c]
    at = start + (count - 1) * stride
    for c in range(4):
        data[at + c] = (POLE / (POLE * POLE - np.float32(1.0))) * (data[at + c] + POLE * data[at - stride + c])
    for n in range(count - 2, -1, -1):
        at = start + n * stride
        for c in range(4):
            data[at + c] = POLE * (data[at + stride + c] - data[at + c])


@kernel(parallel=True)
def spline_coefficients(image):
    """Replace ``image``, (H, W, 4) float32 contiguous, by its cubic B-spline coefficients."""
    height, width = image.shape[0], image.shape[1]
    data = image.reshape(-1)
    for row in prange(height):
        _filter_line(data, 4 * width * row, 4, width)
    for column in prange(width):
        _filter_line(data, 4 * column, 4 * width, height)


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
        lines[-1] = (POLE / (POLE * POLE - np.float32(1.0))) * (lines[-1] + POLE * lines[-2])
        for n in range(count - 2, -1, -1):
            lines[n] = POLE * (lines[n + 1] - lines[n])
