"""A block of a slab that functions of several labels classify, each what of it belongs to its label.

Mostly all of the block belongs to one label, which a look at the voxels nearest to the middle of the slab shows: the
voxels around these then have one label.  Else each pixel belongs to a label where its ray enters the slab and to one
where it leaves.  Where these differ the boundary lies where the leads, linear in between, are alike, and each of the
two has its share of the slab.
"""

from __future__ import annotations

import math

import numpy as np

from ..classify.label_cells import BESIDE, MIXED, NO_KIND
from ..runtime.jit import inner_loop
from .label_fields import crossing, label_on_ray, refine_crossing, scanline_at, word_on_ray
from .pixel_block import BLOCK
from .rays_in_box import interval_in_box

_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


@inner_loop
def even_number(labels, begin, end, pixels):
    """The function that all of a block of a slab belongs to, if that is seen at once; else -1.

    ``labels``: LabelField.  A part of the slab in which rays move at most half a voxel to both sides of its middle has
    one function if the voxel nearest to the middle and those around it do.
    """
    parts = max(math.ceil(labels.steepest * (end - begin)), 1)
    step = (end - begin) / parts
    first, differ = -1, 0
    for part in range(parts):
        s = begin + (part + 0.5) * step
        line = scanline_at(labels, pixels.v, s, 0.5, 0)
        if part == 0:
            first = word_on_ray(labels, pixels.first, line, s, 0.5, 0)
        for i in range(pixels.count):
            differ |= word_on_ray(labels, pixels.first + i, line, s, 0.5, 0) ^ first
    return first if differ == 0 and first < BESIDE else -1


@inner_loop
def find_numbers(labels, box, intervals, begin, end, cut, pixels, numbers, parts):
    """Of each pixel of a block the functions at both ends of a slab, to ``numbers`` (2 * BLOCK,), and the share of the
    nearer one, to ``parts``; whether the two differ anywhere.

    ``labels``: LabelField.  ``cut``: whether rays may begin or end within the slab.
    """
    v, from_, to, crosses = pixels.v, begin, end, False
    near_line, far_line = scanline_at(labels, v, begin, 0.0, 1), scanline_at(labels, v, end, 0.0, 1)
    for i in range(pixels.count):
        u = pixels.first + i
        if cut:
            enter, leave = interval_in_box(box.columns, box.rows, intervals, v, pixels.first, i)
            from_, to = max(begin, np.float64(enter)), min(end, np.float64(leave))
            to = max(from_, to)
            near_line, far_line = scanline_at(labels, v, from_, 0.0, 1), scanline_at(labels, v, to, 0.0, 1)
        near = word_on_ray(labels, u, near_line, from_, 0.0, 1)
        far = word_on_ray(labels, u, far_line, to, 0.0, 1)
        parts[i] = _ONE
        if (near | far) & MIXED != 0 or (near ^ far) & NO_KIND != 0:
            near, near_lead = label_on_ray(labels, u, v, from_)
            far, far_lead = label_on_ray(labels, u, v, to)
            if near != far:
                crosses = True
                share = crossing(near_lead, far_lead)
                number, lead = label_on_ray(labels, u, v, from_ + share * (to - from_))
                parts[i] = np.float32(refine_crossing(share, near, near_lead, far, far_lead, number, lead))
        numbers[i], numbers[BLOCK + i] = near & NO_KIND, far & NO_KIND
    for i in range(pixels.count, BLOCK):
        numbers[i], numbers[BLOCK + i], parts[i] = numbers[0], numbers[0], _ONE
    return crosses


@inner_loop
def look_up_numbers(channels, sheet, upper, lower, down, numbers, first, entries):
    """Entries (BLOCK,) of ``channels.tables``, a sample of one sheet by the function of each pixel, from ``numbers``;
    see ``scalar_block.look_up``.  How many lie within what these show."""
    seen = 0
    for i in range(BLOCK):
        number = numbers[first + i]
        value = sheet[upper + i] * (_ONE - down) + sheet[lower + i] * down
        origin, rate = channels.numbers[number, 0], channels.numbers[number, 1]
        begin = channels.begins[number] >> 2
        entry = (channels.begins[number + 1] >> 2) - 1 - begin
        if channels.numbers[number, 3] <= value <= channels.numbers[number, 4]:
            entry = int(min(max((value - origin) * rate, _ZERO), np.float32(entry - 1)))
            seen += 1
        entries[i] = begin + entry
    return seen


@inner_loop
def mix_ends(parts, samples, others):
    """Mix the ``samples`` (4 * BLOCK,) of slabs by the functions at their begins with ``others``, at their ends."""
    for plane in range(4):
        for i in range(BLOCK):
            at = BLOCK * plane + i
            samples[at] = parts[i] * samples[at] + (_ONE - parts[i]) * others[at]


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
