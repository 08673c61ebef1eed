"""The sheet-buffer loop: voxel scanlines and sheet scanlines walked together (section 2.3 of the paper).

The sheet buffer has shrunk to a band of a few scanlines per thread.  Because slices land on the base plane scaled
and moved but never rotated, a row of the intermediate image depends on a few neighbouring voxel scanlines per slice
only; so each band takes all its sheets front to back before the next band begins (algorithm.md 1.5 and 1.8).
Bands are independent: no races, and the same bits for any number of threads.

For each sheet, the voxel scanlines that a band needs are walked run by run and resampled along the scanline, once
for all rows that share them; then each row mixes its two (or more) scanlines and is composited.  Which blocks of
pixels that concerns is known from the runs, as bits: nothing else is looked at.
"""

from __future__ import annotations

import numpy as np

from ..runtime.bits import lowest_bit
from ..runtime.jit import inner_loop, kernel
from ..runtime.lanes import GROUP, clear_group
from ..runtime.parallel import share_out, taken
from ..runtime.prefetch import fetch_ahead
from ..view.footprints import TENT, first_tap, tap_count, tap_weight, voxel_at
from .band import NO_BITS, begin_band, live_voxels, slice_ahead, write_rows
from .limited_blocks import NO_MORE, NONE, NONE_ENDED, bound_blocks, is_outside, is_shortened, reached_blocks
from .mist_block import fade_added, keep_colors
from .pixel_block import (
    BLOCK,
    CLEAR,
    composite_added,
    composite_extinction,
    is_voxel_by_voxel,
    place_tent,
    resample_tent,
    resample_voxel_by_voxel,
)
from .scratch import BAND, SPREAD
from .sheet_row import (
    composite_opacity,
    mix_blocks,
    note_half_depth,
    note_half_depth_inside,
    place_wide_taps,
    resample_wide,
)
from .voxel_scanline import ONE_BIT, WORD, add_runs

NO_SCANLINE = -(2**62)  # below the number of any


@inner_loop
def _stretch(widen, scale):
    """How much wider than a voxel a footprint is made at ``scale`` sheet pixels per voxel."""
    return max(1.0, 1.0 / scale) if widen else 1.0


@inner_loop(forceinline=True)
def _splat_sheet(
    pointers, data_starts, runs, voxels, decoding, width, number, first_slice, slice_weights, wide, margin, shift_u,
    scale_u, shift_v, scale_v, top_row, rows, line, sheet, marks, row_slot, row_line, row_place, reach, live,
    wanted, cells, weights, placed, samples, ahead,
):
    """The scanlines of one sheet that a band is splatted from, resampled along the scanline, each in a slot.

    ``number``: of the sheet.  ``slice_weights[number]``: (taps,) of slice ``first_slice`` and the next.  ``shift_u``,
    ``scale_u``, ``shift_v``, ``scale_v``: sheet pixel = scale * voxel + shift, along and across scanlines.
    ``margin``: voxels of zeros before a scanline's first.  ``wanted``: (words,) a bit for each block of pixels that
    counts.  ``ahead``: of ``band.slice_ahead``.  Other arrays: see ``Tables`` and ``Scratch``.
    Returns whether anything was found, and whether every pixel of the band is already opaque.
    """
    n_slices, n_scanlines = pointers.shape
    blocks = placed.size
    kind, stretch_u, radius_u, radius_v = TENT, 1.0, 1.0, 1.0
    if wide is not None:
        kind, radius, widen = wide
        stretch_u = _stretch(widen, scale_u)
        radius_u, radius_v = radius * stretch_u, radius * _stretch(widen, scale_v)
    taps_u, taps_v = tap_count(radius_u), tap_count(radius_v)
    # Pixels beside the volume are drawn up to it, but not so near that a footprint with an edge would reach.
    low, top = -radius_u - 0.5, width - 0.5 + radius_u
    found = False
    live_count = -1
    slot, tapped = -1, NO_SCANLINE  # of the scanline dealt with last, and its number
    for r in range(rows):
        y = voxel_at(top_row + r, shift_v, scale_v)
        first_line = first_tap(kind, y, radius_v)
        if first_line > tapped:
            tapped = first_line - 1
        row_slot[r] = slot + first_line - tapped
        # Kept, not reckoned again: rounded otherwise, it might fall on the other side of a voxel.
        row_line[r], row_place[r] = first_line, y
        for scanline in range(tapped + 1, first_line + taps_v):
            tapped = scanline
            slot += 1
            for word in range(marks.shape[1]):
                marks[slot, word] = NO_BITS
            if scanline < 0 or scanline >= n_scanlines:
                continue
            reach[0] = width + margin
            reach[1] = 0
            before = reach[3]
            for deeper in range(slice_weights.shape[1]):
                k = first_slice + deeper
                weight = slice_weights[number, deeper]
                if weight == 0.0 or k < 0 or k >= n_slices:
                    continue
                run = pointers[k, scanline]
                if run < 0:  # the paper's flag: nothing on this scanline
                    continue
                if live_count < 0:
                    live_count = live_voxels(wanted, blocks, live, shift_u, scale_u, radius_u)
                    if live_count == 0:
                        return False, True
                add_runs(
                    line, reach, margin, marks, slot, scale_u, shift_u, radius_u, weight, runs, int(run), voxels,
                    decoding, data_starts[k, scanline], width, live, live_count,
                )
            if reach[1] == 0:
                continue
            found = True
            if ahead >= 0:
                words = 4 if decoding is None else 3 if voxels.itemsize == 2 else 1  # of a record, see Tables
                fetch_ahead(voxels, words * data_starts[ahead, scanline], words * (reach[3] - before))
            for word in range(wanted.size):
                bits = marks[slot, word] & wanted[word]
                marks[slot, word] = bits
                while bits != NO_BITS:
                    b = word * WORD + lowest_bit(bits)
                    bits &= bits - ONE_BIT
                    at = 4 * BLOCK * (slot * blocks + b)
                    if placed[b] != number:  # the taps are the same for all scanlines of the sheet
                        placed[b] = number
                        if wide is None:
                            place_tent(cells, weights, BLOCK * b, b * BLOCK - shift_u, scale_u, top + margin)
                        else:
                            place_wide_taps(
                                cells[BLOCK * b : BLOCK * (b + 1)], weights[BLOCK * taps_u * b :], taps_u, kind,
                                stretch_u, radius_u, b * BLOCK, shift_u, scale_u, margin, low, top,
                            )
                    if wide is None:
                        if is_voxel_by_voxel(cells, BLOCK * b):
                            resample_voxel_by_voxel(line, cells, weights, BLOCK * b, sheet, at)
                        else:
                            resample_tent(line, cells, weights, BLOCK * b, sheet, at)
                    else:
                        resample_wide(
                            line, cells[BLOCK * b : BLOCK * (b + 1)], weights[BLOCK * taps_u * b :], taps_u, samples,
                            sheet, at,
                        )
            for i in range(reach[0], reach[1], GROUP):  # a slice's clearing would be a call, with all registers saved
                clear_group(line, 4 * i)
    return found, False


@inner_loop
def _add_scanlines(kind, y, first, taps, stretch, slot, b, blocks, sheet, marks, to):
    """sheet[to:] = block ``b`` of the ``taps`` scanlines from ``slot`` on, by a footprint of any height around ``y``;
    ``first``: number of the first."""
    mixed = sheet[to : to + 4 * BLOCK]
    mixed[:] = np.float32(0.0)
    total = 0.0
    for tap in range(taps):
        total += tap_weight(kind, y, first + tap, stretch)
    for tap in range(taps):
        if (marks[slot + tap, b // WORD] >> np.uint64(b % WORD)) & ONE_BIT == NO_BITS:
            continue
        weight = np.float32(tap_weight(kind, y, first + tap, stretch) / total)
        at = 4 * BLOCK * ((slot + tap) * blocks + b)
        block = sheet[at : at + 4 * BLOCK]
        for i in range(4 * BLOCK):
            mixed[i] += weight * block[i]


@inner_loop(forceinline=True)
def _inside_limits(limits, v, first_pixel, count, begin, end, lengths, deep, length_inside):
    """Shorten the rays of one block to the part of a slab within their limits (see ``arguments.Rays``)."""
    for i in range(count):
        u = first_pixel + i
        outside = max(limits[0, v, u] - begin, 0.0) + max(end - limits[1, v, u], 0.0)
        for hole in range(2, limits.shape[0], 2):
            outside += max(min(end, limits[hole + 1, v, u]) - max(begin, limits[hole, v, u]), 0.0)
        length_inside[i] = lengths[deep + i] * np.float32(min(max(1.0 - outside / (end - begin), 0.0), 1.0))


@inner_loop(forceinline=True)
def _composite_sheet(
    scale_v, begin, end, thickness, wide, top_row, rows, image_width, limits, least, additive_opacity, sheet, marks,
    row_slot, row_line, row_place, state, lengths, alive, bright, blocks, length_inside, bounds, before, colors, mist,
    samples, half,
):
    """One sheet over the rows of a band: its scanlines mixed, the row composited; whether a block became opaque.

    ``scale_v``: sheet rows per scanline; ``begin``, ``end``: the slab.  Arrays: see
    ``Scratch`` and ``splat_rows``.  (Separate arrays, not tuples of them, and one call a sheet: numba counts
    references at every hand-over.)
    """
    transparent = sheet.size - 8 * BLOCK  # a block that nothing is ever written to
    mixed = sheet.size - 4 * BLOCK
    kind, stretch_v, radius_v, taps = TENT, 1.0, 1.0, 2
    if wide is not None:
        kind, radius, widen = wide
        stretch_v = _stretch(widen, scale_v)
        radius_v = radius * stretch_v
        taps = tap_count(radius_v)
    died = False
    for r in range(rows):
        v = top_row + r
        slot = row_slot[r]
        down = np.float32(row_place[r] - row_line[r])
        for word in range(alive.shape[1]):
            bits = NO_BITS
            for tap in range(taps):
                bits |= marks[slot + tap, word]
            bits &= alive[r, word]
            while bits != NO_BITS:
                lowest = lowest_bit(bits)
                b = word * WORD + lowest
                bit = ONE_BIT << np.uint64(lowest)
                bits ^= bit
                shortened = False
                if limits is not None:
                    if is_outside(bounds, r, b, begin, end):
                        continue
                    shortened = is_shortened(bounds, r, b, begin, end)
                upper = lower = mixed
                if wide is None:
                    upper = 4 * BLOCK * (slot * blocks + b) if marks[slot, word] & bit != NO_BITS else transparent
                    lower = transparent
                    if marks[slot + 1, word] & bit != NO_BITS:
                        lower = 4 * BLOCK * ((slot + 1) * blocks + b)
                else:
                    _add_scanlines(
                        kind, row_place[r], row_line[r], taps, stretch_v, slot, b, blocks, sheet, marks, mixed
                    )
                at = r * blocks + b
                first_pixel = b * BLOCK
                count = min(BLOCK, image_width - first_pixel)
                length, deep = lengths, BLOCK * at
                if limits is not None:
                    if shortened:
                        _inside_limits(limits, v, first_pixel, count, begin, end, lengths, deep, length_inside)
                        length, deep = length_inside, 0
                row = 4 * BLOCK * at
                if mist is not None:
                    keep_colors(state, row, colors)
                if additive_opacity is None:
                    pixels = composite_extinction(
                        sheet, upper, lower, down, length, deep, thickness, least, state, row, before
                    )
                elif additive_opacity:
                    pixels = composite_added(
                        sheet, upper, lower, down, length, deep, thickness, least, state, row, before
                    )
                else:
                    if wide is None:
                        mix_blocks(sheet, upper, lower, down, mixed)
                    pixels = composite_opacity(sheet, mixed, length, deep, thickness, least, state, row, before)
                if mist is not None:
                    fade_added(mist, state, row, colors, before, 0.5 * (begin + end), v, first_pixel, count)
                bright_pixels = pixels >> 8
                if bright_pixels != bright[r, b]:
                    bright[r, b] = bright_pixels
                    if limits is None:
                        note_half_depth(before, state, row + CLEAR, begin, end, half, v, first_pixel, count, samples)
                    else:
                        note_half_depth_inside(
                            limits, before, state, row + CLEAR, begin, end, half, v, first_pixel, count, samples
                        )
                live_pixels = pixels & 255
                if limits is not None:  # a ray that has reached its end is done as well
                    if bounds[r, NONE_ENDED, b] <= end:
                        live_pixels = 0
                        for i in range(count):
                            live_pixels += state[row + CLEAR + i] >= least and limits[1, v, first_pixel + i] > end
                if live_pixels == 0:
                    alive[r, word] ^= bit
                    died = True
    return died


@inner_loop
def _splat_band(
    tables, sheets, rays, wide, least, additive_opacity, mist, top_row, rows, worker, scratch, out, half, filled
):
    """``rows`` rows of the intermediate image from ``top_row`` on, through all sheets; see ``splat_rows``."""
    # Unpacked once: every look-up in a tuple of arrays counts references, too dear for the loops below.
    pointers, data_starts, runs, voxels, decoding, width = tables
    first_slice, slice_weights, thickness, begin, end, scale, offset, _, _ = sheets
    along, along_slope, across, across_slope, seen, limits = rays
    radius, widen = 1.0, False
    if wide is not None:
        _, radius, widen = wide
    mine = worker * SPREAD
    line, sheet_buffer, marks = scratch.line[mine], scratch.sheet[mine], scratch.marks[mine]
    row_slot, row_line, row_place = scratch.row_slot[mine], scratch.row_line[mine], scratch.row_place[mine]
    reach, live = scratch.reach[mine], scratch.live[mine]
    state, length = scratch.state[mine], scratch.length[mine]
    alive, bright, placed = scratch.alive[mine], scratch.bright[mine], scratch.placed[mine]
    cells, weights, samples = scratch.cells[mine], scratch.weights[mine], scratch.samples[mine]
    length_inside, before, colors = scratch.length_inside[mine], scratch.before[mine], scratch.colors[mine]
    bounds, reached = scratch.bounds[mine], scratch.reached[mine]
    n_scanlines = pointers.shape[1]
    image_width = along.size
    blocks = placed.size
    margin = weights.size // cells.size if wide is not None else 1  # as many voxels as a footprint reaches
    band_alive = alive[BAND]
    line[:] = np.float32(0.0)
    sheet_buffer[sheet_buffer.size - 8 * BLOCK :] = np.float32(0.0)
    length_inside[:] = np.float32(0.0)
    limited = bounds.size > 0
    wanted = reached if limited else band_alive
    begin_band(
        state, length, alive, bright, placed, half, top_row, rows, along, along_slope, across, across_slope, seen
    )
    bound_blocks(limits, top_row, rows, bounds)
    for sheet in range(first_slice.size):
        shift, step = offset[sheet, 1], scale[sheet, 1]
        radius_v = radius * _stretch(widen, step)
        first_y, last_y = (top_row - shift) / step, (top_row + rows - 1 - shift) / step
        if last_y <= -radius_v or first_y >= n_scanlines - 1 + radius_v:
            continue
        if limited:
            some = reached_blocks(bounds, begin[sheet], end[sheet], band_alive, reached)
            if some == NO_MORE:
                break
            if some == NONE:
                continue
        found, opaque = _splat_sheet(
            pointers, data_starts, runs, voxels, decoding, width, sheet, first_slice[sheet], slice_weights,
            wide, margin, offset[sheet, 0], scale[sheet, 0], shift, step, top_row, rows, line, sheet_buffer, marks,
            row_slot, row_line, row_place, reach, live, wanted, cells, weights, placed, samples,
            slice_ahead(first_slice, slice_weights, sheet, pointers.shape[0]),
        )
        if opaque:
            break  # early termination
        if not found:
            continue
        died = _composite_sheet(
            step, begin[sheet], end[sheet], np.float32(thickness[sheet]), wide, top_row, rows, image_width, limits,
            least, additive_opacity, sheet_buffer, marks, row_slot, row_line, row_place, state, length, alive, bright,
            blocks, length_inside, bounds, before, colors, mist, samples, half,
        )
        if died:
            band_alive[:] = NO_BITS
            for r in range(rows):
                for word in range(band_alive.size):
                    band_alive[word] |= alive[r, word]
    write_rows(state, top_row, rows, image_width, out, filled)


@inner_loop
def _splat_bands(
    first_worker, last_worker, tables, sheets, rays, wide, least, additive_opacity, mist, first_row, last_row,
    next_band, scratch, out, half, filled,
):
    """What a worker does: bands, one after another, as long as there are any; see ``splat_rows``."""
    bands = (last_row - first_row + BAND - 1) // BAND
    for worker in range(first_worker, last_worker):
        band = taken(next_band)
        while band < bands:
            top_row = first_row + band * BAND
            _splat_band(
                tables, sheets, rays, wide, least, additive_opacity, mist, top_row, min(BAND, last_row - top_row),
                worker, scratch, out, half, filled,
            )
            band = taken(next_band)


@kernel
def splat_rows(
    tables, sheets, rays, wide, least, additive_opacity, mist, first_row, last_row, workers, next_band, scratch, out,
    half, filled,
):
    """Rows [first_row, last_row) of the intermediate image.

    ``tables``, ``sheets``, ``rays``, ``wide``: see ``arguments``.  ``least``: float32 transmittance at which a pixel
    is opaque.  ``additive_opacity``: for the paper's model in place of extinction, whether opacities are taken as they
    are added (True) or corrected for the length of the ray (False); else None.  What is None is not even compiled:
    numba makes a kernel of its own, when it is first needed, for each combination of footprint, model and limits.
    ``mist``: None, or its MistRays.
    ``next_band``: (1,) int64 zero; whichever worker is free takes the next band.
    Out: ``out`` (H, W, 4) float32 premultiplied colour and transmittance; ``half`` (H, W) float32 depth along the
    viewing direction at which the transmittance falls below one half, inf where it does not; ``filled`` (2, H) int32
    between which columns of a row there is anything.
    """
    share_out(
        _splat_bands, workers,
        (
            tables, sheets, rays, wide, least, additive_opacity, mist, first_row, last_row, next_band, scratch, out,
            half, filled,
        ),
    )
