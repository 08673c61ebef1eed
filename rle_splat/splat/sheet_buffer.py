"""The sheet-buffer loop: voxel scanlines and sheet scanlines walked together (section 2.3 of the paper).

The sheet buffer has shrunk to a band of a few scanlines per thread.  Because slices land on the base plane scaled
and moved but never rotated, a row of the intermediate image depends on two neighbouring voxel scanlines per slice
only; so each band takes all its sheets front to back before the next band begins (algorithm.md 1.5 and 1.8).
Bands are independent: no races, and the same bits for any number of threads.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..jit import kernel, prange
from .sheet_row import (
    BLOCK,
    BLUE,
    CLEAR,
    GREEN,
    RED,
    composite_extinction,
    composite_opacity,
    gather_samples,
    note_half_depth,
    place_taps,
    tally,
)
from .voxel_scanline import VOXEL_BLOCK, add_runs, clear_touched

BAND = 8  # rows that share the scanlines they are splatted from: few enough to stay in cache


class Scratch(NamedTuple):
    """What one worker writes on while it walks through the sheets; flat arrays unless a shape is given.

    Voxel scanlines, one ``slot`` each: ``lines`` float32, ``touched`` uint8 marks, ``used`` uint8, ``reach``
    (slots, 2) first and last shifted voxel touched; ``live`` (n, 2) voxel intervals under pixels not yet opaque.
    Rows in blocks of pixels: ``state`` colour and transmittance, ``length`` of rays, ``alive`` (BAND + 1, blocks),
    the last row for the band as a whole, ``bright`` (BAND, blocks) pixels above one half.
    Taps of the sheet's pixels: ``cells``, ``fractions``, and the sheet they were ``placed`` for, per block.
    One block: ``samples``, ``length_inside`` the limits, ``before`` the sheet.
    """

    lines: np.ndarray
    touched: np.ndarray
    used: np.ndarray
    reach: np.ndarray
    live: np.ndarray
    state: np.ndarray
    length: np.ndarray
    alive: np.ndarray
    bright: np.ndarray
    cells: np.ndarray
    fractions: np.ndarray
    placed: np.ndarray
    samples: np.ndarray
    length_inside: np.ndarray
    before: np.ndarray


@kernel
def _scratch(width, image_width, closest):
    """Scratch for one worker; ``closest``: sheet pixels between scanlines where they lie closest together."""
    blocks = (image_width + BLOCK - 1) // BLOCK
    voxel_blocks = (width + 3) // VOXEL_BLOCK + 2
    slots = math.ceil(BAND / closest) + 3
    return Scratch(
        np.zeros(4 * VOXEL_BLOCK * voxel_blocks * slots, np.float32), np.zeros(voxel_blocks * slots, np.uint8),
        np.zeros(slots, np.uint8), np.zeros((slots, 2), np.int64), np.zeros((blocks, 2), np.int64),
        np.zeros(4 * BLOCK * blocks * BAND, np.float32), np.zeros(BLOCK * blocks * BAND, np.float32),
        np.zeros((BAND + 1, blocks), np.uint8), np.zeros((BAND, blocks), np.int32),
        np.zeros(BLOCK * blocks, np.int32), np.zeros(BLOCK * blocks, np.float32), np.zeros(blocks, np.int64),
        np.zeros(4 * BLOCK, np.float32), np.zeros(BLOCK, np.float32), np.zeros(BLOCK, np.float32),
    )


@kernel
def _begin_band(scratch, top_row, rows, length, corrected):
    """Clear the rows of a band: no colour, all light; pixels beyond the image are opaque from the start."""
    image_width = length.shape[1]
    blocks = scratch.placed.size
    for b in range(blocks):
        count = min(BLOCK, image_width - b * BLOCK)
        scratch.alive[BAND, b] = 1
        scratch.placed[b] = -1
        for r in range(rows):
            scratch.alive[r, b] = 1
            scratch.bright[r, b] = count
            at = r * blocks + b
            row = scratch.state[4 * BLOCK * at : 4 * BLOCK * (at + 1)]
            for i in range(BLOCK):
                row[RED + i] = row[GREEN + i] = row[BLUE + i] = 0.0
                row[CLEAR + i] = 1.0 if i < count else 0.0
                scratch.length[BLOCK * at + i] = 0.0
            for i in range(count):
                scratch.length[BLOCK * at + i] = length[top_row + r, b * BLOCK + i] if corrected else 1.0


@kernel
def _live_voxels(alive, live, shift, step):
    """The voxel intervals that the tent footprints of the band's live blocks reach; their number.

    A pixel u reads voxels floor(x) and floor(x) + 1 at x = (u - shift) / step.
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
        low = math.floor((first * BLOCK - shift) / step)
        high = math.floor((b * BLOCK - 1 - shift) / step) + 2
        if count > 0 and low <= live[count - 1, 1]:
            live[count - 1, 1] = high
        else:
            live[count, 0] = low
            live[count, 1] = high
            count += 1
    return count


@kernel
def _decode_sheet(
    pointers, data_starts, runs, voxels, width, low_slice, deep, shift_u, step_u, shift, step, top_row, rows, lines,
    touched, used, reach, live, band_alive,
):
    """Blend the voxel scanlines that a band needs from slices ``low_slice`` and the next, ``deep`` towards it.

    ``shift_u``, ``step_u``, ``shift``, ``step``: sheet pixel = step * voxel + shift, along and across scanlines.
    Returns the first scanline (slot 0), the number of slots, whether anything was found, and whether every pixel
    of the band is already opaque.
    """
    n_slices, n_scanlines = pointers.shape
    voxel_blocks = touched.size // used.size
    pitch = 4 * VOXEL_BLOCK * voxel_blocks
    first_line = math.floor((top_row - shift) / step)
    found = False
    live_count = -1
    tapped = first_line - 1  # the last scanline dealt with
    for r in range(rows):
        j = math.floor((top_row + r - shift) / step)
        for line in range(max(j, tapped + 1), j + 2):
            tapped = line
            slot = line - first_line
            used[slot] = 0
            reach[slot, 0] = width + 1
            reach[slot, 1] = 0
            if line < 0 or line >= n_scanlines:
                continue
            for deeper in range(2):
                k = low_slice + deeper
                weight = np.float32(deep if deeper == 1 else 1.0 - deep)
                if weight == 0.0 or k < 0 or k >= n_slices:
                    continue
                run = pointers[k, line]
                if run < 0:  # the paper's flag: nothing on this scanline
                    continue
                if live_count < 0:
                    live_count = _live_voxels(band_alive, live, shift_u, step_u)
                    if live_count == 0:
                        return first_line, 0, False, True
                add_runs(
                    lines, pitch * slot, touched, voxel_blocks * slot, reach[slot], weight, runs, run, voxels,
                    data_starts[k, line], width, live, live_count,
                )
                used[slot] = 1
                found = True
    return first_line, tapped - first_line + 1, found, False


@kernel(inline="always")
def _inside_limits(limits, v, first_pixel, count, begin, end, length, length_inside):
    """Shorten the rays of one block to the part of a slab between the near clip and the first mesh or far clip."""
    for i in range(count):
        ahead = max(limits[0, v, first_pixel + i] - begin, 0.0)
        behind = max(end - limits[1, v, first_pixel + i], 0.0)
        length_inside[i] = length[i] * np.float32(min(max(1.0 - (ahead + behind) / (end - begin), 0.0), 1.0))


@kernel
def _composite_sheet(
    sheet, shift_u, scale_u, shift_v, scale_v, begin, end, thickness, first_line, top_row, rows, image_width, limits,
    least, additive_opacity, top, lines, touched, used, reach, state, lengths, alive, bright, cells, fractions, placed,
    samples, length_inside, before, half,
):
    """One sheet over the rows of a band: footprints added, sheet composited; whether a block became opaque.

    ``shift_u``, ``scale_u``, ``shift_v``, ``scale_v``: sheet pixel = scale * voxel + shift; ``begin``, ``end``: the
    slab; ``top``: last shifted voxel coordinate.  Arrays: see ``Scratch`` and ``splat_rows``.  (Separate arrays,
    not tuples of them, and one call a sheet: numba counts references at every hand-over.)
    """
    blocks = placed.size
    voxel_blocks = touched.size // used.size
    pitch = 4 * VOXEL_BLOCK * voxel_blocks
    limited = limits.shape[0] != 0
    step = 1.0 / scale_u
    died = False
    for r in range(rows):
        v = top_row + r
        y = (v - shift_v) / scale_v
        j = math.floor(y)
        slot = j - first_line
        if used[slot] == 0 and used[slot + 1] == 0:
            continue
        down = np.float32(y - j)
        mark = voxel_blocks * slot
        # Only pixels whose two taps can reach a touched voxel.
        first_u = (min(reach[slot, 0], reach[slot + 1, 0]) - 2) * scale_u + shift_u
        last_u = max(reach[slot, 1], reach[slot + 1, 1]) * scale_u + shift_u
        for b in range(max(int(first_u) // BLOCK, 0), min(int(max(last_u, 0.0)) // BLOCK + 1, blocks)):
            if alive[r, b] == 0:
                continue
            start = (b * BLOCK - shift_u) * step + 1.0  # shifted: index 0 is voxel -1
            low, high = start, start + (BLOCK - 1) * step
            if high < 0.0 or low > top:
                continue
            hit = False
            for block in range(int(max(low, 0.0)) // VOXEL_BLOCK, (int(min(high, top)) + 1) // VOXEL_BLOCK + 1):
                if touched[mark + block] != 0 or touched[mark + voxel_blocks + block] != 0:
                    hit = True
                    break
            if not hit:
                continue
            block_cells = cells[BLOCK * b : BLOCK * (b + 1)]
            block_fractions = fractions[BLOCK * b : BLOCK * (b + 1)]
            if placed[b] != sheet:  # the taps are the same for all rows of the band
                placed[b] = sheet
                place_taps(block_cells, block_fractions, start, step, top)
            gather_samples(samples, lines, pitch * slot, pitch, down, block_cells, block_fractions)
            at = r * blocks + b
            row = state[4 * BLOCK * at : 4 * BLOCK * (at + 1)]
            length = lengths[BLOCK * at : BLOCK * (at + 1)]
            first_pixel = b * BLOCK
            count = min(BLOCK, image_width - first_pixel)
            if limited:
                _inside_limits(limits, v, first_pixel, count, begin, end, length, length_inside)
                length = length_inside
            if additive_opacity:
                composite_opacity(row, samples, length, thickness, before, least)
            else:
                composite_extinction(row, samples, length, thickness, before, least)
            live_pixels, bright_pixels = tally(row, least)
            if bright_pixels != bright[r, b]:
                bright[r, b] = bright_pixels
                note_half_depth(row, before, begin, end, half[v, first_pixel : first_pixel + count], count)
            if limited and live_pixels > 0:  # a ray that has reached its end is done as well
                live_pixels = 0
                for i in range(count):
                    live_pixels += np.int32(row[CLEAR + i] >= least and limits[1, v, first_pixel + i] > end)
            if live_pixels == 0:
                alive[r, b] = 0
                died = True
    return died


@kernel
def _splat_band(tables, sheets, rays, least, additive_opacity, corrected, top_row, rows, scratch, out, half):
    """``rows`` rows of the intermediate image from ``top_row`` on, through all sheets; see ``splat_rows``."""
    # Unpacked once: every look-up in a tuple of arrays counts references, too dear for the loops below.
    pointers, data_starts, runs, voxels, width = tables
    lower, fraction, thickness, begin, end, scale, offset = sheets
    path_length, limits = rays
    (
        lines, touched, used, reach, live, state, length, alive, bright, cells, fractions, placed, samples,
        length_inside, before,
    ) = scratch
    n_scanlines = pointers.shape[1]
    image_width = path_length.shape[1]
    blocks = placed.size
    voxel_blocks = touched.size // used.size
    pitch = 4 * VOXEL_BLOCK * voxel_blocks
    top = float(width + 1)
    band_alive = alive[BAND]
    _begin_band(scratch, top_row, rows, path_length, corrected)
    for sheet in range(lower.size):
        shift, step = offset[sheet, 1], scale[sheet, 1]
        if (top_row + rows - 1 - shift) / step <= -1.0 or (top_row - shift) / step >= n_scanlines:
            continue
        first_line, slots, found, opaque = _decode_sheet(
            pointers, data_starts, runs, voxels, width, lower[sheet], fraction[sheet], offset[sheet, 0],
            scale[sheet, 0], shift, step, top_row, rows, lines, touched, used, reach, live, band_alive,
        )
        if opaque:
            break  # early termination
        if not found:
            continue
        died = _composite_sheet(
            sheet, offset[sheet, 0], scale[sheet, 0], shift, step, begin[sheet], end[sheet],
            np.float32(thickness[sheet]), first_line, top_row, rows, image_width, limits, least, additive_opacity, top,
            lines, touched, used, reach, state, length, alive, bright, cells, fractions, placed, samples,
            length_inside, before, half,
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
def splat_rows(tables, sheets, rays, least, additive_opacity, corrected, first_row, last_row, workers, out, half):
    """Rows [first_row, last_row) of the intermediate image.

    ``tables``, ``sheets``, ``rays``: see ``arguments``.  ``least``: float32 transmittance at which a pixel is
    opaque.  ``additive_opacity``: the paper's model in place of extinction.  ``corrected``: whether the length of
    rays counts.  Out: ``out`` (H, W, 4) float32 premultiplied colour and transmittance; ``half`` (H, W) float32
    depth along the viewing direction at which the transmittance falls below one half, left alone where it does not.
    """
    bands = (last_row - first_row + BAND - 1) // BAND
    closest = sheets.scale[:, 1].min()
    for worker in prange(workers):
        scratch = _scratch(tables.width, rays.length.shape[1], closest)
        # Bands go round the workers in turn: neighbours cost alike, so the shares come out even.
        for band in range(worker, bands, workers):
            top_row = first_row + band * BAND
            _splat_band(
                tables, sheets, rays, least, additive_opacity, corrected, top_row, min(BAND, last_row - top_row),
                scratch, out, half,
            )
