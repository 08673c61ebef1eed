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
from .sample_block import SPAN_BEGIN, SPAN_END

_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
ROUNDING = 1e-6  # voxels


@inner_loop
def even_number(labels, begin, end, pixels):
    """The function that all of a block of a slab belongs to, if that is seen at once; else -1.

    ``labels``: LabelField.  A part of the slab in which rays move at most half a voxel to both sides of its middle has
    one function if the voxel nearest to the middle and those around it do.
    """
    parts = max(math.ceil(labels.steepest * (end - begin) - ROUNDING), 1)
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
def note_looks(channels, numbers, first, looks, rows):
    """How pixels look their functions up, by ``numbers`` from ``first`` on: see ``scalar_block.look_between_each``."""
    for i in range(BLOCK):
        number = numbers[first + i]
        begin, end = channels.begins[number] >> 2, channels.begins[number + 1] >> 2
        for n in range(7):
            looks[BLOCK * n + i] = channels.numbers[number, n]
        rows[i], rows[BLOCK + i] = end - begin - 1, begin


@inner_loop
def keep_near(samples, shares, mixed):
    """Keep what the functions at the begins of slabs show, before those at their ends are looked up."""
    for i in range(4 * BLOCK):
        mixed[i] = samples[i]
    for i in range(BLOCK):
        mixed[4 * BLOCK + i] = shares[BLOCK * SPAN_BEGIN + i]
        mixed[5 * BLOCK + i] = shares[BLOCK * SPAN_END + i]


@inner_loop
def mix_ends(parts, mixed, samples, shares):
    """Mix what the functions at the begins of slabs show, of ``keep_near``, with ``samples`` and ``shares`` of those at
    their ends: extinctions by their ``parts`` of the slab, where what is shown begins and ends by these extinctions."""
    for i in range(BLOCK):
        near, far = parts[i] * mixed[3 * BLOCK + i], (_ONE - parts[i]) * samples[3 * BLOCK + i]
        part = far / (near + far) if near + far > _ZERO else _ZERO
        begin, end = mixed[4 * BLOCK + i], mixed[5 * BLOCK + i]
        shares[BLOCK * SPAN_BEGIN + i] = begin + part * (shares[BLOCK * SPAN_BEGIN + i] - begin)
        shares[BLOCK * SPAN_END + i] = end + part * (shares[BLOCK * SPAN_END + i] - end)
        for plane in range(4):
            at = BLOCK * plane + i
            samples[at] = parts[i] * mixed[at] + (_ONE - parts[i]) * samples[at]
