"""One block of pixels of one slab of the scalar: looked up, classified, cut to its ray intervals, composited."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..runtime.jit import inner_loop
from ..view.depth_rules import OWN
from .arguments import Lookup
from .channel_block import add_samples, finish_mixing
from .cut_slab import cut_ends
from .interval_blocks import count_live, is_outside, is_shortened
from .label_block import even_number, find_numbers, keep_near, mix_ends, note_looks
from .label_fields import are_cells
from .mist_block import copy_colors, fade_added
from .pixel_block import BLOCK, TRANSMITTANCE
from .ray_sums import add_depths, gather_values, sheet_depth, thin_slab
from .rays_in_box import inside_box
from .sample_block import begin_light, find_span, find_span_each, light_between, light_mixed, light_own
from .sample_lamps import HELD
from .scalar_block import (
    classify_spans,
    classify_values,
    composite_classified,
    look_between,
    look_between_each,
    look_up,
)  # fmt: skip
from .sheet_row import note_half_depth

LIVE = 1  # of a block that nothing was composited over: some of its pixels are not opaque
NO_SHARE = np.float32(0.0)  # of the second of two scanlines


class Samples(NamedTuple):
    """A block of one sheet: ``samples`` of the scanlines that begin at ``upper`` and ``lower``, and the fraction
    ``down`` (float32) towards the latter."""

    samples: np.ndarray
    upper: int
    lower: int
    down: np.float32


class Pixels(NamedTuple):
    """A block of the intermediate image: number ``b`` in row ``r`` of the band, ``count`` pixels of row ``v`` from
    ``first`` on."""

    r: int
    b: int
    v: int
    first: int
    count: int


@inner_loop
def _ends_of(intervals, least, is_shortened, begin, end, here, there, pixels, block):
    """Samples of both ends of a slab: of its sheets, or, where ray intervals cut it, of where rays end in it."""
    if intervals is not None:
        if is_shortened and cut_ends(
            intervals, pixels.v, pixels.first, pixels.count, begin, end, here.samples, here.upper, here.lower,
            here.down, there.samples, there.upper, there.lower, there.down, least, block.samples,
        ):  # fmt: skip
            return Samples(block.samples, BLOCK, BLOCK, NO_SHARE), Samples(block.samples, 0, 0, NO_SHARE)
    return here, there


@inner_loop
def _look_up(intervals, lookup, kind, is_shortened, begin, end, here, there, pixels, block):
    """The entries of the lookup table for one block of a slab, to ``block``; see ``scalar_block.look_between``."""
    _, _, origin, rate, least, low, high, nearest, furthest, last = lookup
    entries, spans, shares = block.entries, block.spans, block.shares
    sheet, upper, lower, down = here
    if kind == OWN:
        return look_up(sheet, upper, lower, down, low, high, origin, rate, last, entries, shares)
    (sheet, upper, lower, down), (before, upper_before, lower_before, down_before) = _ends_of(
        intervals, least, is_shortened, begin, end, here, there, pixels, block
    )
    return look_between(
        sheet, upper, lower, down, before, upper_before, lower_before, down_before, least, low, high, nearest, furthest,
        origin, rate, last, entries, spans, shares,
    )  # fmt: skip


@inner_loop
def _see(channels, intervals, lookup, kind, is_shortened, begin, end, here, there, pixels, block):
    """As ``_look_up``; of several channels it is not known before they are classified, so all count as seen."""
    if channels is None:
        return _look_up(intervals, lookup, kind, is_shortened, begin, end, here, there, pixels, block)
    return BLOCK


@inner_loop
def _classify(table, sums, seen, block):
    """Extinction times color, and extinction, of a block's entries, to ``block.samples``."""
    if seen & 255 > seen >> 8:
        classify_values(table, block.entries, block.samples)
    else:
        block.samples[:] = np.float32(0.0)
    if seen >> 8 > 0:
        classify_spans(sums, block.spans, block.shares, block.samples)


@inner_loop
def lookup_at(channels, number):
    """The Lookup of one of ChannelLookups."""
    first, last = channels.begins[number], channels.begins[number + 1]
    origin, rate, least, low, high, nearest, furthest = (
        channels.numbers[number, 0], channels.numbers[number, 1], channels.numbers[number, 2],
        channels.numbers[number, 3], channels.numbers[number, 4], channels.numbers[number, 5],
        channels.numbers[number, 6],
    )  # fmt: skip
    return Lookup(
        channels.tables[first:last], channels.sums[first:last], origin, rate, least, low, high, nearest, furthest,
        np.int32((last - first) // 4 - 1),
    )  # fmt: skip


@inner_loop
def _moved(samples, plane):
    """The Samples of another plane than the scalar's."""
    sheet, upper, lower, down = samples
    return Samples(sheet, upper + BLOCK * plane, lower + BLOCK * plane, down)


@inner_loop
def _find_span(lamps, lookup, here, there, block):
    if lamps is not None:
        sheet, upper, lower, down = here
        before, upper_before, lower_before, down_before = there
        find_span(
            sheet, upper, lower, down, before, upper_before, lower_before, down_before, lookup.low, lookup.high,
            block.shares,
        )  # fmt: skip


@inner_loop
def _look_up_each(intervals, least, kind, is_shortened, begin, end, here, there, pixels, block):
    """As ``_look_up``, each pixel by the table that ``note_looks`` has noted."""
    if kind == OWN:
        there = here
    else:
        here, there = _ends_of(intervals, least, is_shortened, begin, end, here, there, pixels, block)
    return look_between_each(
        here.samples, here.upper, here.lower, here.down, there.samples, there.upper, there.lower, there.down,
        block.looks, block.table_rows, block.entries, block.spans, block.shares,
    )  # fmt: skip


@inner_loop
def _classify_each(
    intervals, lamps, channels, first, kind, is_shortened, begin, end, here, there, pixels, block
):  # fmt: skip
    """Look up and classify a block, each pixel by the function of its number from ``first`` on in ``block.numbers``; 0
    where nothing is seen."""
    note_looks(channels, block.numbers, first, block.looks, block.table_rows)
    least = channels.numbers[0, 2]
    seen = _look_up_each(intervals, least, kind, is_shortened, begin, end, here, there, pixels, block)
    _classify(channels.tables, channels.sums, seen, block)
    if lamps is not None and kind != OWN:
        sheet, upper, lower, down = here
        before, upper_before, lower_before, down_before = there
        find_span_each(
            sheet, upper, lower, down, before, upper_before, lower_before, down_before, block.looks, block.shares
        )  # fmt: skip
    return seen


@inner_loop
def _mix_labels(
    labels, box, intervals, lamps, channels, kind, is_shortened, cut, begin, end, here, there, pixels, block
):  # fmt: skip
    """Classify a block of a slab by the functions of labels, which share the slab of each pixel; 0 where nothing is
    seen."""
    number = even_number(labels, begin, end, pixels)
    if number >= 0:
        lookup = lookup_at(channels, number)
        seen = _look_up(intervals, lookup, kind, is_shortened, begin, end, here, there, pixels, block)
        _classify(lookup.table, lookup.sums, seen, block)
        if kind != OWN:
            _find_span(lamps, lookup, here, there, block)
        return seen
    crosses = find_numbers(labels, box, intervals, begin, end, cut, pixels, block.numbers, block.parts)
    seen = _classify_each(intervals, lamps, channels, 0, kind, is_shortened, begin, end, here, there, pixels, block)
    if crosses:
        keep_near(block.samples, block.shares, block.mixed)
        seen |= _classify_each(
            intervals, lamps, channels, BLOCK, kind, is_shortened, begin, end, here, there, pixels, block
        )  # fmt: skip
        mix_ends(block.parts, block.mixed, block.samples, block.shares)
    return seen


@inner_loop
def _mix_channels(
    labels, box, intervals, lamps, channels, kind, is_shortened, cut, begin, end, here, there, pixels, block
):  # fmt: skip
    """Classify a block of a slab by each channel's own table, the volume itself by those of labels if there are any,
    and add up, to ``block.samples`` and ``block.shares``; 0 where nothing is seen."""
    seen, first = 0, 0
    if are_cells(labels.cells):
        seen, first = _mix_labels(
            labels, box, intervals, lamps, channels, kind, is_shortened, cut, begin, end, here, there, pixels, block
        ), channels.own  # fmt: skip
        if first == channels.planes.size:
            return seen
    block.mixed[:] = np.float32(0.0)
    if first > 0:
        add_samples(block.samples, block.shares, block.mixed)
    for number in range(first, channels.planes.size):
        lookup, plane = lookup_at(channels, number), channels.planes[number]
        own, own_before = _moved(here, plane), _moved(there, plane)
        found = _look_up(intervals, lookup, kind, is_shortened, begin, end, own, own_before, pixels, block)
        seen |= found
        _classify(lookup.table, lookup.sums, found, block)
        if kind != OWN:
            _find_span(lamps, lookup, own, own_before, block)
        add_samples(block.samples, block.shares, block.mixed)
    finish_mixing(block.mixed, block.samples, block.shares)
    return seen


@inner_loop
def _classified(
    labels, channels, box, intervals, lamps, lookup, seen, kind, is_shortened, cut, begin, end, here, there,
    pixels, block,
):  # fmt: skip
    """Classify a block, by the volume's own table as ``_look_up`` has seen it, or by those of all channels and labels;
    0 where nothing is seen."""
    if channels is None:
        _classify(lookup.table, lookup.sums, seen, block)
        return seen
    return _mix_channels(
        labels, box, intervals, lamps, channels, kind, is_shortened, cut, begin, end, here, there, pixels, block
    )  # fmt: skip


@inner_loop
def _light_slab(
    channels, lookup, here, there, length, deep, thickness, left, position, at, lamps, pixels, block, rows
):  # fmt: skip
    """As ``_light_samples``, between two sheets; ``at``: of the block, ``left`` its transmittance."""
    sheet, upper, lower, down = here
    before, upper_before, lower_before, down_before = there
    if channels is None:
        light_between(
            block.samples, 0, sheet, upper, lower, down, before, upper_before, lower_before, down_before,
            block.shares, lookup.low, lookup.high, length, deep, thickness, rows.state, left, rows.light, HELD * at,
            lamps, pixels.first, pixels.v, position,
        )  # fmt: skip
    else:
        light_mixed(
            block.samples, 0, sheet, upper, lower, down, before, upper_before, lower_before, down_before,
            block.shares, lookup.low, lookup.high, length, deep, thickness, rows.state, left, rows.light, HELD * at,
            lamps, pixels.first, pixels.v, position,
        )  # fmt: skip


@inner_loop
def _light_samples(lamps, channels, kind, lookup, here, there, length, deep, thickness, position, pixels, block, rows):
    """Light a classified block; nothing without ``lamps``.  ``position``: of the slab's middle."""
    if lamps is not None:
        sheet, upper, lower, down = here
        at = BLOCK * (pixels.r * rows.bright.shape[1] + pixels.b)
        left = 4 * at + TRANSMITTANCE
        begin_light(lamps, rows.light, HELD * at)
        if kind == OWN:
            light_own(
                block.samples, 0, sheet, upper, lower, down, sheet, upper, lower, down, block.shares, lookup.low,
                lookup.high, length, deep, thickness, rows.state, left, rows.light, HELD * at, lamps, pixels.first,
                pixels.v, position,
            )  # fmt: skip
        else:
            _light_slab(
                channels, lookup, here, there, length, deep, thickness, left, position, at, lamps, pixels, block, rows
            )


@inner_loop
def _thin(thinning, here, there, length, deep, block):
    """``thin_slab`` where a plane holds a factor of extinction; whether one does."""
    if thinning == 0:
        return False
    sheet, upper, lower, down = here
    before, upper_before, lower_before, down_before = there
    thin_slab(
        sheet, upper, lower, down, before, upper_before, lower_before, down_before, thinning * BLOCK,
        block.shares, length, deep, block.length_inside,
    )  # fmt: skip
    return True


@inner_loop
def _composite_classified(intervals, mist, medium, length, deep, begin, end, thickness, pixels, rows, block, half):
    """Composite a classified block; how many of its pixels are not opaque."""
    r, b, v, first_pixel, count = pixels
    state, to = rows.state, 4 * BLOCK * (r * rows.bright.shape[1] + b)
    if mist is not None:
        if mist.place.size > 0:
            copy_colors(state, to, block.colors)
    found = composite_classified(
        block.samples, block.shares, length, deep, thickness, medium.least, state, to, block.before
    )
    if mist is not None:
        if mist.place.size > 0:
            fade_added(mist, state, to, block.colors, block.before, 0.5 * (begin + end), v, first_pixel, count)
    bright = found >> 8
    if bright != rows.bright[r, b]:
        rows.bright[r, b] = bright
        note_half_depth(
            medium.box, intervals, block.before, state, to + TRANSMITTANCE, begin, end, half, v, first_pixel, count,
            block.samples,
        )  # fmt: skip
    return count_live(intervals, found & 255, rows.bounds, r, b, end, state, to, medium.least, v, first_pixel, count)


@inner_loop
def composite_slab(
    intervals, sign, absorbs, mist, channels, labels, medium, sheets, number, kind, begin, end, thickness, row, here,
    there, pixels, rows, block, half,
):  # fmt: skip
    """Composite a block of sheet ``number``, or add it to what ``ray_sums`` makes of the rays; how many of its pixels
    are not opaque.

    ``intervals``, ``sign``, ``absorbs``, ``mist``, ``channels``, ``labels``: of Rays and ScalarMedium; what is None is
    not compiled.  ``begin``, ``end``, ``thickness`` (float32): the slab, voxels.  ``here``, ``there``: Samples of the
    sheet and the one before.
    """
    _, box, lookup, planes, _, _, _, _, _, _, _ = medium
    r, b, v, first_pixel, count = pixels
    shortened = False
    if intervals is not None:
        if is_outside(rows.bounds, r, b, begin, end):
            return LIVE
        shortened = is_shortened(rows.bounds, r, b, begin, end)
    seen = 0
    if sign is None:
        seen = _see(channels, intervals, lookup, kind, shortened, begin, end, here, there, pixels, block)
        if seen == 0:
            return LIVE
    at = BLOCK * (r * rows.bright.shape[1] + b)
    length, deep = rows.length, at
    whole = begin >= max(box.blocks[1, b], row.enter) and end <= min(box.blocks[2, b], row.leave)
    cut = shortened or not whole
    if cut:
        inside_box(
            box.columns, box.rows, intervals, v, first_pixel, count, begin, end, rows.length, at, block.length_inside
        )
        length, deep = block.length_inside, 0
    sheet, upper, lower, down = here
    if sign is not None:
        position = sheets.first_slice[number] + sheets.slice_weights[number, 1]
        gather_values(
            sheet, upper, lower, down, sign, lookup.origin, lookup.least, length, deep, thickness, rows.state, 4 * at,
            sheet_depth(position, begin, end), cut, box.columns, box.rows, intervals, v, first_pixel, count,
            block.samples, half,
        )  # fmt: skip
        return LIVE
    if _thin(planes.thinning, here, there, length, deep, block):
        length, deep = block.length_inside, 0
    if absorbs is not None:
        add_depths(
            lookup.table, lookup.sums, block.entries, block.spans, block.shares, seen, length, deep, thickness,
            rows.state, 4 * at, begin, end, cut, box.columns, box.rows, intervals, v, first_pixel, count, block.before,
            half,
        )  # fmt: skip
        return LIVE
    seen = _classified(
        labels, channels, box, intervals, planes.lamps, lookup, seen, kind, shortened, cut, begin,
        end, here, there, pixels, block,
    )  # fmt: skip
    if seen == 0:
        return LIVE
    _light_samples(
        planes.lamps, channels, kind, lookup, here, there, length, deep, thickness, 0.5 * (begin + end), pixels, block,
        rows,
    )  # fmt: skip
    return _composite_classified(
        intervals, mist, medium, length, deep, begin, end, thickness, pixels, rows, block, half
    )
