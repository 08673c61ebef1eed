"""The sheet-buffer loop with sheets of the scalar, classified pixel by pixel (algorithm.md 1.14).

The same walk as in ``sheet_buffer``: voxel scanlines run by run, resampled along the scanline once for all rows of a
band that share them, marked as bits; then each row mixes two scanlines.  What differs is what a sheet holds: the
scalar itself, and light, which a table makes extinction and colour of when everything is interpolated.  The medium
fills the box of the voxel centres: a ray's first and last slab end where it enters and leaves the box.
"""

from __future__ import annotations

import numpy as np

from ..runtime.bits import lowest_bit
from ..runtime.jit import inner_loop, kernel
from ..runtime.parallel import share_out, taken
from ..runtime.prefetch import fetch_ahead
from ..view.depth_rules import BEGINS, BETWEEN, OWN
from ..view.footprints import voxel_at
from .band import NO_BITS, begin_band, live_voxels, slice_ahead, write_rows
from .cut_slab import cut_ends
from .half_depth import half_way
from .limited_blocks import NO_MORE, NONE_ENDED, SOME, bound_blocks, is_outside, is_shortened, reached_blocks
from .mist_block import fade_added, keep_colors
from .pixel_block import BLOCK, CLEAR
from .ray_ends import NO_ROW, block_at, end_in_box, inside_box
from .ray_sums import add_depths, gather_values, sheet_depth, thin_slab
from .scalar_block import (
    classify_spans,
    classify_values,
    composite_classified,
    look_between,
    look_up,
    place_inside,
    resample_plane,
)
from .scalar_group import GROUP
from .scalar_scanline import NOT_KEPT, put_scanline
from .scratch import BAND, SPREAD
from .sheet_row import note_half_depth
from .voxel_scanline import ALL_BITS, ONE_BIT, WORD
from .waiting_blocks import composite_waiting, look_up_waiting, marked_by_both

NO_SHARE = np.float32(0.0)  # of the second of two scanlines


@inner_loop(forceinline=True)
def _resample_scanlines(
    pointers, data_starts, runs, scalars, lights, light_unit, width, number, first_slice, slice_weights, overhang,
    shift_u, scale_u, shift_v, scale_v, begin, far, box_rows, top_row, rows, line, stride, planes, sheet, marks,
    first_slot, member, row_slot, row_line, row_place, reach, live, wanted, cells, fractions, placed, matt, carried,
    ahead,
):
    """The scanlines of one sheet that a band reads, resampled along the scanline, each in a slot.

    ``number``: of the sheet, which lies between slice ``first_slice`` and the next.  ``first_slot``: from which on
    ``marks`` and ``sheet`` are the sheet's own; ``member``, from which ``row_slot``, ``row_line``, ``row_place`` are.
    ``wanted``: (words,) a bit for
    each block of pixels that counts.  ``begin``, ``far``: between which the sheet is of use.  ``box_rows`` (2, H):
    where each row's rays enter and leave the box.  ``ahead``: of ``band.slice_ahead``.  The others: see
    ``sheet_buffer._splat_sheet``.
    Returns whether anything was found, and whether every pixel of the band is already opaque.
    """
    n_scanlines = pointers.shape[1]
    blocks = placed.size
    near = first_slice
    weight, far_weight = slice_weights[number, 0], slice_weights[number, 1]
    if weight == 0.0:
        near, weight, far_weight = first_slice + 1, far_weight, np.float32(0.0)
    row_slot[member : member + BAND] = NO_ROW
    found = False
    live_count = -1
    slot, tapped = first_slot - 1, -1  # of the scanline dealt with last, and its number
    for r in range(rows):
        v = top_row + r
        if begin >= box_rows[1, v] or far <= box_rows[0, v]:
            continue
        y = min(max(voxel_at(v, shift_v, scale_v), 0.0), n_scanlines - 1.0)
        first_line = max(min(int(y), n_scanlines - 2), 0)
        if first_line > tapped:
            tapped = first_line - 1
        row_slot[member + r] = slot + first_line - tapped
        # Kept, not reckoned again: rounded otherwise, it might fall on the other side of a voxel.
        row_line[member + r], row_place[member + r] = first_line, y
        for scanline in range(tapped + 1, first_line + 2):
            tapped = scanline
            slot += 1
            for word in range(marks.shape[1]):
                marks[slot, word] = NO_BITS
            if scanline >= n_scanlines:
                continue
            run = int(pointers[near, scanline])
            if run < 0:  # the paper's flag: nothing on this scanline
                continue
            far_run, far_voxel = 0, 0
            if far_weight != np.float32(0.0):
                far_run = int(pointers[near + 1, scanline])
                if far_run < 0:
                    continue
                far_voxel = data_starts[near + 1, scanline]
            if live_count < 0:
                live_count = live_voxels(wanted, blocks, live, shift_u, scale_u, 1.0 + overhang)
                if live_count == 0:
                    return False, True
            reach[0], reach[1] = width, 0
            so_far = reach[3]
            put_scanline(
                line, stride, reach, marks, slot, scale_u, shift_u, overhang, runs, scalars, lights, light_unit, weight,
                run, data_starts[near, scanline], far_weight, far_run, far_voxel, width, live, live_count,
                matt, carried,
            )
            if reach[1] == 0:
                continue
            found = True
            if ahead >= 0:
                read = reach[3] - so_far
                later = data_starts[ahead, scanline]
                fetch_ahead(scalars, later, read)
                if lights is not None:
                    fetch_ahead(lights, later * lights.shape[1], read * lights.shape[1])
            for word in range(wanted.size):
                bits = marks[slot, word] & wanted[word]
                marks[slot, word] = bits
                while bits != NO_BITS:
                    b = word * WORD + lowest_bit(bits)
                    bits &= bits - ONE_BIT
                    if placed[b] != number:  # the same for all scanlines of the sheet
                        placed[b] = number
                        place_inside(cells, fractions, BLOCK * b, b * BLOCK - shift_u, scale_u, width - 1.0)
                    at = planes * BLOCK * (slot * blocks + b)
                    for plane in range(planes):
                        resample_plane(line, plane * stride, cells, fractions, BLOCK * b, sheet, at + BLOCK * plane)
            line[reach[0] : reach[1]] = NOT_KEPT
    return found, False


@inner_loop(forceinline=True)
def _composite_sheets(
    first, together, kinds, begins, ends, thicknesses, first_slice, slice_weights, top_row, rows, image_width,
    box_columns, box_rows, box_blocks, limits, look, sign, absorbs, mist, least_light, sheet, planes, matt, gloss,
    thinning, marks, row_slot, row_line, row_place, sheet_before, marks_before, slot_before, line_before, place_before,
    state, lengths, alive, bright, blocks, entries, spans, shares, looks, length_inside, bounds, before, colors,
    grouped, queue, places, starts, downs, depths, half,
):
    """Sheets number ``first`` to ``first + together`` - 1, of which there is one, or a group, over the rows of a band:
    scanlines mixed, classified, composited; whether a block became opaque.

    ``kinds``, ``begins``, ``ends``, ``thicknesses``, ``first_slice``, ``slice_weights``: of all sheets
    (``arguments.SheetList``).  ``box_blocks`` (4, blocks): of each block's columns the first and the last entry into
    the box, and the first and the last exit.  ``look``, ``sign``, ``absorbs``: as ``splat_scalar_rows`` has them.
    ``row_slot``, ``row_line``, ``row_place``: BAND of each sheet.  ``sheet_before`` and what follows it: the sheet
    before.  ``grouped``: None where there never is a group.  ``queue`` to ``depths``: see ``waiting_blocks``.  The
    others: see ``sheet_buffer``.
    """
    table, sums, origin, rate, least, low, high, nearest, furthest, last = look
    absent = sheet.size - planes * BLOCK  # a block without samples
    kind, begin, end, thickness = kinds[first], begins[first], ends[first], np.float32(thicknesses[first])
    front = begin
    behind = end if grouped is None else ends[first + together - 1]
    if grouped is not None:
        for number in range(together):
            depths[number] = thicknesses[first + number]
    died = False
    for r in range(rows):
        v = top_row + r
        enter, leave = box_rows[0, v], box_rows[1, v]
        if behind <= enter or front >= leave:
            continue
        down = np.float32(row_place[r] - row_line[r]) if row_slot[r] != NO_ROW else np.float32(0.0)
        earlier = slot_before[r] if kind == BETWEEN else NO_ROW
        down_before = np.float32(place_before[r] - line_before[r]) if earlier != NO_ROW else np.float32(0.0)
        if grouped is not None:
            for number in range(together):
                at = BAND * number + r
                downs[number] = row_place[at] - row_line[at] if row_slot[at] != NO_ROW else 0.0
        for word in range(alive.shape[1]):
            slot, bits, waiting = row_slot[r], NO_BITS, 0
            if slot != NO_ROW:
                bits = marks[slot, word] & marks[slot + 1, word]
            if earlier != NO_ROW:
                bits |= marks_before[earlier, word] & marks_before[earlier + 1, word]
            if grouped is not None:
                for number in range(1, together):
                    bits |= marked_by_both(marks, row_slot[BAND * number + r], word)
            bits &= alive[r, word]
            while bits != NO_BITS:
                lowest = lowest_bit(bits)
                b = word * WORD + lowest
                bit = ONE_BIT << np.uint64(lowest)
                bits ^= bit
                if behind <= box_blocks[0, b] or front >= box_blocks[3, b]:
                    continue
                at = r * blocks + b
                first_pixel = b * BLOCK
                count = min(BLOCK, image_width - first_pixel)
                row = 4 * BLOCK * at
                if grouped is not None:
                    inside = front >= max(box_blocks[1, b], enter) and behind <= min(box_blocks[2, b], leave)
                    if together == GROUP and inside:
                        waiting = look_up_waiting(
                            waiting, r, word, b, sheet, planes, blocks, absent, marks, row_slot, queue, places, downs,
                            low, high, origin, rate, last, starts,
                        )
                        continue
                for number in range(together):
                    if grouped is not None:
                        begin, end, thickness = begins[first + number], ends[first + number], depths[number]
                        slot, down = row_slot[BAND * number + r], downs[number]
                        if end <= enter or begin >= leave or end <= box_blocks[0, b] or begin >= box_blocks[3, b]:
                            continue
                        if marked_by_both(marks, slot, word) & bit == NO_BITS:
                            continue
                    shortened = False
                    if limits is not None:
                        if is_outside(bounds, r, b, begin, end):
                            continue
                        shortened = is_shortened(bounds, r, b, begin, end)
                    upper = lower = upper_before = lower_before = absent
                    if slot != NO_ROW:
                        upper = block_at(marks, slot, b, planes, blocks, absent)
                        lower = block_at(marks, slot + 1, b, planes, blocks, absent)
                    seen = 0
                    if sign is not None:
                        pass  # values are not looked up
                    elif kind == OWN:
                        seen = look_up(sheet, upper, lower, down, low, high, origin, rate, last, entries, shares)
                        if seen == 0:
                            continue
                    else:
                        if earlier != NO_ROW:
                            upper_before = block_at(marks_before, earlier, b, planes, blocks, absent)
                            lower_before = block_at(marks_before, earlier + 1, b, planes, blocks, absent)
                        ended = False
                        if limits is not None:
                            ended = shortened and cut_ends(
                                limits, v, first_pixel, count, begin, end, sheet, upper, lower, down, sheet_before,
                                upper_before, lower_before, down_before, least, looks,
                            )
                        if ended:
                            seen = look_between(
                                looks, BLOCK, BLOCK, NO_SHARE, looks, 0, 0, NO_SHARE, least, low, high, nearest,
                                furthest, origin, rate, last, entries, spans, shares,
                            )
                        else:
                            seen = look_between(
                                sheet, upper, lower, down, sheet_before, upper_before, lower_before, down_before,
                                least, low, high, nearest, furthest, origin, rate, last, entries, spans, shares,
                            )
                        if seen == 0:
                            continue
                    length, deep = lengths, BLOCK * at
                    whole = begin >= max(box_blocks[1, b], enter) and end <= min(box_blocks[2, b], leave)
                    cut = shortened or not whole
                    if cut:
                        inside_box(
                            box_columns, box_rows, limits, v, first_pixel, count, begin, end, lengths, deep,
                            length_inside,
                        )
                        length, deep = length_inside, 0
                    if sign is not None:
                        position = first_slice[first] + slice_weights[first, 1]
                        gather_values(
                            sheet, upper, lower, down, sign, origin, least, length, deep, thickness, state, row,
                            sheet_depth(position, begin, end), cut, box_columns, box_rows, limits, v, first_pixel,
                            count, looks, half,
                        )
                        continue
                    if len(thinning) > 0:
                        thin_slab(
                            sheet, upper, lower, down, sheet_before, upper_before, lower_before, down_before,
                            (planes - 1) * BLOCK, shares, length, deep, length_inside,
                        )
                        length, deep = length_inside, 0
                    if absorbs is not None:
                        add_depths(
                            table, sums, entries, spans, shares, seen, length, deep, thickness, state, row, begin, end,
                            cut, box_columns, box_rows, limits, v, first_pixel, count, before, half,
                        )
                        continue
                    if seen & 255 > seen >> 8:
                        classify_values(table, entries, looks)
                    else:
                        looks[:] = np.float32(0.0)
                    if seen >> 8 > 0:
                        classify_spans(sums, spans, shares, looks)
                    if mist is not None:
                        keep_colors(state, row, colors)
                    pixels = composite_classified(
                        looks, shares, sheet, upper, lower, down, sheet_before, upper_before, lower_before, down_before,
                        matt, gloss, length, deep, thickness, least_light, state, row, before,
                    )
                    if mist is not None:
                        fade_added(mist, state, row, colors, before, 0.5 * (begin + end), v, first_pixel, count)
                    bright_pixels = pixels >> 8
                    if bright_pixels != bright[r, b]:
                        bright[r, b] = bright_pixels
                        if not cut:
                            note_half_depth(
                                before, state, row + CLEAR, begin, end, half, v, first_pixel, count, looks
                            )
                        else:
                            halved = half_way(before, state, row + CLEAR, looks) & (ALL_BITS >> np.uint64(WORD - count))
                            while halved != NO_BITS:
                                i = lowest_bit(halved)
                                halved &= halved - ONE_BIT
                                from_, to = end_in_box(box_columns, box_rows, limits, v, first_pixel, i)
                                from_, to = max(begin, from_), min(end, to)
                                half[v, first_pixel + i] = from_ + looks[i] * (to - from_)
                    live_pixels = pixels & 255
                    if limits is not None:  # a ray that has reached its end is done as well
                        if bounds[r, NONE_ENDED, b] <= end:
                            live_pixels = 0
                            for i in range(count):
                                left = state[row + CLEAR + i] >= least_light
                                live_pixels += left and limits[1, v, first_pixel + i] > end
                    if live_pixels == 0:
                        alive[r, word] ^= bit
                        died = True
                        break
            if grouped is not None:
                died |= composite_waiting(
                    waiting, r, word, v, first, begins, ends, image_width, table, starts, sheet, places, queue, downs,
                    depths, matt, gloss, lengths, least_light, state, alive, bright, blocks, before, looks, half,
                )
    return died


@inner_loop
def _splat_band(
    tables, sheets, rays, box, look, sign, absorbs, matt, gloss, thinning, mist, grouped, least, top_row, rows, worker,
    scratch, out, half, filled,
):
    """``rows`` rows of the intermediate image from ``top_row`` on, through all sheets; see ``splat_scalar_rows``."""
    # Unpacked once: every look-up in a tuple of arrays counts references, too dear for the loops below.
    pointers, data_starts, runs, scalars, lights, light_unit, width = tables
    first_slice, slice_weights, thickness, begin, end, scale, offset, far, kind = sheets
    along, along_slope, across, across_slope, seen, limits = rays
    box_columns, box_rows, box_blocks, overhang = box
    mine = worker * SPREAD
    line, here, marks = scratch.line[mine], scratch.sheet[mine], scratch.marks[mine]
    row_slot, row_line, row_place = scratch.row_slot[mine], scratch.row_line[mine], scratch.row_place[mine]
    there, marks_before = scratch.sheet_before[mine], scratch.marks_before[mine]
    slot_before, line_before = scratch.slot_before[mine], scratch.line_before[mine]
    place_before = scratch.place_before[mine]
    reach, live = scratch.reach[mine], scratch.live[mine]
    state, length = scratch.state[mine], scratch.length[mine]
    alive, bright, placed = scratch.alive[mine], scratch.bright[mine], scratch.placed[mine]
    cells, fractions, entries = scratch.cells[mine], scratch.weights[mine], scratch.entries[mine]
    spans, shares, looks = scratch.spans[mine], scratch.shares[mine], scratch.samples[mine]
    length_inside, before, colors = scratch.length_inside[mine], scratch.before[mine], scratch.colors[mine]
    bounds, reached = scratch.bounds[mine], scratch.reached[mine]
    queue, places, starts = scratch.queue[mine], scratch.places[mine], scratch.starts[mine]
    downs, depths = scratch.downs[mine], scratch.depths[mine]
    n_scanlines = pointers.shape[1]
    image_width = along.size
    blocks = placed.size
    planes = 1 + len(matt) + len(gloss) + len(thinning)
    stride = line.size // planes
    band_alive = alive[BAND]
    limited = bounds.size > 0
    wanted = reached if limited else band_alive
    line[:stride] = NOT_KEPT
    line[stride:] = np.float32(0.0)
    for sheet in (here, there):
        absent = sheet.size - planes * BLOCK
        sheet[absent:] = np.float32(0.0)
        sheet[absent : absent + BLOCK] = NOT_KEPT
    begin_band(
        state, length, alive, bright, placed, half, top_row, rows, along, along_slope, across, across_slope, seen
    )
    bound_blocks(limits, top_row, rows, bounds)
    each = marks.shape[0]  # slots of a sheet
    if grouped is not None:
        each //= GROUP
    found_before = False
    sheet = 0
    while sheet < first_slice.size:
        together = 1
        if grouped is not None:
            if sheet + GROUP <= first_slice.size and kind[sheet + GROUP - 1] == OWN:
                together = GROUP
        first, sheet = sheet, sheet + together
        if kind[first] != OWN:  # what was here is the sheet before
            here, there = there, here
            marks, marks_before = marks_before, marks
            row_slot, slot_before = slot_before, row_slot
            row_line, line_before = line_before, row_line
            row_place, place_before = place_before, row_place
        found = opaque = False
        some = SOME
        if limited:
            some = reached_blocks(bounds, begin[first], far[first], band_alive, reached)
            if some == NO_MORE:
                break
        for number in range(first, sheet):
            member = number - first
            shift, step = offset[number, 1], scale[number, 1]
            first_y, last_y = (top_row - shift) / step, (top_row + rows - 1 - shift) / step
            if some == SOME and last_y > -overhang and first_y < n_scanlines - 1 + overhang:
                any_found, opaque = _resample_scanlines(
                    pointers, data_starts, runs, scalars, lights, light_unit, width, number, first_slice[number],
                    slice_weights, overhang, offset[number, 0], scale[number, 0], shift, step, begin[number],
                    far[number], box_rows, top_row, rows, line, stride, planes, here, marks, each * member,
                    BAND * member, row_slot, row_line, row_place, reach, live, wanted, cells, fractions, placed, matt,
                    gloss + thinning, slice_ahead(first_slice, slice_weights, number, pointers.shape[0]),
                )
                found |= any_found
            else:
                row_slot[BAND * member : BAND * member + BAND] = NO_ROW
        if opaque:
            break  # early termination
        before_counts = kind[first] == BETWEEN and found_before
        found_before = found
        if kind[first] == BEGINS or not (found or before_counts):
            continue
        died = _composite_sheets(
            first, together, kind, begin, end, thickness, first_slice, slice_weights, top_row, rows, image_width,
            box_columns, box_rows, box_blocks, limits, look, sign, absorbs, mist, least, here, planes, matt, gloss,
            thinning, marks, row_slot, row_line, row_place, there, marks_before, slot_before, line_before, place_before,
            state, length, alive, bright, blocks, entries, spans, shares, looks, length_inside, bounds, before, colors,
            grouped, queue, places, starts, downs, depths, half,
        )
        if died:
            band_alive[:] = NO_BITS
            for r in range(rows):
                for word in range(band_alive.size):
                    band_alive[word] |= alive[r, word]
    write_rows(state, top_row, rows, image_width, out, filled)


@inner_loop
def _splat_bands(
    first_worker, last_worker, tables, sheets, rays, box, look, sign, absorbs, matt, gloss, thinning, mist, grouped,
    least, first_row, last_row, next_band, scratch, out, half, filled,
):
    """What a worker does: bands, one after another, as long as there are any; see ``splat_scalar_rows``."""
    bands = (last_row - first_row + BAND - 1) // BAND
    for worker in range(first_worker, last_worker):
        band = taken(next_band)
        while band < bands:
            top_row = first_row + band * BAND
            _splat_band(
                tables, sheets, rays, box, look, sign, absorbs, matt, gloss, thinning, mist, grouped, least, top_row,
                min(BAND, last_row - top_row), worker, scratch, out, half, filled,
            )
            band = taken(next_band)


@kernel
def splat_scalar_rows(
    tables, sheets, rays, box, look, sign, absorbs, matt, gloss, thinning, mist, grouped, least, first_row, last_row,
    workers, next_band, scratch, out, half, filled,
):
    """Rows [first_row, last_row) of the intermediate image, post-classified; or what ``ray_sums`` makes of the rays.

    ``tables``, ``sheets``, ``rays``, ``box``: see ``arguments``.  ``look``: the value table, flat, and its sums; its
    origin and rate; what is below the least is no sample; low, high, nearest, furthest
    and the last entry.  ``sign``: None, or, float32, which value of a ray is wanted: 1 the largest, -1 the smallest, 0
    the mean; of ``look`` only origin and least count then.  ``absorbs``: None, or anything where the sum of optical
    depths is wanted; the table has one channel then.  (What is None is left out of the compiled kernel.)
    ``thinning``: the plane of a factor of extinction, the last, in a tuple, or ().  ``mist``: None, or its MistRays.
    ``grouped``: None, or True where sheets are handled in groups (``scalar_group``), which needs all of these to be
    None or (), no limits, and sheets with slabs of their own.
    ``matt``, ``gloss``: see ``scalar_block.composite_classified``.  The others, and what is written: see
    ``sheet_buffer.splat_rows``.
    """
    share_out(
        _splat_bands, workers,
        (
            tables, sheets, rays, box, look, sign, absorbs, matt, gloss, thinning, mist, grouped, least, first_row,
            last_row, next_band, scratch, out, half, filled,
        ),
    )

