"""A block of a slab that functions of several labels classify, each what of it belongs to its label.

Where a ray enters and leaves the slab it belongs to a label each.  Mostly that is one label for all of the block.
Where it is not, the boundary between the two is searched for along the ray, and each of them has its share of the slab.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import inner_loop
from .label_fields import number_on_ray, share_on_ray
from .pixel_block import BLOCK
from .rays_in_box import interval_in_box

_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


@inner_loop
def find_numbers(labels, box, intervals, begin, end, cut, pixels, numbers, parts):
    """Of each pixel of a block the functions at both ends of a slab, to ``numbers`` (2 * BLOCK,), and the share of the
    nearer one, to ``parts``; whether all are the same.

    ``labels``: LabelField.  ``cut``: whether rays may begin or end within the slab.
    """
    even = True
    for i in range(pixels.count):
        u = pixels.first + i
        from_, to = begin, end
        if cut:
            enter, leave = interval_in_box(box.columns, box.rows, intervals, pixels.v, pixels.first, i)
            from_, to = max(begin, np.float64(enter)), min(end, np.float64(leave))
            to = max(from_, to)
        near, far = number_on_ray(labels, u, pixels.v, from_), number_on_ray(labels, u, pixels.v, to)
        numbers[i], numbers[BLOCK + i] = near, far
        parts[i] = _ONE
        if near != far:
            parts[i] = np.float32(share_on_ray(labels, u, pixels.v, from_, to, near))
        even = even and near == numbers[0] and far == numbers[0]
    for i in range(pixels.count, BLOCK):
        numbers[i], numbers[BLOCK + i], parts[i] = numbers[0], numbers[0], _ONE
    return even


@inner_loop
def next_number(numbers, last):
    """The smallest function number of a block above ``last``; -1 where there is none."""
    found = -1
    for i in range(2 * BLOCK):
        number = numbers[i]
        if number > last and (found < 0 or number < found):
            found = number
    return found


@inner_loop
def weaken_samples(numbers, parts, number, sampled):
    """Multiply classified samples, (4 * BLOCK,), of a function by what of each pixel's slab belongs to it.

    ``numbers``, ``parts``: of ``find_numbers``; the second half of the latter is written.
    """
    for i in range(BLOCK):
        part = parts[i] if numbers[i] == number else _ZERO
        parts[BLOCK + i] = part + (_ONE - parts[i] if numbers[BLOCK + i] == number else _ZERO)
    for plane in range(4):
        for i in range(BLOCK):
            sampled[BLOCK * plane + i] *= parts[BLOCK + i]
