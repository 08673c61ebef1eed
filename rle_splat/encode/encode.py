"""Run-length encoding of a classified, shaded volume along one principal axis (paper 2.2, algorithm.md 1.1).

Two passes: count runs and voxels per scanline, then write each scanline at the place the counts give it.  The
result does not depend on the number of threads.
"""

from __future__ import annotations

import numpy as np

from ..axes import AXES
from ..jit import compiled, parallel_call, read_only
from ..scene import MODELS, RleSplatError
from . import encode_kernels as passes
from .tables import (
    RunLengthVolume,
    data_pointers_from_scanlines,
    pointers_from_counts,
    run_type,
    scanline_pointers_from_counts,
)


def encode(
    classified, colors, axis: int, model: str = "extinction", *, backend: str = "auto", threads: int = 0
) -> RunLengthVolume:
    """The four tables of ``classified`` for principal ``axis`` (0, 1, 2 for x, y, z).

    ``colors``: (m, 3) float32, the shaded colour of each of its voxels, unassociated.
    ``model``: "extinction" stores (extinction * RGB, extinction), "opacity" (alpha * RGB, alpha).
    """
    if axis not in AXES:
        raise RleSplatError(f"The principal axis must be 0, 1 or 2 (x, y or z), not {axis!r}.")
    if model not in MODELS:
        raise RleSplatError(f"There is no model called {model!r}; choose {' or '.join(MODELS)}.")
    density = classified.extinction if model == "extinction" else classified.opacity
    colors = read_only(np.ascontiguousarray(colors, dtype=np.float32))
    if colors.shape != (len(density), 3):
        raise RleSplatError(f"There must be one RGB colour per visible voxel, {len(density)}, not {colors.shape}.")
    if not compiled(backend):
        tables = _encode_numpy(classified, density, colors, axis)
    elif axis == 0:
        tables = _encode_across(classified, density, colors, threads)
    else:
        tables = _encode_rows(classified, density, colors, axis, threads)
    return RunLengthVolume(axis, classified.shape_xyz, model, *tables)


def _encode_rows(classified, density, colors, axis, threads):
    """Principal y or z: a scanline is a row of the classified volume, so whole rows are copied."""
    nx, ny, nz = classified.shape_xyz
    # Row z * ny + y belongs to slice z, scanline y for principal z; to slice y, scanline z for principal y.
    rows = np.arange(nz * ny, dtype=np.int64).reshape(nz, ny)
    rows = np.ascontiguousarray(rows if axis == 2 else rows.T)
    voxel_counts = np.diff(classified.row_start)[rows]
    run_counts = np.empty(rows.shape, dtype=np.int64)
    with parallel_call(threads):
        passes.count_row_runs(rows, classified.row_start, classified.column, nx, run_counts)
        scanline_pointers, n_runs = scanline_pointers_from_counts(run_counts)
        scanline_data_pointers, n_voxels = pointers_from_counts(voxel_counts)
        runs = np.empty(n_runs, dtype=run_type(classified.shape_xyz))
        voxel_data = np.empty((n_voxels, 4), dtype=np.float32)
        passes.fill_rows(
            rows, classified.row_start, classified.column, density, colors, nx,
            scanline_pointers, scanline_data_pointers, runs, voxel_data,
        )
    data_pointers = data_pointers_from_scanlines(scanline_data_pointers, n_voxels)
    return scanline_pointers, data_pointers, runs, voxel_data, scanline_data_pointers


def _encode_across(classified, density, colors, threads):
    """Principal x: scanlines run along y, so each plane z scatters its voxels to nx scanlines at once."""
    nx, ny, nz = classified.shape_xyz
    run_counts, voxel_counts = np.zeros((2, nz, nx), dtype=np.int64)
    with parallel_call(threads):
        passes.count_across(classified.row_start, classified.column, ny, run_counts, voxel_counts)
        scanline_pointers, n_runs = scanline_pointers_from_counts(np.ascontiguousarray(run_counts.T))
        scanline_data_pointers, n_voxels = pointers_from_counts(np.ascontiguousarray(voxel_counts.T))
        runs = np.empty(n_runs, dtype=run_type(classified.shape_xyz))
        voxel_data = np.empty((n_voxels, 4), dtype=np.float32)
        passes.fill_across(
            classified.row_start, classified.column, density, colors, ny,
            np.array(scanline_pointers.T, dtype=np.int64, order="C"),
            np.array(scanline_data_pointers.T, order="C"), runs, voxel_data,
        )
    data_pointers = data_pointers_from_scanlines(scanline_data_pointers, n_voxels)
    return scanline_pointers, data_pointers, runs, voxel_data, scanline_data_pointers


def _encode_numpy(classified, density, colors, axis):
    """Twin of all the passes: sort the voxels by scanline, then find where runs begin."""
    _, ny, nz = classified.shape_xyz
    row = np.repeat(np.arange(nz * ny, dtype=np.int64), np.diff(classified.row_start))
    x, y, z = classified.column.astype(np.int64), row % ny, row // ny
    along, across, principal = (np.array((x, y, z))[list(AXES[axis])])
    width, n_scanlines, n_slices = (classified.shape_xyz[i] for i in AXES[axis])
    scanline = principal * n_scanlines + across
    order = np.argsort(scanline, kind="stable")  # keeps y, and x, ascending within a scanline
    scanline, position = scanline[order], along[order]
    voxel_data = np.empty((len(order), 4), dtype=np.float32)
    voxel_data[:, 3] = density[order]
    voxel_data[:, :3] = voxel_data[:, 3:] * colors[order]
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
    runs = np.empty(n_runs, dtype=run_type(classified.shape_xyz))
    pair_of_line = np.arange(len(first)) - np.flatnonzero(opens)[np.cumsum(opens) - 1]
    at = scanline_pointers.reshape(-1)[line] + 2 * pair_of_line
    runs[at], runs[at + 1] = start - previous_end, length
    runs[at[closes][tail > 0] + 2] = tail[tail > 0]
    data_pointers = data_pointers_from_scanlines(scanline_data_pointers, n_voxels)
    return scanline_pointers, data_pointers, runs, voxel_data, scanline_data_pointers
