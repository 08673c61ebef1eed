"""The sheet-buffer loop: voxel scanlines and sheet scanlines walked together (section 2.3 of the paper).

The sheet buffer has shrunk to a band of a few scanlines per thread.  Because slices land on the base plane scaled
and moved but never rotated, a row of the intermediate image depends on two neighbouring voxel scanlines per slice
only; so each band takes all its sheets front to back before the next band begins (algorithm.md 1.5 and 1.8).
Bands are independent: no races, and the same bits for any number of threads.
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import kernel, prange
from ..view.footprints import TENT, first_tap, footprint_weight, tap_count
from .scratch import BAND, SPREAD
from .sheet_row import (
    BLOCK,
    BLUE,
    CLEAR,
    GREEN,
    RED,
    composite_extinction,
    composite_opacity,
    gather_samples,
    gather_wide,
    note_half_depth,
    place_taps,
    place_wide_taps,
    tally,
)
from .voxel_scanline import VOXEL_BLOCK, add_runs, clear_touched


@kernel
def _stretch(widen, scale):
    """How much wider than a voxel a footprint is made at ``scale`` sheet pixels per voxel."""
    return max(1.0, 1.0 / scale) if widen else 1.0


@kernel
def _begin_band(state, lengths, alive, bright, placed, top_row, rows, length, corrected):
    """Clear the rows of a band: no colour, all light; pixels beyond the image are opaque from the start."""
    image_width = length.shape[1]
    blocks = placed.size
    for b in range(blocks):
        count = min(BLOCK, image_width - b * BLOCK)
        alive[BAND, b] = 1
        placed[b] = -1
        for r in range(rows):
            alive[r, b] = 1
            bright[r, b] = count
            at = r * blocks + b
            row = state[4 * BLOCK * at : 4 * BLOCK * (at + 1)]
            for i in range(BLOCK):
                row[RED + i] = row[GREEN + i] = row[BLUE + i] = 0.0
                row[CLEAR + i] = 1.0 if i < count else 0.0
                lengths[BLOCK * at + i] = 0.0
            for i in range(count):
                lengths[BLOCK * at + i] = length[top_row + r, b * BLOCK + i] if corrected else 1.0


@kernel
def _live_voxels(alive, live, shift, step, radius):
    """The voxel intervals that the footprints of the band's live blocks reach; their number.

    A pixel u reads voxels up to ``radius`` from x = (u - shift) / step.
    """
    count = 0
    b = 0
    while b < alive.size:
        if alive[b] == 0:
            b += 1
            continue
        first = b
        while b < alive.size and alive[b] != 0:
            b += 1
        low = math.floor((first * BLOCK - shift) / step - radius)
        high = math.ceil((b * BLOCK - 1 - shift) / step + radius) + 1
        if count > 0 and low <= live[count - 1, 1]:
            live[count - 1, 1] = high
        else:
            live[count, 0] = low
            live[count, 1] = high
            count += 1
    return count


@kernel
def _decode_sheet(
    pointers, data_starts, runs, voxels, decoding, width, first_slice, slice_weights, kind, radius_u, radius_v, margin,
    shift_u, step_u, shift, step, top_row, rows, lines, touched, used, reach, live, band_alive,
):
    """Blend the voxel scanlines that a band needs from the slices that reach a sheet.

    ``slice_weights``: (taps,) of slice ``first_slice`` and the next.  ``shift_u``, ``step_u``, ``shift``, ``step``:
    sheet pixel = step * voxel + shift, along and across scanlines; ``radius_u``, ``radius_v`` of the footprint.
    ``margin``: voxels of zeros before a scanline's first.
    Returns the first scanline (slot 0), the number of slots, whether anything was found, and whether every pixel
    of the band is already opaque.
    """
    n_slices, n_scanlines = pointers.shape
    voxel_blocks = touched.size // used.size
    pitch = 4 * VOXEL_BLOCK * voxel_blocks
    taps = tap_count(radius_v)
    first_line = first_tap(kind, (top_row - shift) / step, radius_v)
    found = False
    live_count = -1
    tapped = first_line - 1  # the last scanline dealt with
    for r in range(rows):
        j = first_tap(kind, (top_row + r - shift) / step, radius_v)
        for line in range(max(j, tapped + 1), j + taps):
            tapped = line
            slot = line - first_line
            used[slot] = 0
            reach[slot, 0] = width + margin
            reach[slot, 1] = 0
            if line < 0 or line >= n_scanlines:
                continue
            for deeper in range(slice_weights.size):
                k = first_slice + deeper
                weight = slice_weights[deeper]
                if weight == 0.0 or k < 0 or k >= n_slices:
                    continue
                run = pointers[k, line]
                if run < 0:  # the paper's flag: nothing on this scanline
                    continue
                if live_count < 0:
                    live_count = _live_voxels(band_alive, live, shift_u, step_u, radius_u)
                    if live_count == 0:
                        return first_line, 0, False, True
                add_runs(
                    lines, pitch * slot, touched, voxel_blocks * slot, reach[slot], margin, weight, runs, run, voxels,
                    decoding, data_starts[k, line], width, live, live_count,
                )
                used[slot] = 1
                found = True
    return first_line, tapped - first_line + 1, found, False


@kernel
def _blend_lines(kind, y, radius, stretch, first_line, lines, touched, used, reach, pitch, voxel_blocks):
    """Blend the scanlines around ``y`` into the last slot by a footprint of any height; whether there is anything."""
    target = used.size - 1
    first = first_tap(kind, y, radius)
    taps = tap_count(radius)
    total = 0.0
    found = False
    for tap in range(taps):
        total += footprint_weight(kind, (y - (first + tap)) / stretch)
        found |= used[first + tap - first_line] != 0
    if not found:
        return False
    reach[target, 0] = reach[first - first_line, 0]
    reach[target, 1] = 0
    for tap in range(taps):
        slot = first + tap - first_line
        weight = np.float32(footprint_weight(kind, (y - (first + tap)) / stretch) / total)
        if used[slot] == 0 or weight == 0.0:
            continue
        reach[target, 0] = min(reach[target, 0], reach[slot, 0])
        reach[target, 1] = max(reach[target, 1], reach[slot, 1])
        for block in range(voxel_blocks):
            if touched[voxel_blocks * slot + block] != 0:
                touched[voxel_blocks * target + block] = 1
                source, to = pitch * slot + 4 * VOXEL_BLOCK * block, pitch * target + 4 * VOXEL_BLOCK * block
                for i in range(4 * VOXEL_BLOCK):
                    lines[to + i] += weight * lines[source + i]
    return True


@kernel
def _inside_limits(limits, v, first_pixel, count, begin, end, length, length_inside):
    """Shorten the rays of one block to the part of a slab between the near clip and the first mesh or far clip."""
    for i in range(count):
        ahead = max(limits[0, v, first_pixel + i] - begin, 0.0)
        behind = max(end - limits[1, v, first_pixel + i], 0.0)
        length_inside[i] = length[i] * np.float32(min(max(1.0 - (ahead + behind) / (end - begin), 0.0), 1.0))


@kernel
def _composite_sheet(
    sheet, shift_u, scale_u, shift_v, scale_v, begin, end, thickness, wide, margin, first_line, top_row, rows,
    image_width, limits, least, additive_opacity, width, lines, touched, used, reach, state, lengths, alive,
    bright, cells, weights, placed, samples, length_inside, before, half,
):
    """One sheet over the rows of a band: footprints added, sheet composited; whether a block became opaque.

    ``shift_u``, ``scale_u``, ``shift_v``, ``scale_v``: sheet pixel = scale * voxel + shift; ``begin``, ``end``: the
    slab; ``margin``: voxels before a scanline's first.  Arrays: see ``Scratch`` and ``splat_rows``.  (Separate
    arrays, not tuples of them, and one call a sheet: numba counts references at every hand-over.)
    """
    blocks = placed.size
    voxel_blocks = touched.size // used.size
    pitch = 4 * VOXEL_BLOCK * voxel_blocks
    step = 1.0 / scale_u
    kind, stretch_u, stretch_v, radius_u, radius_v = TENT, 1.0, 1.0, 1.0, 1.0
    if wide is not None:
        kind, radius, widen = wide
        stretch_u, stretch_v = _stretch(widen, scale_u), _stretch(widen, scale_v)
        radius_u, radius_v = radius * stretch_u, radius * stretch_v
    taps = tap_count(radius_u)
    # Pixels beside the volume are drawn up to it, but not so near that a footprint with an edge would reach.
    low_end, top = margin - radius_u - 0.5, width - 0.5 + margin + radius_u
    died = False
    for r in range(rows):
        v = top_row + r
        y = (v - shift_v) / scale_v
        slot = first_tap(kind, y, radius_v) - first_line
        down = np.float32(0.0)
        next_slot = slot
        if wide is None:  # two lines, mixed as they are read
            if used[slot] == 0 and used[slot + 1] == 0:
                continue
            down = np.float32(y - (slot + first_line))
            next_slot = slot + 1
        else:
            if not _blend_lines(
                kind, y, radius_v, stretch_v, first_line, lines, touched, used, reach, pitch, voxel_blocks
            ):
                continue
            slot = next_slot = used.size - 1
        mark, next_mark = voxel_blocks * slot, voxel_blocks * next_slot
        # Only pixels whose taps can reach a touched voxel.
        first_u = (min(reach[slot, 0], reach[next_slot, 0]) - margin - radius_u) * scale_u + shift_u
        last_u = (max(reach[slot, 1], reach[next_slot, 1]) - margin + radius_u) * scale_u + shift_u
        for b in range(max(int(first_u) // BLOCK, 0), min(int(max(last_u, 0.0)) // BLOCK + 1, blocks)):
            if alive[r, b] == 0:
                continue
            start = (b * BLOCK - shift_u) * step + margin
            low, high = max(start, low_end), min(start + (BLOCK - 1) * step, top)
            hit = False
            first_voxel = max(int(low - radius_u), 0)
            for block in range(first_voxel // VOXEL_BLOCK, int(max(high + radius_u, 0.0)) // VOXEL_BLOCK + 1):
                if touched[mark + block] != 0 or touched[next_mark + block] != 0:
                    hit = True
                    break
            if not hit:
                continue
            block_cells = cells[BLOCK * b : BLOCK * (b + 1)]
            block_weights = weights[BLOCK * taps * b : BLOCK * taps * (b + 1)]
            if placed[b] != sheet:  # the taps are the same for all rows of the band
                placed[b] = sheet
                if wide is None:
                    place_taps(block_cells, block_weights, start, step, top)
                else:
                    place_wide_taps(
                        block_cells, block_weights, taps, kind, stretch_u, radius_u, start, step, low_end, top
                    )
            if wide is None:
                gather_samples(samples, lines, pitch * slot, pitch, down, block_cells, block_weights)
            else:
                gather_wide(samples, lines, pitch * slot, block_cells, block_weights, taps)
            at = r * blocks + b
            row = state[4 * BLOCK * at : 4 * BLOCK * (at + 1)]
            length = lengths[BLOCK * at : BLOCK * (at + 1)]
            first_pixel = b * BLOCK
            count = min(BLOCK, image_width - first_pixel)
            if limits is not None:
                _inside_limits(limits, v, first_pixel, count, begin, end, length, length_inside)
                length = length_inside
            if additive_opacity is not None:
                composite_opacity(row, samples, length, thickness, before, least)
            else:
                composite_extinction(row, samples, length, thickness, before, least)
            live_pixels, bright_pixels = tally(row, least)
            if bright_pixels != bright[r, b]:
                bright[r, b] = bright_pixels
                note_half_depth(row, before, begin, end, half[v, first_pixel : first_pixel + count], count)
            if limits is not None:  # a ray that has reached its end is done as well
                live_pixels = 0
                for i in range(count):
                    live_pixels += np.int32(row[CLEAR + i] >= least and limits[1, v, first_pixel + i] > end)
            if live_pixels == 0:
                alive[r, b] = 0
                died = True
        if wide is not None:
            clear_touched(lines, pitch * slot, touched, mark, voxel_blocks)
    return died


@kernel
def _splat_band(
    tables, sheets, rays, wide, least, additive_opacity, corrected, top_row, rows, worker, scratch, out, half
):
    """``rows`` rows of the intermediate image from ``top_row`` on, through all sheets; see ``splat_rows``."""
    # Unpacked once: every look-up in a tuple of arrays counts references, too dear for the loops below.
    pointers, data_starts, runs, voxels, decoding, width = tables
    first_slice, slice_weights, thickness, begin, end, scale, offset = sheets
    path_length, limits = rays
    kind, radius, widen = TENT, 1.0, False
    if wide is not None:
        kind, radius, widen = wide
    mine = worker * SPREAD
    lines, touched = scratch.lines[mine], scratch.touched[mine]
    used, reach = scratch.used[mine], scratch.reach[mine]
    live, state, length = scratch.live[mine], scratch.state[mine], scratch.length[mine]
    alive, bright, placed = scratch.alive[mine], scratch.bright[mine], scratch.placed[mine]
    cells, weights, samples = scratch.cells[mine], scratch.weights[mine], scratch.samples[mine]
    length_inside, before = scratch.length_inside[mine], scratch.before[mine]
    n_scanlines = pointers.shape[1]
    image_width = path_length.shape[1]
    blocks = placed.size
    voxel_blocks = touched.size // used.size
    pitch = 4 * VOXEL_BLOCK * voxel_blocks
    margin = weights.size // cells.size  # as many voxels as a footprint has taps
    band_alive = alive[BAND]
    _begin_band(state, length, alive, bright, placed, top_row, rows, path_length, corrected)
    for sheet in range(first_slice.size):
        shift, step = offset[sheet, 1], scale[sheet, 1]
        radius_u = radius * _stretch(widen, scale[sheet, 0])
        radius_v = radius * _stretch(widen, step)
        first_y, last_y = (top_row - shift) / step, (top_row + rows - 1 - shift) / step
        if last_y <= -radius_v or first_y >= n_scanlines - 1 + radius_v:
            continue
        first_line, slots, found, opaque = _decode_sheet(
            pointers, data_starts, runs, voxels, decoding, width, first_slice[sheet], slice_weights[sheet], kind,
            radius_u, radius_v, margin, offset[sheet, 0], scale[sheet, 0], shift, step, top_row, rows, lines, touched,
            used, reach, live, band_alive,
        )
        if opaque:
            break  # early termination
        if not found:
            continue
        died = _composite_sheet(
            sheet, offset[sheet, 0], scale[sheet, 0], shift, step, begin[sheet], end[sheet],
            np.float32(thickness[sheet]), wide, margin, first_line, top_row, rows, image_width, limits,
            least, additive_opacity, width, lines, touched, used, reach, state, length, alive, bright, cells, weights,
            placed, samples, length_inside, before, half,
        )
        for slot in range(slots):
            if used[slot] != 0:
                used[slot] = 0
                clear_touched(lines, pitch * slot, touched, voxel_blocks * slot, voxel_blocks)
        if died:
            for b in range(blocks):
                band_alive[b] = 0
                for r in range(rows):
                    band_alive[b] |= alive[r, b]
    for r in range(rows):
        for u in range(image_width):
            at = 4 * BLOCK * (r * blocks + u // BLOCK) + u % BLOCK
            for channel in range(4):
                out[top_row + r, u, channel] = state[at + BLOCK * channel]


@kernel(parallel=True)
def splat_rows(
    tables, sheets, rays, wide, least, additive_opacity, corrected, first_row, last_row, workers, scratch, out, half
):
    """Rows [first_row, last_row) of the intermediate image.

    ``tables``, ``sheets``, ``rays``, ``wide``: see ``arguments``.  ``least``: float32 transmittance at which a pixel
    is opaque.  ``additive_opacity``: True for the paper's model in place of extinction, else None.  ``corrected``:
    whether the length of rays counts.  What is None is not even compiled: numba makes a kernel of its own, when it
    is first needed, for each combination of footprint, model and limits.
    Out: ``out`` (H, W, 4) float32 premultiplied colour and transmittance; ``half`` (H, W) float32 depth along the
    viewing direction at which the transmittance falls below one half, left alone where it does not.
    """
    bands = (last_row - first_row + BAND - 1) // BAND
    for task in prange(workers):
        worker = np.int64(task)  # prange counts unsigned, which would compile the loop a second time
        # Bands go round the workers in turn: neighbours cost alike, so the shares come out even.
        for band in range(worker, bands, workers):
            top_row = first_row + band * BAND
            _splat_band(
                tables, sheets, rays, wide, least, additive_opacity, corrected, top_row,
                min(BAND, last_row - top_row), worker, scratch, out, half,
            )
