"""The sheet-buffer loop: voxel scanlines and sheet scanlines walked together (section 2.3 of the paper).

The sheet buffer has shrunk to one scanline per thread.  Because slices land on the base plane scaled and moved
but never rotated, a row of the intermediate image depends on one pair of voxel scanlines per slice only; so each
row takes all its sheets front to back before the next row begins (algorithm.md 1.5 and 1.8).  Rows are
independent: no races, and the same bits for any number of threads.
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import kernel, prange
from .sheet_row import (
    BLOCK, BLUE, CLEAR, GREEN, RED, composite_extinction, composite_opacity, gather_samples, note_half_depth,
)
from .voxel_scanline import VOXEL_BLOCK, add_runs, clear_touched

ROWS_AT_ONCE = 4  # rows a worker takes in turn: few enough to balance, enough to reuse scanlines in cache


@kernel
def _live_voxels(live, alive, blocks, shift, step):
    """The voxel intervals that the tent footprints of the live pixel blocks reach; their number.

    ``alive``: (blocks,) uint8.  A pixel u reads voxels floor(x) and floor(x) + 1 at x = (u - shift) / step.
    """
    count = 0
    b = 0
    while b < blocks:
        if alive[b] == 0:
            b += 1
            continue
        first = b
        while b < blocks and alive[b] != 0:
            b += 1
        low = int(math.floor((first * BLOCK - shift) / step))
        high = int(math.floor((b * BLOCK - 1 - shift) / step)) + 2
        if count > 0 and low <= live[count - 1, 1]:
            live[count - 1, 1] = high
        else:
            live[count, 0] = low
            live[count, 1] = high
            count += 1
    return count


@kernel
def _splat_row(
    v, pointers, data_starts, runs, voxels, width, lower, fraction, thickness, begin, end, scale, offset,
    path_length, limits, least, additive_opacity, corrected, scanline, touched, row, alive, live, samples, depth,
    before, out, half,
):
    """One row of the intermediate image through all sheets; see ``splat_rows`` for the arguments."""
    image_width = path_length.shape[1]
    blocks = row.size // (4 * BLOCK)
    n_slices, n_scanlines = pointers.shape
    limited = limits.shape[0] != 0
    top = float(width + 1)
    for b in range(blocks):
        alive[b] = 1
        for i in range(BLOCK):
            at = 4 * BLOCK * b + i
            row[at + RED] = row[at + GREEN] = row[at + BLUE] = 0.0
            row[at + CLEAR] = 1.0
    for sheet in range(lower.size):
        y = (v - offset[sheet, 1]) / scale[sheet, 1]
        if y <= -1.0 or y >= n_scanlines:
            continue
        j = int(math.floor(y))
        across = y - j
        found = False
        live_count = -1
        for dk in range(2):
            k = lower[sheet] + dk
            deep = fraction[sheet] if dk == 1 else 1.0 - fraction[sheet]
            if deep == 0.0 or k < 0 or k >= n_slices:
                continue
            for dj in range(2):
                weight = np.float32(deep * (across if dj == 1 else 1.0 - across))
                if weight == 0.0 or j + dj < 0 or j + dj >= n_scanlines:
                    continue
                run = pointers[k, j + dj]
                if run < 0:  # the paper's flag: nothing on this scanline
                    continue
                if live_count < 0:
                    live_count = _live_voxels(live, alive, blocks, offset[sheet, 0], scale[sheet, 0])
                add_runs(
                    scanline, touched, weight, runs, run, voxels, data_starts[k, j + dj], width, live, live_count
                )
                found = True
        if live_count == 0:
            break  # every pixel of the row is opaque: early termination
        if not found:
            continue
        step = 1.0 / scale[sheet, 0]
        for b in range(blocks):
            if alive[b] == 0:
                continue
            start = (b * BLOCK - offset[sheet, 0]) * step + 1.0  # shifted: index 0 is voxel -1
            low, high = start, start + (BLOCK - 1) * step
            if high < 0.0 or low > top:
                continue
            hit = False
            for block in range(int(max(low, 0.0)) // VOXEL_BLOCK, (int(min(high, top)) + 1) // VOXEL_BLOCK + 1):
                if touched[block] != 0:
                    hit = True
                    break
            if not hit:
                continue
            first_pixel = b * BLOCK
            count = min(BLOCK, image_width - first_pixel)
            gather_samples(samples, scanline, 0, BLOCK, start, step, top)
            for i in range(count):
                length = path_length[v, first_pixel + i] if corrected else np.float32(1.0)
                depth[i] = length * np.float32(thickness[sheet])
            if limited:  # the part of the slab between the near clip and the first mesh or far clip
                slab = end[sheet] - begin[sheet]
                for i in range(count):
                    ahead = max(limits[0, v, first_pixel + i] - begin[sheet], 0.0)
                    behind = max(end[sheet] - limits[1, v, first_pixel + i], 0.0)
                    depth[i] *= np.float32(min(max(1.0 - (ahead + behind) / slab, 0.0), 1.0))
            for i in range(count, BLOCK):
                depth[i] = 0.0
            block_row = row[4 * BLOCK * b : 4 * BLOCK * (b + 1)]
            for i in range(BLOCK):
                before[i] = block_row[CLEAR + i]
            if additive_opacity:
                composite_opacity(block_row, samples, depth, least)
            else:
                composite_extinction(block_row, samples, depth, least)
            note_half_depth(
                block_row, before, begin[sheet], end[sheet], half[v, first_pixel : first_pixel + count], 0, count
            )
            alive_pixels = 0
            for i in range(count):
                alive_pixels += np.int32(block_row[CLEAR + i] >= least)
            if limited and alive_pixels > 0:
                alive_pixels = 0
                for i in range(count):
                    alive_pixels += np.int32(
                        block_row[CLEAR + i] >= least and limits[1, v, first_pixel + i] > end[sheet]
                    )
            if alive_pixels == 0:
                alive[b] = 0
        clear_touched(scanline, touched)
    for u in range(image_width):
        at = 4 * BLOCK * (u // BLOCK) + u % BLOCK
        out[v, u, 0] = row[at + RED]
        out[v, u, 1] = row[at + GREEN]
        out[v, u, 2] = row[at + BLUE]
        out[v, u, 3] = row[at + CLEAR]


@kernel(parallel=True)
def splat_rows(
    first_row, last_row, workers, pointers, data_starts, runs, voxels, width, lower, fraction, thickness, begin, end,
    scale, offset, path_length, limits, least, additive_opacity, corrected, out, half,
):
    """Rows [first_row, last_row) of the intermediate image.

    The four tables: ``pointers`` (slices, scanlines) into ``runs`` or -1; ``data_starts`` (slices, scanlines)
    into ``voxels``, flat float32, four channels a record; ``width`` voxels on a scanline.
    Per sheet, front to back: ``lower`` slice and ``fraction`` towards the next, ``thickness`` in voxels of
    depth, slab ``begin`` and ``end`` along the viewing direction; ``scale`` and ``offset`` (sheets, 2): pixel =
    scale * voxel + offset along the scanline [0] and across scanlines [1].
    ``path_length``: (H, W) float32 world length (for opacity: reference distances) per voxel of depth, used when
    ``corrected``.  ``limits``: (2, H, W) float32 where rays begin and end along the viewing direction, or
    (0, 0, 0).  ``least``: float32 transmittance at which a pixel is opaque.
    Out: ``out`` (H, W, 4) float32 premultiplied colour and transmittance; ``half`` (H, W) float32 depth along
    the viewing direction at which the transmittance falls below one half, left alone where it does not.
    """
    image_width = path_length.shape[1]
    blocks = (image_width + BLOCK - 1) // BLOCK
    groups = (last_row - first_row + ROWS_AT_ONCE - 1) // ROWS_AT_ONCE
    for worker in prange(workers):
        voxel_blocks = (width + 3) // VOXEL_BLOCK + 2
        scanline = np.zeros(4 * VOXEL_BLOCK * voxel_blocks, np.float32)
        touched = np.zeros(voxel_blocks, np.uint8)
        row = np.zeros(4 * BLOCK * blocks, np.float32)
        alive = np.zeros(blocks, np.uint8)
        live = np.zeros((blocks, 2), np.int64)
        samples = np.zeros(4 * BLOCK, np.float32)
        depth = np.zeros(BLOCK, np.float32)
        before = np.zeros(BLOCK, np.float32)
        # Groups of rows go round the workers in turn: neighbours cost alike, so the shares come out even.
        for group in range(worker, groups, workers):
            top_row = first_row + group * ROWS_AT_ONCE
            for v in range(top_row, min(top_row + ROWS_AT_ONCE, last_row)):
                _splat_row(
                    v, pointers, data_starts, runs, voxels, width, lower, fraction, thickness, begin, end, scale,
                    offset, path_length, limits, least, additive_opacity, corrected, scanline, touched, row, alive,
                    live, samples, depth, before, out, half,
                )
