"""The walk of the sheet-buffer algorithm: bands, sheets, scanlines, rows and blocks (section 2.3 of the paper).

The sheet buffer has shrunk to a band of a few rows per worker.  Slices land on the base plane scaled and moved but
never rotated, so a row of the intermediate image depends on a few neighboring voxel scanlines per slice only; each
band takes all its sheets front to back before the next band begins (algorithm.md 1.5 and 1.8).  Bands are independent:
no races, and bit-identical results for any number of threads.

For each sheet, the voxel scanlines that a band reads are walked run by run and resampled along the scanline, once for
all rows that share them; then each row interpolates between its scanlines and is composited.  Which blocks of pixels
that concerns is known from the runs, as bits: nothing else is touched.

What a sheet holds differs: classified voxels (``sheet_buffer``) or scalars (``scalar_sheets``).  The functions that
differ are given to the three factories below, each of which returns a compiled loop with its functions inlined.
The loops are parts of the kernels ``splat_rows`` and ``splat_scalar_rows``, which alone are stored on disk.

A frame takes 1.008 of the time of a loop that is written out for each kind of sheet (median, one thread).

A plugged-in function that decides by what is None is called with that very argument: numba leaves a branch out only
where an argument is None, not a member of a tuple.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..runtime.bits import lowest_bit
from ..runtime.jit import inner_loop
from ..runtime.parallel import taken
from ..view.depth_rules import BEGINS, BETWEEN, OWN
from .band import begin_band, live_voxels, slice_ahead, write_rows
from .interval_blocks import NO_MORE, SOME, bound_blocks, find_reached_blocks
from .rays_in_box import NO_ROW
from .scratch import BAND, SPREAD, BlockScratch, Rows, Scanlines, Scratch, VoxelLine, WaitingBlocks
from .voxel_scanline import NO_BITS, ONE_BIT, WORD

NO_SCANLINE = -(2**62)  # below the number of any


class Window(NamedTuple):
    """The part of the intermediate image that a band covers, in sheet pixels.

    Attributes
    ----------
    top_row : int
        First row.
    rows : int
        Number of rows, at most BAND.
    image_width : int
        Pixels of a row.
    """

    top_row: int
    rows: int
    image_width: int


@inner_loop
def _scanlines_of(all_workers, mine):
    """Row ``mine`` of each array of ``scratch.Scanlines``."""
    samples, marks, row_slot, row_line, row_position = all_workers
    return Scanlines(samples[mine], marks[mine], row_slot[mine], row_line[mine], row_position[mine])


@inner_loop
def _scratch_of(scratch, mine):
    """Row ``mine`` of each array of the Scratch: the one worker's own."""
    line, reach, live, cells, weights, placed = scratch.line
    state, length, alive, bright, bounds, reached, light = scratch.rows
    (
        samples, entries, spans, shares, length_inside, before, colors, classified, mixed, numbers, parts, looks,
        table_rows,
    ) = scratch.block  # fmt: skip
    queue, places, starts, downs, depths = scratch.waiting
    return Scratch(
        VoxelLine(line[mine], reach[mine], live[mine], cells[mine], weights[mine], placed[mine]),
        _scanlines_of(scratch.sheet, mine),
        _scanlines_of(scratch.sheet_before, mine),
        Rows(state[mine], length[mine], alive[mine], bright[mine], bounds[mine], reached[mine], light[mine]),
        BlockScratch(
            samples[mine], entries[mine], spans[mine], shares[mine], length_inside[mine], before[mine], colors[mine],
            classified[mine], mixed[mine], numbers[mine], parts[mine], looks[mine], table_rows[mine],
        ),
        WaitingBlocks(queue[mine], places[mine], starts[mine], downs[mine], depths[mine]),
    )  # fmt: skip


def scanline_walker(footprint_of, place_row, is_filled, put_voxels, fetch_next, resample_block, clear_line):
    """Make the loop that resamples the scanlines of one sheet that a band reads, each into a slot.

    Parameters
    ----------
    footprint_of : (medium, scale_u, scale_v) -> (reach_u, reach_v, taps, footprint)
        How far pixels of the sheet read along and across scanlines, in voxels; how many scanlines a row reads; and
        what the functions below need of it.
    place_row : (medium, footprint, sheets, number, v, shift_v, scale_v) -> (is_covered, y, first_line)
        Whether row ``v`` of the image reads the sheet, its position among scanlines and the first scanline it reads.
    is_filled : (medium, sheets, number, scanline) -> bool
        Whether a scanline has any runs in the slices of the sheet.  It is called until one has.
    put_voxels : (medium, footprint, sheets, number, scanline, slot, shift_u, scale_u, line, live_count, marks)
        Put the scanline's voxels, if it has any, on the line, and mark the blocks of pixels that they reach.
    fetch_next : (medium, ahead, scanline, count)
        Ask for the memory of the slice behind.
    resample_block : (medium, footprint, is_new, b, at, shift_u, scale_u, line, samples, block)
        Resample block ``b`` of the line to block number ``at`` of ``samples``; ``is_new``: whether its taps are not
        placed yet.
    clear_line : (medium, line)
        Make the line empty again.
    """

    @inner_loop(inline="always")
    def resample_line(medium, footprint, number, slot, shift_u, scale_u, line, sheet, block, wanted):
        """The blocks of one slot that are both marked and ``wanted``, from the voxels on the line."""
        blocks = line.placed.size
        for word in range(wanted.size):
            bits = sheet.marks[slot, word] & wanted[word]
            sheet.marks[slot, word] = bits
            while bits != NO_BITS:
                b = word * WORD + lowest_bit(bits)
                bits &= bits - ONE_BIT
                is_new = line.placed[b] != number  # the taps are the same for all scanlines of the sheet
                line.placed[b] = number
                resample_block(
                    medium, footprint, is_new, b, slot * blocks + b, shift_u, scale_u, line, sheet.samples, block
                )

    @inner_loop
    def resample_sheet(medium, sheets, number, member, window, line, sheet, block, wanted):
        """Sheet ``number``, which is number ``member`` of its group; ``wanted``: (words,) a bit for each block of
        pixels that counts.  Returns whether anything was found, and whether every pixel of the band is opaque."""
        n_slices, n_scanlines = medium.tables.pointers.shape
        top_row, rows, _ = window
        shift_u, scale_u = sheets.offset[number, 0], sheets.scale[number, 0]
        shift_v, scale_v = sheets.offset[number, 1], sheets.scale[number, 1]
        first_row = BAND * member
        reach_u, reach_v, taps, footprint = footprint_of(medium, scale_u, scale_v)
        first_y, last_y = (top_row - shift_v) / scale_v, (top_row + rows - 1 - shift_v) / scale_v
        if last_y <= -reach_v or first_y >= n_scanlines - 1 + reach_v:
            sheet.row_slot[first_row : first_row + BAND] = NO_ROW
            return False, False
        ahead = slice_ahead(sheets.first_slice, sheets.slice_weights, number, n_slices)
        found = False
        live_count = -1
        members = sheet.row_slot.size // BAND
        slot = sheet.marks.shape[0] // members * member - 1  # of the scanline dealt with last
        tapped = NO_SCANLINE  # its number
        for r in range(rows):
            is_covered, y, first_line = place_row(medium, footprint, sheets, number, top_row + r, shift_v, scale_v)
            if not is_covered:
                sheet.row_slot[first_row + r] = NO_ROW
                continue
            if first_line > tapped:
                tapped = first_line - 1
            sheet.row_slot[first_row + r] = slot + first_line - tapped
            # Stored, not computed again: rounded otherwise, it might fall on the other side of a voxel.
            sheet.row_line[first_row + r], sheet.row_position[first_row + r] = first_line, y
            for scanline in range(tapped + 1, first_line + taps):
                tapped = scanline
                slot += 1
                for word in range(sheet.marks.shape[1]):
                    sheet.marks[slot, word] = NO_BITS
                if scanline < 0 or scanline >= n_scanlines:
                    continue
                if live_count < 0:
                    if not is_filled(medium, sheets, number, scanline):
                        continue
                    live_count = live_voxels(wanted, line.placed.size, line.live, shift_u, scale_u, reach_u)
                    if live_count == 0:
                        return False, True
                before = line.reach[3]
                put_voxels(
                    medium, footprint, sheets, number, scanline, slot, shift_u, scale_u, line, live_count, sheet.marks
                )
                if line.reach[1] == 0:
                    continue
                found = True
                if ahead >= 0:
                    fetch_next(medium, ahead, scanline, line.reach[3] - before)
                resample_line(medium, footprint, number, slot, shift_u, scale_u, line, sheet, block, wanted)
                clear_line(medium, line)
        return found, False

    return resample_sheet


def row_walker(slab_of, row_of, marked, composite_block, composite_queue):
    """Make the loop that composites one sheet, or a group of sheets, over the rows of a band.

    Parameters
    ----------
    slab_of : (medium, sheets, first, together, waiting) -> slab
        What is the same for all rows.
    row_of : (medium, slab, v, r, here, there, waiting) -> (is_crossed, row)
        Whether the rays of a row cross the slab, and what is the same for all of its blocks.
    marked : (medium, slab, row, r, word, here, there) -> uint64
        The blocks of a word in which a row has samples, as bits.
    composite_block : (cut, medium, sheets, slab, row, window, r, b, queued, rays, here, there, own, image)
        Composite block ``b``; how many of its pixels are not opaque yet, and how many blocks wait in the queue.
        ``cut``: see ``composite_sheets``.
    composite_queue : (medium, sheets, slab, window, r, word, queued, here, own, image) -> bool
        Composite the blocks that wait; whether any became opaque.
    """

    @inner_loop
    def composite_sheets(cut, medium, sheets, first, together, window, rays, here, there, own, image):
        """Sheets number ``first`` to ``first + together - 1``; whether any block became opaque.

        ``cut``: None where rays are whole and there is no mist, else True.  Each has a loop of its own: in a common one
        a frame without them took a fifth longer (measured).
        """
        alive = own.rows.alive
        slab = slab_of(medium, sheets, first, together, own.waiting)
        died = False
        for r in range(window.rows):
            is_crossed, row = row_of(medium, slab, window.top_row + r, r, here, there, own.waiting)
            if not is_crossed:
                continue
            for word in range(alive.shape[1]):
                queued = 0
                bits = marked(medium, slab, row, r, word, here, there) & alive[r, word]
                while bits != NO_BITS:
                    lowest = lowest_bit(bits)
                    bit = ONE_BIT << np.uint64(lowest)
                    bits ^= bit
                    live, queued = composite_block(
                        cut, medium, sheets, slab, row, window, r, word * WORD + lowest, queued, rays, here, there, own,
                        image,
                    )  # fmt: skip
                    if live == 0:
                        alive[r, word] ^= bit
                        died = True
                died |= composite_queue(medium, sheets, slab, window, r, word, queued, here, own, image)
        return died

    return composite_sheets


def band_walker(clear_scratch, group_at, resample_sheet, composite_sheets, keeps_sheet_before):
    """Make the loop of a worker: bands, one after another, as long as there are any.

    Parameters
    ----------
    clear_scratch : (medium, own)
        Clear what the loops rely on to be empty.
    group_at : (medium, sheets, sheet) -> int
        How many sheets from number ``sheet`` on are handled together.
    resample_sheet : callable
        Made by ``scanline_walker``.
    composite_sheets : callable
        Made by ``row_walker``.
    keeps_sheet_before : bool
        Whether the slab between two sheets is composited from both.

    Returns
    -------
    splat_bands : callable
        A task for ``parallel.share_out``.
    """

    @inner_loop(inline="always")
    def resample_sheets(medium, sheets, first, together, window, here, own, wanted):
        """All sheets of a group; whether anything was found, and whether every pixel of the band is opaque."""
        found = opaque = False
        for member in range(together):
            found_here, opaque = resample_sheet(
                medium, sheets, first + member, member, window, own.line, here, own.block, wanted
            )
            found |= found_here
        return found, opaque

    @inner_loop(inline="always")
    def splat_band(medium, sheets, rays, top_row, rows, worker, scratch, image):
        """``rows`` rows of the intermediate image from ``top_row`` on, through all sheets."""
        own = _scratch_of(scratch, worker * SPREAD)
        pixels, half, filled = image
        along, along_slope, across, across_slope, seen, intervals = rays
        state, length, alive, bright, bounds, reached, _ = own.rows
        window = Window(top_row, rows, along.size)
        band_alive = alive[BAND]
        shortened = bounds.size > 0
        is_cut = shortened or medium.mist.place.size > 0
        wanted = reached if shortened else band_alive
        clear_scratch(medium, own)
        begin_band(
            state, length, alive, bright, own.line.placed, half, top_row, rows, along, along_slope, across,
            across_slope, seen,
        )  # fmt: skip
        bound_blocks(intervals, top_row, rows, bounds)
        here, there = own.sheet, own.sheet_before
        found_before = False
        sheet = np.int64(0)  # a literal would have the loops compiled twice
        while sheet < sheets.first_slice.size:
            together = group_at(medium, sheets, sheet)
            first, sheet = sheet, sheet + together
            kind = sheets.kind[first]
            if keeps_sheet_before:
                if kind != OWN:  # what was here is the sheet before
                    here, there = there, here
            some = SOME
            if shortened:
                some = find_reached_blocks(bounds, sheets.begin[first], sheets.far[first], band_alive, reached)
                if some == NO_MORE:
                    break
            found = opaque = False
            if some == SOME:
                found, opaque = resample_sheets(medium, sheets, first, together, window, here, own, wanted)
            else:
                here.row_slot[:] = NO_ROW
            if opaque:
                break  # early ray termination
            counts = found
            if keeps_sheet_before:
                counts = (found or (kind == BETWEEN and found_before)) and kind != BEGINS
                found_before = found
            if not counts:
                continue
            if is_cut:
                died = composite_sheets(True, medium, sheets, first, together, window, rays, here, there, own, image)
            else:
                died = composite_sheets(None, medium, sheets, first, together, window, rays, here, there, own, image)
            if died:
                band_alive[:] = NO_BITS
                for r in range(rows):
                    for word in range(band_alive.size):
                        band_alive[word] |= alive[r, word]
        write_rows(state, top_row, rows, along.size, pixels, filled)

    @inner_loop
    def splat_bands(
        first_worker, last_worker, medium, sheets, rays, first_row, last_row, next_band, scratch, image,
    ):  # fmt: skip
        """The bands of rows [first_row, last_row) that workers [first_worker, last_worker) take.

        ``next_band``: (1,) int64, number of the band that nobody has taken yet.  ``image``: pixels (H, W, 4), half
        depth (H, W) and filled columns (2, H), as ``sheet_buffer.splat_rows`` writes them.
        """
        bands = (last_row - first_row + BAND - 1) // BAND
        for worker in range(first_worker, last_worker):
            band = taken(next_band)
            while band < bands:
                top_row = first_row + band * BAND
                splat_band(medium, sheets, rays, top_row, min(BAND, last_row - top_row), worker, scratch, image)
                band = taken(next_band)

    return splat_bands
