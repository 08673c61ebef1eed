"""The kernels of this folder once more in numpy, to be read, to run where numba is missing, and to test against.

The paper's tables (algorithm.md 1.1) and voxel records (1.11).
"""

import numpy as np

from ..volume.axes import AXES
from .records import BIAS, HALF, LEAST_BITS, SHIFT
from .tables import data_pointers_from_scanlines, pointers_from_counts, run_type, scanline_pointers_from_counts


def make_tables(voxels, axis: int):
    """The run-length tables of one axis: sort the voxels by scanline, then find where runs begin.

    ``voxels``: VisibleVoxels. Returns scanline pointers, data pointers, runs, and data pointers of scanlines.
    """
    _, ny, nz = voxels.shape_xyz
    row = np.repeat(np.arange(nz * ny, dtype=np.int64), np.diff(voxels.row_start))
    x, y, z = voxels.column.astype(np.int64), row % ny, row // ny
    along, across, principal = np.array((x, y, z))[list(AXES[axis])]
    width, n_scanlines, n_slices = (voxels.shape_xyz[i] for i in AXES[axis])
    scanline = principal * n_scanlines + across
    order = np.argsort(scanline, kind="stable")  # keeps y, and x, ascending within a scanline
    scanline, position = scanline[order], along[order]
    voxel_counts = np.bincount(scanline, minlength=n_slices * n_scanlines).reshape(n_slices, n_scanlines)
    scanline_data_pointers, n_voxels = pointers_from_counts(voxel_counts)

    begins = np.ones(n_voxels, dtype=bool)
    begins[1:] = (np.diff(scanline) != 0) | (np.diff(position) != 1)
    first = np.flatnonzero(begins)  # first voxel of each non-transparent run
    length = np.diff(np.append(first, n_voxels))
    line, start = scanline[first], position[first]
    opens = np.ones(len(first), dtype=bool)  # the run is the first of its scanline
    opens[1:] = np.diff(line) != 0
    closes = np.append(opens[1:], True)[: len(first)]
    previous_end = np.where(opens, 0, np.roll(start + length, 1))
    tail = width - (start + length)[closes]
    pairs = np.bincount(line, minlength=n_slices * n_scanlines)
    run_counts = 2 * pairs
    run_counts[line[closes]] += tail > 0
    scanline_pointers, n_runs = scanline_pointers_from_counts(run_counts.reshape(n_slices, n_scanlines))
    runs = np.empty(n_runs, dtype=run_type(voxels.shape_xyz))
    pair_of_line = np.arange(len(first)) - np.flatnonzero(opens)[np.cumsum(opens) - 1]
    at = scanline_pointers.reshape(-1)[line] + 2 * pair_of_line
    runs[at], runs[at + 1] = start - previous_end, length
    runs[at[closes][tail > 0] + 2] = tail[tail > 0]
    data_pointers = data_pointers_from_scanlines(scanline_data_pointers, n_voxels)
    return scanline_pointers, data_pointers, runs, scanline_data_pointers


def list_runs(pointers, starts, runs, width: int, k: int):
    """Yield scanline, first voxel, number of its record and length of each non-transparent run of slice ``k``."""
    for j in np.flatnonzero(pointers[k] >= 0):
        run, x, record = int(pointers[k, j]), 0, int(starts[k, j])
        while x < width:
            x += int(runs[run])
            if x >= width:
                break
            count = int(runs[run + 1])
            yield j, x, record, count
            run, x, record = run + 2, x + count, record + count


def code(relative) -> np.ndarray:
    """Round float64 values in [0, 1] to 16-bit floats, as uint32."""
    bits = np.asarray(relative).astype(np.float32).view(np.uint32)
    return np.where(bits >= LEAST_BITS, (bits - BIAS + HALF) >> SHIFT, np.uint32(0))


def pack(records, inverse, voxel_data):
    """Code records (n, 4), as ``encode_kernels.pack``; ``inverse`` (4,): one over the scale of each channel."""
    codes = code(records * inverse).astype(np.uint64)
    voxel_data[:] = (codes << np.arange(0, 64, 16, dtype=np.uint64)).sum(axis=1, dtype=np.uint64)


def pool(first, row_start, column, extinction, shape_xyz, side: int, means):
    """Means of cubes of voxels, for planes of nodes from number ``first`` on; of ``pooling.pool_steps``."""
    _, n_y, n_z = shape_xyz
    rows = slice(first * side * n_y, min((first + len(means)) * side, n_z) * n_y)
    counts, some = np.diff(row_start)[rows], slice(row_start[rows.start], row_start[rows.stop])
    row = np.repeat(np.arange(rows.start, rows.stop), counts)
    at = row // n_y // side - first, row % n_y // side, column[some].astype(np.int64) // side
    np.add.at(means, at, extinction[some] / np.float32(side**3))
