"""Blocks of pixels that are inside the box through a whole group of sheets: looked up one after the other, then
composited.

What a block is composited from was stored when it was looked up, and reading it at once would have to wait for that.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import inner_loop
from .pixel_block import BLOCK
from .ray_ends import NO_ROW
from .scalar_group import GROUP, composite_group, look_up_group
from .scratch import BAND
from .sheet_row import note_half_depth
from .voxel_scanline import ONE_BIT, WORD

NO_BITS = np.uint64(0)


@inner_loop(forceinline=True)
def marked_by_both(marks, slot, word):
    """The blocks that the scanlines of a slot and of the next one both have, as bits."""
    return marks[slot, word] & marks[slot + 1, word] if slot != NO_ROW else NO_BITS


@inner_loop(forceinline=True)
def look_up_waiting(
    waiting, r, word, b, sheet, planes, blocks, absent, marks, row_slot, queue, places, downs, low, high, origin, rate,
    last, starts,
):
    """Look up block ``b`` of row ``r`` of a band in all sheets of a group; how many blocks of the row wait then.

    ``waiting``: how many do now.  ``row_slot``: BAND of each sheet.  Out, of the block if it shows anything: ``queue``
    its number, ``places`` and ``starts``, where its rows of the table are, as ``scalar_group`` has them (``entries``).
    """
    bit = ONE_BIT << np.uint64(b % WORD)
    for number in range(GROUP):
        slot = row_slot[BAND * number + r]
        there = marked_by_both(marks, slot, word) & bit != NO_BITS
        upper = planes * BLOCK * (slot * blocks + b)
        at = 2 * (GROUP * waiting + number)
        places[at] = upper if there else absent
        places[at + 1] = upper + planes * BLOCK * blocks if there else absent
    queue[waiting] = b
    if look_up_group(sheet, places, waiting, downs, low, high, origin, rate, last, starts) == 0:
        return waiting
    return waiting + 1


@inner_loop(forceinline=True)
def composite_waiting(
    waiting, r, word, v, first, begins, ends, image_width, table, starts, sheet, places, queue, downs, depths, matt,
    gloss, lengths, least_light, state, alive, bright, blocks, before, looks, half,
):
    """Composite the blocks of a row that wait through the sheets from number ``first`` on; whether any became opaque.

    The arguments are those of ``look_up_waiting`` and of ``scalar_sheets._composite_sheets``.
    """
    died = False
    for number in range(waiting):
        b = queue[number]
        at = r * blocks + b
        pixels = composite_group(
            table, starts, sheet, places, number, downs, matt, gloss, lengths, BLOCK * at, depths, least_light, state,
            4 * BLOCK * at, before,
        )
        if pixels >> 8 != bright[r, b]:
            bright[r, b] = pixels >> 8
            count = min(BLOCK, image_width - b * BLOCK)
            for slab in range(GROUP):
                note_half_depth(
                    before[BLOCK * slab :], before, BLOCK * (slab + 1), begins[first + slab], ends[first + slab], half,
                    v, b * BLOCK, count, looks,
                )
        if pixels & 255 == 0:
            alive[r, word] ^= ONE_BIT << np.uint64(b % WORD)
            died = True
    return died
