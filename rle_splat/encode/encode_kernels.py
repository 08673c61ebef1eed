"""The passes of the encoder, parallel over scanlines or planes (algorithm.md 1.1; twin in encode.py).

Throughout: ``row_start`` (nz * ny + 1,) int64 and ``column`` (m,) are the classified volume's; ``density`` (m,)
and ``colors`` (m, 3) float32; ``runs`` and ``voxel_data`` as in ``tables.RunLengthVolume``.
"""

from __future__ import annotations

import numpy as np

from ..jit import kernel, prange


@kernel(parallel=True)
def count_row_runs(rows, row_start, column, width, run_counts):
    """``rows`` (n_slices, n_scanlines) int64: the classified row of each scanline; writes ``run_counts`` (same)."""
    n_scanlines = rows.shape[1]
    for line in prange(rows.size):
        row = rows[line // n_scanlines, line % n_scanlines]
        count = 0
        end = np.int64(-1)  # one past the last voxel seen; -1 before the first
        for i in range(row_start[row], row_start[row + 1]):
            x = np.int64(column[i])
            if x != end:
                count += 2
            end = x + 1
        if count > 0 and end < width:
            count += 1
        run_counts[line // n_scanlines, line % n_scanlines] = count


@kernel(parallel=True)
def fill_rows(
    rows, row_start, column, density, colors, width, scanline_pointers, scanline_data_pointers, runs, voxel_data
):
    """Writes the runs and voxel records of each scanline at its pointers (both (n_slices, n_scanlines))."""
    n_scanlines = rows.shape[1]
    for line in prange(rows.size):
        k, j = line // n_scanlines, line % n_scanlines
        if scanline_pointers[k, j] < 0:
            continue
        row = rows[k, j]
        run = np.int64(scanline_pointers[k, j]) - 1
        at = scanline_data_pointers[k, j]
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
            thickness = density[i]
            voxel_data[at, 0] = thickness * colors[i, 0]
            voxel_data[at, 1] = thickness * colors[i, 1]
            voxel_data[at, 2] = thickness * colors[i, 2]
            voxel_data[at, 3] = thickness
            at += 1
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
def fill_across(row_start, column, density, colors, n_rows, run_cursors, data_cursors, runs, voxel_data):
    """Scatters each plane z to its nx scanlines along y.

    ``run_cursors`` and ``data_cursors`` (nz, nx) int64 hold where each scanline starts (-1 when transparent) and
    are moved along while it is written.
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
                at = data_cursors[z, x]
                data_cursors[z, x] = at + 1
                thickness = density[i]
                voxel_data[at, 0] = thickness * colors[i, 0]
                voxel_data[at, 1] = thickness * colors[i, 1]
                voxel_data[at, 2] = thickness * colors[i, 2]
                voxel_data[at, 3] = thickness
        for x in range(n_columns):
            if 0 < end[x] < n_rows:
                runs[run_cursors[z, x] + 1] = n_rows - end[x]
