"""A band of rows of the intermediate image: how it begins, which voxels its live pixels reach, and how it ends."""

from __future__ import annotations

import math

import numpy as np

from ..runtime.jit import inner_loop
from .pixel_block import BLOCK, TRANSMITTANCE, interleaved
from .scratch import BAND
from .voxel_scanline import BLOCK_BITS, NO_BITS, ONE_BIT, WORD, mark_blocks


@inner_loop
def begin_band(
    state, lengths, alive, bright, placed, half, top_row, rows, along, along_slope, across, across_slope, seen
):
    """Clear the rows of a band: no color, transmittance one.

    Blocks of which nothing is ``seen`` count as opaque from the start, and so do pixels beyond the image.
    """
    image_width = along.size
    blocks = placed.size
    alive[:] = NO_BITS
    placed[:] = -1
    state[:] = np.float32(0.0)
    lengths[:] = np.float32(0.0)
    half[top_row : top_row + rows] = np.inf
    for r in range(rows):
        v = top_row + r
        if seen[0, v] < seen[1, v]:
            mark_blocks(alive, r, seen[0, v] >> BLOCK_BITS, (seen[1, v] - 1) >> BLOCK_BITS)
            for word in range(alive.shape[1]):
                alive[BAND, word] |= alive[r, word]
        for b in range(blocks):
            first = b * BLOCK
            count = min(BLOCK, image_width - first)
            bright[r, b] = count
            at = BLOCK * (r * blocks + b)
            state[4 * at + TRANSMITTANCE : 4 * at + TRANSMITTANCE + count] = np.float32(1.0)
            for i in range(count):
                squared = along[first + i] + across[v] + along_slope[first + i] * across_slope[v]
                lengths[at + i] = math.sqrt(max(squared, 0.0))


@inner_loop
def write_rows(state, top_row, rows, image_width, pixels, filled):
    """The finished rows of a band, block by block, to ``pixels`` (H, W, 4) from row ``top_row`` on; and ``filled``
    (2, H): of each row the first block with anything in it, and the end of the last one, in pixels."""
    blocks = -(-image_width // BLOCK)
    for r in range(rows):
        first, last = image_width, 0
        for b in range(blocks):
            row, to = 4 * BLOCK * (r * blocks + b), 4 * ((top_row + r) * image_width + b * BLOCK)
            count = min(BLOCK, image_width - b * BLOCK)
            some = False
            if count == BLOCK:
                some = interleaved(state, row, pixels, to) > 0
            else:
                for i in range(count):
                    for channel in range(4):
                        value = state[row + BLOCK * channel + i]
                        pixels[top_row + r, b * BLOCK + i, channel] = value
                        some |= value != (1.0 if channel == 3 else 0.0)
            if some:
                first, last = min(first, b * BLOCK), max(last, b * BLOCK + count)
        filled[0, top_row + r], filled[1, top_row + r] = first, last


@inner_loop
def live_voxels(alive, blocks, live, shift, step, radius):
    """The voxel intervals that the footprints of the band's live blocks reach; their number.

    ``alive``: (words,) a bit a block.  A pixel u reads voxels up to ``radius`` from x = (u - shift) / step.
    """
    count = 0
    b = 0
    while b < blocks:
        if (alive[b // WORD] >> np.uint64(b % WORD)) & ONE_BIT == NO_BITS:
            b += 1
            continue
        first = b
        while b < blocks and (alive[b // WORD] >> np.uint64(b % WORD)) & ONE_BIT != NO_BITS:
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


@inner_loop
def slice_ahead(first_slice, slice_weights, sheet, n_slices):
    """The last slice that the sheet behind number ``sheet`` reads, -1 for none.

    Its voxels are prefetched while this sheet's are resampled: waiting for them took a fifth of the splat's time.
    ``first_slice``, ``slice_weights``: see ``arguments.SheetList``.
    """
    if sheet + 1 >= first_slice.size:
        return -1
    k = int(first_slice[sheet + 1])
    for deeper in range(slice_weights.shape[1] - 1, -1, -1):
        if slice_weights[sheet + 1, deeper] != 0.0:
            k += deeper
            break
    return k if 0 <= k < n_slices else -1
