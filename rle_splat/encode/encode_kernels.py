"""The passes of the encoder, parallel over scanlines or planes (algorithm.md 1.1; twins in encode.py).

Throughout: ``row_start`` (nz * ny + 1,) int64 and ``column`` (m,) are the visible voxels'; ``runs`` as in
``tables.RunLengthVolume``.
"""

from __future__ import annotations

import numpy as np

from ..jit import kernel, prange


@kernel(parallel=True)
def color_records(density, colors, records):
    """(n, 4) float32 ``records``: (density * RGB, density), from (n,) and (n, 3) float32."""
    for i in prange(records.shape[0]):
        thickness = density[i]
        records[i, 0] = thickness * colors[i, 0]
        records[i, 1] = thickness * colors[i, 1]
        records[i, 2] = thickness * colors[i, 2]
        records[i, 3] = thickness


@kernel(parallel=True)
def fill_row_runs(rows, row_start, column, width, scanline_pointers, runs):
    """Writes the runs of each scanline that is a row; ``rows`` (n_slices, n_scanlines) int64: which row."""
    n_scanlines = rows.shape[1]
    for line in prange(rows.size):
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


@kernel(parallel=True)
def count_across(row_start, column, n_rows, run_counts, voxel_counts):
    """Runs and voxels of each scanline along y; both counts (nz, nx), zero on entry, ``n_rows`` = ny."""
    for z in prange(run_counts.shape[0]):
        end = np.zeros(run_counts.shape[1], dtype=np.int64)  # per x, one past the last voxel seen
        for y in range(n_rows):
            for i in range(row_start[z * n_rows + y], row_start[z * n_rows + y + 1]):
                x = np.int64(column[i])
                if voxel_counts[z, x] == 0 or y != end[x]:
                    run_counts[z, x] += 2
                end[x] = y + 1
                voxel_counts[z, x] += 1
        for x in range(run_counts.shape[1]):
            if voxel_counts[z, x] > 0 and end[x] < n_rows:
                run_counts[z, x] += 1


@kernel(parallel=True)
def fill_across_runs(row_start, column, n_rows, run_cursors, runs):
    """Writes the runs of the nx scanlines along y that each plane z crosses.

    ``run_cursors`` (nz, nx) int64 hold where each scanline starts (-1 when transparent) and are moved along while it
    is written.
    """
    n_columns = run_cursors.shape[1]
    for z in prange(run_cursors.shape[0]):
        end = np.full(n_columns, -1, dtype=np.int64)  # per x, one past the last voxel written; -1 before the first
        for y in range(n_rows):
            for i in range(row_start[z * n_rows + y], row_start[z * n_rows + y + 1]):
                x = np.int64(column[i])
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


@kernel(parallel=True)
def place_rows(row_start, data_starts, words, voxel_words):
    """Copies voxel records to where their scanlines begin, each scanline a row.

    ``row_start``: of these rows, and of one more; ``data_starts`` (rows,) int64; ``words`` (n, w): the records of
    these rows as words; ``voxel_words`` (m, w): all records in the order of the tables.
    """
    first = row_start[0]
    for row in prange(data_starts.size):
        count = row_start[row + 1] - row_start[row]
        if count > 0:
            source = words[row_start[row] - first : row_start[row + 1] - first]
            target = voxel_words[data_starts[row] : data_starts[row] + count]
            for i in range(count):
                for w in range(words.shape[1]):
                    target[i, w] = source[i, w]


@kernel(parallel=True)
def place_across(row_start, column, n_rows, data_starts, words, voxel_words):
    """Copies voxel records to scanlines along y.  ``column``: of these rows' voxels; ``data_starts`` (planes, nx)
    int64; the others as in ``place_rows``."""
    first = row_start[0]
    for z in prange(data_starts.shape[0]):
        cursors = data_starts[z].copy()
        for i in range(row_start[z * n_rows] - first, row_start[(z + 1) * n_rows] - first):
            x = np.int64(column[i])
            at = cursors[x]
            cursors[x] = at + 1
            for w in range(words.shape[1]):
                voxel_words[at, w] = words[i, w]
