"""The passes of the encoder, parallel over scanlines or planes (algorithm.md 1.1; twins in encode.py).

Throughout: ``row_start`` (nz * ny + 1,) int64 and ``column`` (m,) are the visible voxels'; ``runs`` as in
``tables.RunLengthVolume``.
"""

from __future__ import annotations

import numpy as np

from ..classify.placing import find_targets
from ..jit import kernel
from ..parallel import share_out

PLACED = 256  # records whose places are found together


@kernel
def color_records(density, colors, records):
    """(n, 4) float32 ``records``: (density * RGB, density), from (n,) and (n, 3) float32."""
    share_out(_color_records, records.shape[0], (density, colors, records))


@kernel(inner=True)
def _color_records(begin, end, density, colors, records):
    for i in range(begin, end):
        thickness = density[i]
        records[i, 0] = thickness * colors[i, 0]
        records[i, 1] = thickness * colors[i, 1]
        records[i, 2] = thickness * colors[i, 2]
        records[i, 3] = thickness


@kernel
def fill_row_runs(rows, row_start, column, width, scanline_pointers, runs):
    """Writes the runs of each scanline that is a row; ``rows`` (n_slices, n_scanlines) int64: which row."""
    share_out(_fill_row_runs, rows.size, (rows, row_start, column, width, scanline_pointers, runs))


@kernel(inner=True)
def _fill_row_runs(begin, end_line, rows, row_start, column, width, scanline_pointers, runs):
    n_scanlines = rows.shape[1]
    for line in range(begin, end_line):
        k, j = line // n_scanlines, line % n_scanlines
        if scanline_pointers[k, j] < 0:
            continue
        row = rows[k, j]
        run = np.int64(scanline_pointers[k, j]) - 1
        start = np.int64(0)  # first voxel of the current non-transparent run
        end = np.int64(0)
        for i in range(row_start[row], row_start[row + 1]):
            x = np.int64(column[i])
            if x != end or run < scanline_pointers[k, j]:
                if run >= scanline_pointers[k, j]:
                    runs[run] = end - start
                runs[run + 1] = x - end
                run += 2
                start = x
            end = x + 1
        runs[run] = end - start
        if end < width:
            runs[run + 1] = width - end


@kernel
def count_across(row_start, column, n_rows, run_counts, voxel_counts):
    """Runs and voxels of each scanline along y; both counts (nz, nx), zero on entry, ``n_rows`` = ny."""
    share_out(_count_across, run_counts.shape[0], (row_start, column, n_rows, run_counts, voxel_counts))


@kernel(inner=True)
def _count_across(begin, end_plane, row_start, column, n_rows, run_counts, voxel_counts):
    for z in range(begin, end_plane):
        runs_of, voxels_of = run_counts[z], voxel_counts[z]
        end = np.full(runs_of.size, -1, dtype=np.int64)  # per x, one past the last voxel seen; -1 before the first
        for y in range(n_rows):
            for i in range(row_start[z * n_rows + y], row_start[z * n_rows + y + 1]):
                x = np.uint64(column[i])
                runs_of[x] += 2 * (end[x] != y)  # no branch to mispredict
                voxels_of[x] += 1
                end[x] = y + 1
        for x in range(runs_of.size):
            if 0 < end[x] < n_rows:
                runs_of[x] += 1


@kernel
def fill_across_runs(row_start, column, n_rows, run_cursors, runs):
    """Writes the runs of the nx scanlines along y that each plane z crosses.

    ``run_cursors`` (nz, nx) int64 hold where each scanline starts (-1 when transparent) and are moved along while it
    is written.
    """
    share_out(_fill_across_runs, run_cursors.shape[0], (row_start, column, n_rows, run_cursors, runs))


@kernel(inner=True)
def _fill_across_runs(begin, end_plane, row_start, column, n_rows, run_cursors, runs):
    n_columns = run_cursors.shape[1]
    for z in range(begin, end_plane):
        end = np.full(n_columns, -1, dtype=np.int64)  # per x, one past the last voxel written; -1 before the first
        for y in range(n_rows):
            for i in range(row_start[z * n_rows + y], row_start[z * n_rows + y + 1]):
                x = np.uint64(column[i])
                if end[x] == y:
                    runs[run_cursors[z, x]] += 1
                else:
                    if end[x] < 0:
                        runs[run_cursors[z, x]] = y
                        run_cursors[z, x] += 1
                    else:
                        runs[run_cursors[z, x] + 1] = y - end[x]
                        run_cursors[z, x] += 2
                    runs[run_cursors[z, x]] = 1
                end[x] = y + 1
        for x in range(n_columns):
            if 0 < end[x] < n_rows:
                runs[run_cursors[z, x] + 1] = n_rows - end[x]


@kernel
def place_records(n_y, first_plane, row_start, column, across, data_starts, words, voxel_words):
    """Copies voxel records, in the voxels' own order, to their scanlines.

    ``words`` (n, w): the records of some planes as words; ``voxel_words`` (m, w): all records in the order of the
    tables.  The others: see ``classify.placing``.
    """
    arguments = (n_y, first_plane, row_start, column, across, data_starts, words, voxel_words, None)
    share_out(_move_records, data_starts.shape[0], arguments)


@kernel
def fetch_records(n_y, first_plane, row_start, column, across, data_starts, words, voxel_words):
    """``place_records`` the other way round: from the scanlines back into the voxels' own order."""
    arguments = (n_y, first_plane, row_start, column, across, data_starts, words, None, voxel_words)
    share_out(_move_records, data_starts.shape[0], arguments)


@kernel(inner=True)
def _move_records(begin, end, n_y, first_plane, row_start, column, across, data_starts, words, target, source):
    """From ``words`` to ``target``, or from ``source`` to ``words``; the other is None.  (Of two branches on one of
    them numba would compile both.)"""
    first = row_start[first_plane * n_y]
    cursors = np.empty(data_starts.shape[1], np.int64)
    places = np.empty(PLACED, np.uint64)
    for plane in range(begin, end):
        for key in range(cursors.size):
            cursors[key] = data_starts[plane, key]
        first_row = (first_plane + plane) * n_y
        row = first_row
        at = row_start[first_row]
        while at < row_start[first_row + n_y]:
            count = min(row_start[first_row + n_y] - at, PLACED)
            row = find_targets(across, first_row, row, row_start, column, at, count, cursors, places)
            some = words[at - first : at - first + count]
            for i in range(count):
                for w in range(words.shape[1]):
                    if target is not None:
                        target[places[i], w] = some[i, w]
                    if source is not None:
                        some[i, w] = source[places[i], w]
            at += count
