"""Kernels of the encoder, parallel over scanlines or planes (algorithm.md 1.1).

Their reference implementations are in encode.py. Common arguments: ``row_start`` (nz * ny + 1,) int64 and ``column``
(m,) of the visible voxels; ``bits``, see ``line_bits``; ``runs`` as in ``tables.RunLengthVolume``.
"""

from __future__ import annotations

import numpy as np

from ..runtime.bits import copy_1, copy_4, copy_16, count_bits, lowest_bit
from ..runtime.jit import inner_loop, kernel
from ..runtime.parallel import share_out
from .line_bits import LAST_BIT, NO_BITS, ONE_BIT, WORD, read_strip, turn_words, word_count, write_runs
from .records import code_of

MOST_BYTES = 16  # largest record


@kernel
def pack(records, inverse, voxel_data):
    """Code records (n, 4) of 16 bytes in 8, ``voxel_data`` (n,); ``inverse`` (4,) float64: one over each scale."""
    share_out(_pack_some, voxel_data.size, (records, inverse, voxel_data))


@kernel(exact=True, inner=True)
def _pack_some(begin, end, records, inverse, voxel_data):
    """``pack`` for records [begin, end)."""
    made, codes = records[begin:end], voxel_data[begin:end]  # slices start at zero, so the loop becomes SIMD
    red, green, blue, density = inverse[0], inverse[1], inverse[2], inverse[3]
    for i in range(codes.size):
        low = code_of(made[i, 0] * red) | (code_of(made[i, 1] * green) << np.uint32(16))
        high = code_of(made[i, 2] * blue) | (code_of(made[i, 3] * density) << np.uint32(16))
        codes[i] = np.uint64(low) | (np.uint64(high) << np.uint64(32))


@kernel
def fill_row_runs(rows, bits, width, scanline_pointers, runs):
    """Write the runs of scanlines that are rows; ``rows`` (n_slices, n_scanlines) int64: row of each scanline."""
    share_out(_fill_row_runs, rows.size, (rows, bits, width, scanline_pointers, runs))


@kernel(inner=True)
def _fill_row_runs(begin, end_line, rows, bits, width, scanline_pointers, runs):
    """``fill_row_runs`` for scanlines [begin, end_line)."""
    n_scanlines = rows.shape[1]
    for line in range(begin, end_line):
        k, j = line // n_scanlines, line % n_scanlines
        if scanline_pointers[k, j] < 0:
            continue
        words = bits[rows[k, j]]
        run, end, before = np.int64(scanline_pointers[k, j]), np.int64(0), NO_BITS
        for n in range(words.size):
            run, end = write_runs(words[n], before, n * WORD, end, runs, run)
            before = words[n] >> LAST_BIT
        if end < width:
            runs[run] = width - end


@kernel
def count_across(bits, n_rows, run_counts, voxel_counts):
    """Count runs and voxels of each scanline along y; counts (nz, nx), zero on entry; ``n_rows`` = ny."""
    share_out(_count_across, run_counts.shape[0], (bits, n_rows, run_counts, voxel_counts))


@kernel(inner=True)
def _count_across(begin, end_plane, bits, n_rows, run_counts, voxel_counts):
    """``count_across`` for planes [begin, end_plane)."""
    n_columns = run_counts.shape[1]
    words, block = np.empty((WORD, word_count(n_columns)), np.uint64), np.empty(WORD, np.uint64)
    before = np.empty(n_columns, np.uint64)
    for z in range(begin, end_plane):
        before[:] = NO_BITS
        for y in range(0, n_rows, WORD):
            read_strip(bits, z * n_rows + y, min(WORD, n_rows - y), words)
            for x in range(0, n_columns, WORD):
                _count_block(
                    words, x // WORD, block, before[x : x + WORD], run_counts[z, x : x + WORD],
                    voxel_counts[z, x : x + WORD],
                )  # fmt: skip
        for x in range(n_columns):  # the transparent rest after the last voxel is a run too
            last = (before[x] >> ((n_rows - 1) % WORD)) & ONE_BIT
            run_counts[z, x] += (voxel_counts[z, x] > 0) & (last == NO_BITS)


@inner_loop
def _count_block(words, n, block, before, runs_of, voxels_of):
    """Count one more word of some scanlines; ``before``: the previous word of each, updated."""
    some = turn_words(words, n, block)
    for i in range(before.size):
        seen = block[i] if some else NO_BITS
        voxels_of[i] += count_bits(seen)
        runs_of[i] += 2 * count_bits(seen & ~((seen << ONE_BIT) | (before[i] >> LAST_BIT)))
        before[i] = seen


@kernel
def fill_across_runs(bits, n_rows, run_starts, runs):
    """Write the runs of the nx scanlines along y that each plane z crosses.

    ``run_starts`` (nz, nx): position of each scanline's first run, -1 if it is transparent.
    """
    share_out(_fill_across_runs, run_starts.shape[0], (bits, n_rows, run_starts, runs))


@kernel(inner=True)
def _fill_across_runs(begin, end_plane, bits, n_rows, run_starts, runs):
    """``fill_across_runs`` for planes [begin, end_plane)."""
    n_columns = run_starts.shape[1]
    words, block = np.empty((WORD, word_count(n_columns)), np.uint64), np.empty(WORD, np.uint64)
    before = np.empty(n_columns, np.uint64)
    cursors, ends = np.empty(n_columns, np.int64), np.empty(n_columns, np.int64)
    for z in range(begin, end_plane):
        before[:] = NO_BITS
        ends[:] = 0
        for x in range(n_columns):
            cursors[x] = run_starts[z, x]
        for y in range(0, n_rows, WORD):
            read_strip(bits, z * n_rows + y, min(WORD, n_rows - y), words)
            for x in range(0, n_columns, WORD):
                _fill_block(
                    words, x // WORD, block, before[x : x + WORD], y, cursors[x : x + WORD], ends[x : x + WORD], runs
                )
        for x in range(n_columns):
            if run_starts[z, x] >= 0 and ends[x] < n_rows:
                runs[cursors[x]] = n_rows - ends[x]


@inner_loop
def _fill_block(words, n, block, before, y, cursors, ends, runs):
    """Write the runs that end in one more word of some scanlines, whose first bit is voxel ``y``.

    ``before``, ``cursors``, ``ends``: previous word, position of the next run and end of the last run of each scanline,
    updated.
    """
    if not turn_words(words, n, block):
        block[:] = NO_BITS
    for i in range(before.size):
        cursors[i], ends[i] = write_runs(block[i], before[i] >> LAST_BIT, y, ends[i], runs, cursors[i])
        before[i] = block[i]


@kernel
def place_rows(n_y, first_plane, row_start, data_starts, size, records, target):
    """Copy voxel records of ``size`` bytes from the order of the voxels to scanlines that are rows.

    ``records``: of some planes; ``target``: of all planes, in the order of the tables; both flat uint8. See
    ``classify.placing.RecordPositions`` for the other arguments.
    """
    share_out(_place_rows, data_starts.size, (n_y, first_plane, row_start, data_starts, size, records, target))


@kernel(inner=True)
def _place_rows(begin, end, n_y, first_plane, row_start, data_starts, size, records, target):
    """``place_rows`` for rows [begin, end) of the planes."""
    first_row = first_plane * n_y
    for n in range(begin, end):
        at, behind = row_start[first_row + n], row_start[first_row + n + 1]
        here, there = (at - row_start[first_row]) * size, data_starts[n // n_y, n % n_y] * size
        _copy(records, here, target, there, (behind - at) * size)


@kernel
def place_across(n_y, first_plane, row_start, data_starts, size, records, target, bits, column):
    """As ``place_rows``, for scanlines along y. ``size``: at most MOST_BYTES; ``bits``: see ``line_bits``."""
    arguments = (n_y, first_plane, row_start, data_starts, size, records, target, None, bits, column)
    share_out(_move_across, data_starts.shape[0], arguments)


@kernel
def fetch_across(n_y, first_plane, row_start, data_starts, size, records, source, bits, column):
    """Reverse of ``place_across``: from the scanlines to the order of the voxels."""
    arguments = (n_y, first_plane, row_start, data_starts, size, records, None, source, bits, column)
    share_out(_move_across, data_starts.shape[0], arguments)


@kernel(inner=True)
def _move_across(begin, end, n_y, first_plane, row_start, data_starts, size, records, target, source, bits, column):
    """Move records from ``records`` to ``target``, or from ``source`` to ``records``; the unused one is None.

    (With a flag instead of None, numba would compile both branches.) Blocks of 64 x 64 voxels are transposed in a
    scratch buffer that stays in the cache, so that neighbors in either order are moved together.
    """
    first = row_start[first_plane * n_y]
    n_columns = data_starts.shape[1]
    words, block = np.empty((WORD, word_count(n_columns)), np.uint64), np.empty(WORD, np.uint64)
    cursors, at = np.empty(n_columns, np.int64), np.empty(WORD, np.int64)
    # Scanlines of a block, with padding after each for bytes that are copied in excess.
    pitch = WORD * size + MOST_BYTES
    turned = np.empty(WORD * pitch, np.uint8)
    for plane in range(begin, end):
        for x in range(n_columns):
            cursors[x] = data_starts[plane, x]
        for y in range(0, n_y, WORD):
            rows, row = min(WORD, n_y - y), (first_plane + plane) * n_y + y
            read_strip(bits, row, rows, words)
            for j in range(rows):
                at[j] = row_start[row + j]
            for x in range(0, n_columns, WORD):
                n = x // WORD
                if not turn_words(words, n, block):
                    continue
                if target is not None:
                    _turn_records(words, n, rows, at, first, column, size, pitch, records, turned)
                    _move_runs(block, cursors[x : x + WORD], size, pitch, turned, target, None)
                if source is not None:
                    _move_runs(block, cursors[x : x + WORD], size, pitch, turned, None, source)
                    _turn_back(words, n, rows, at, first, column, size, pitch, records, turned)


@inner_loop
def _turn_records(words, n, rows, at, first, column, size, pitch, records, turned):
    """Copy the records of word ``n`` of ``rows`` rows to scanlines along y, ``pitch`` bytes apart in ``turned``.

    ``at`` (64,): next voxel of each row, advanced; ``first``: first voxel of ``records``. Bytes copied in excess are
    overwritten by the next row, or lie in the padding of the scanline.
    """
    whole = first + (records.size - MOST_BYTES) // size + 1  # for voxels before this one, MOST_BYTES can be read
    for j in range(rows):
        begin = at[j]
        at[j] = end = begin + count_bits(words[j, n])
        for i in range(begin, min(end, whole)):
            copy_16(records, (i - first) * size, turned, (np.int64(column[i]) - n * WORD) * pitch + j * size)
        for i in range(max(begin, whole), end):
            for byte in range(size):
                to = (np.int64(column[i]) - n * WORD) * pitch + j * size + byte
                copy_1(records, (i - first) * size + byte, turned, to)


@inner_loop
def _turn_back(words, n, rows, at, first, column, size, pitch, records, turned):
    """Reverse of ``_turn_records``."""
    for j in range(rows):
        begin = at[j]
        at[j] = end = begin + count_bits(words[j, n])
        for i in range(begin, end):
            _copy(turned, (np.int64(column[i]) - n * WORD) * pitch + j * size, records, (i - first) * size, size)


@inner_loop
def _move_runs(block, cursors, size, pitch, turned, target, source):
    """Copy the runs of a block from ``turned`` to ``target``, or from ``source`` to ``turned``; the unused one is None.

    ``block``: bits of each scanline; ``cursors``: position of each scanline's next record, advanced.
    """
    for i in range(cursors.size):
        kept, there = block[i], cursors[i] * size
        while kept != NO_BITS:
            begin = lowest_bit(kept)
            rest = ~(kept >> np.uint64(begin))  # the run ends at the first bit that is not set
            count = min(lowest_bit(rest) if rest != NO_BITS else WORD, WORD - begin)
            here = i * pitch + begin * size
            if target is not None:
                _copy(turned, here, target, there, count * size)
            if source is not None:
                _copy(source, there, turned, here, count * size)
            there += count * size
            kept = kept & (kept + (ONE_BIT << np.uint64(begin))) if begin + count < WORD else NO_BITS
        cursors[i] += count_bits(block[i])


@inner_loop
def _copy(source, at, target, to, count):
    """Copy ``count`` bytes; the last ones may be copied twice, but no others are read or written."""
    if count >= 16:
        for i in range(0, count - 16, 16):
            copy_16(source, at + i, target, to + i)
        copy_16(source, at + count - 16, target, to + count - 16)
    elif count >= 4:
        for i in range(0, count - 4, 4):
            copy_4(source, at + i, target, to + i)
        copy_4(source, at + count - 4, target, to + count - 4)
    else:
        for i in range(count):
            copy_1(source, at + i, target, to + i)
