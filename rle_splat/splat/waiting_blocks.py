"""Blocks of pixels that are inside the box through a whole group of sheets: first all are looked up in the table, then
all are composited.

Compositing a block reads what looking it up has just stored; with other blocks in between it need not wait for that.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import inner_loop
from .pixel_block import BLOCK, TRANSMITTANCE
from .rays_in_box import NO_ROW
from .sample_block import begin_light, classify_member, light_own
from .sample_lamps import HELD
from .scalar_group import GROUP, composite_group, look_up_group
from .scalar_slab import NO_SHARE
from .scratch import BAND
from .sheet_row import note_half_depth
from .voxel_scanline import NO_BITS, ONE_BIT, WORD


@inner_loop
def marked_by_both(marks, slot, word):
    """The blocks that the scanlines of a slot and of the next one both have, as bits."""
    return marks[slot, word] & marks[slot + 1, word] if slot != NO_ROW else NO_BITS


@inner_loop
def look_up_waiting(queued, r, b, scanlines, planes, blocks, waiting, lookup):
    """Look up block ``b`` of row ``r`` of a band in all sheets of a group; how many blocks of the row wait then.

    ``queued``: how many do now.  ``scanlines``: ``scratch.Scanlines`` of the group, of ``planes`` numbers a pixel and
    ``blocks`` blocks a slot.  ``waiting``: ``scratch.WaitingBlocks``, to which the block is added if it shows
    anything.  ``lookup``: ``arguments.Lookup``.
    """
    queue, places, starts, downs, _ = waiting
    samples, marks, row_slot, _, _ = scanlines
    _, _, origin, rate, _, low, high, _, _, last = lookup
    absent = samples.size - planes * BLOCK
    bit = ONE_BIT << np.uint64(b % WORD)
    for number in range(GROUP):
        slot = row_slot[BAND * number + r]
        there = marked_by_both(marks, slot, b // WORD) & bit != NO_BITS
        upper = planes * BLOCK * (slot * blocks + b)
        at = 2 * (GROUP * queued + number)
        places[at] = upper if there else absent
        places[at + 1] = upper + planes * BLOCK * blocks if there else absent
    queue[queued] = b
    if look_up_group(samples, places, queued, downs, low, high, origin, rate, last, starts) == 0:
        return queued
    return queued + 1


@inner_loop
def _composite_group(lamps, number, table, least, samples, waiting, sheets, first, pixel, v, at, rows, block):
    """Composite block number ``at`` of the band, which waits as ``number``, lit sample by sample if there are
    ``lamps``; what is returned: see ``composite_group``.

    ``first``: of the group's sheets.  ``pixel``, ``v``: column of the block's first pixel, and row.
    """
    _, places, starts, downs, depths = waiting
    state, to = rows.state, 4 * BLOCK * at
    if lamps is None:
        return composite_group(table, starts, number, rows.length, BLOCK * at, depths, least, state, to, block.before)
    begin_light(lamps, rows.light, HELD * BLOCK * at)
    for member in range(GROUP):
        classify_member(table, starts, (number * GROUP + member) * BLOCK, member, block.classified)
        which = 2 * (GROUP * number + member)
        position = 0.5 * (sheets.begin[first + member] + sheets.end[first + member])
        upper, lower, down = places[which], places[which + 1], downs[member]
        light_own(
            block.classified, 4 * BLOCK * member, samples, upper, lower, down, samples, upper, lower, down,
            block.shares, NO_SHARE, NO_SHARE, rows.length, BLOCK * at, depths[member], state, to + TRANSMITTANCE,
            rows.light, HELD * BLOCK * at, lamps, pixel, v, position,
        )  # fmt: skip
    return composite_group(
        block.classified, None, number, rows.length, BLOCK * at, depths, least, state, to, block.before
    )


@inner_loop
def composite_waiting(queued, r, word, window, first, sheets, table, lamps, least, samples, waiting, rows, block, half):
    """Composite the blocks of a row that wait through the sheets from number ``first`` on; whether any became opaque.

    ``window``: ``band_walker.Window``.  ``sheets``: ``arguments.SheetList``.  ``table``: of
    ``arguments.Lookup``.  ``lamps``: SampleLamps or None.  ``least``: transmittance at which a pixel is opaque.
    ``samples``: of ``scratch.Scanlines``.  ``waiting``, ``rows``, ``block``: the groups of ``scratch.Scratch``.
    ``half``: (H, W) float32, see ``sheet_row.note_half_depth``.
    """
    queue, alive, bright, before = waiting.queue, rows.alive, rows.bright, block.before
    blocks = bright.shape[1]
    died = False
    for number in range(queued):
        b = queue[number]
        pixels = _composite_group(
            lamps, number, table, least, samples, waiting, sheets, first, b * BLOCK, window.top_row + r,
            r * blocks + b, rows, block,
        )  # fmt: skip
        if pixels >> 8 != bright[r, b]:
            bright[r, b] = pixels >> 8
            count = min(BLOCK, window.image_width - b * BLOCK)
            for slab in range(GROUP):
                note_half_depth(
                    None, None, before[BLOCK * slab :], before, BLOCK * (slab + 1), sheets.begin[first + slab],
                    sheets.end[first + slab], half, window.top_row + r, b * BLOCK, count, block.samples,
                )  # fmt: skip
        if pixels & 255 == 0:
            alive[r, word] ^= ONE_BIT << np.uint64(b % WORD)
            died = True
    return died
