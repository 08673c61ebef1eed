"""Run-length encoding of a classified, shaded volume along one principal axis (paper, section 2.2; algorithm.md, 1.1).

There are two steps: the tables that state where voxels are, and their voxel records. The second step processes a few
planes at a time, so that shaded colors never exist for all voxels at once. A change of light repeats only the second
step. The result does not depend on the number of threads.
"""

from __future__ import annotations

import numpy as np

from ..classify.placing import RecordPositions
from ..classify.reference import find_targets
from ..classify.reference import pack as mark_bits
from ..classify.visible import VisibleVoxels
from ..runtime.jit import compiled, parallel_call, read_only, run_either, thread_count
from ..runtime.steps import drain, map_steps
from ..runtime.work_sizes import RECORDS_AT_ONCE
from ..scene import MODELS, RECORDS, RleSplatError
from ..volume.axes import AXES
from ..volume.blocks import cut_chunks
from . import encode_kernels as passes
from . import reference
from .line_bits import WORD
from .records import decoding_of, empty_records, words_of
from .tables import (
    RunLengthVolume,
    RunTables,
    data_pointers_from_scanlines,
    pointers_from_counts,
    run_type,
    scanline_pointers_from_counts,
)

# Records packed at once, per thread: their unpacked form, 16 bytes each, then stays in a cache. (A new buffer of 64 MiB
# for every change of light would cost as much as the packing.)
PACKED_AT_ONCE = 1 << 18
PAGE, TOUCHED_AT_ONCE = 1 << 12, 1 << 23  # bytes; so many are touched between two chances to cancel, 5 to 10 ms
TABLED_AT_ONCE = 1 << 25  # voxels, shown or not, whose runs are counted or written between two chances to cancel


def encode(
    classified, colors, axis: int, model: str = "extinction", *, record: int = 16, threads: int = 0,
) -> RunLengthVolume:  # fmt: skip
    """Encode a classified volume for one principal axis.

    Parameters
    ----------
    classified : ClassifiedVolume
    colors : (m, 3) array_like
        Shaded unassociated color of each visible voxel.
    axis : {0, 1, 2}
        Principal axis: x, y or z.
    model : {"extinction", "opacity"}
        Store (extinction * RGB, extinction) or (alpha * RGB, alpha).
    record : {16, 8}
        Bytes of a voxel record.
    threads : int
        0 for one per core.

    Raises
    ------
    RleSplatError
        If a parameter is out of range, or ``colors`` does not match the voxels.
    """
    if record not in RECORDS:
        raise RleSplatError(f"A voxel record has {', '.join(map(str, RECORDS))} bytes, not {record!r}.")
    if model not in MODELS:
        raise RleSplatError(f"There is no model called {model!r}; choose {' or '.join(MODELS)}.")
    density = classified.extinction if model == "extinction" else classified.opacity
    colors = read_only(np.ascontiguousarray(colors, dtype=np.float32))
    if colors.shape != (len(density), 3):
        raise RleSplatError(f"There must be one RGB color per visible voxel, {len(density)} x 3, not {colors.shape}.")

    most_color = float(colors.max(initial=0.0))

    def write(positions, records):
        """Records from ``colors``; see ``record_steps``."""
        first, last = positions.span
        made = empty_records(16, last - first)
        made[:, 3] = density[first:last]
        made[:, :3] = made[:, 3:] * colors[first:last]
        _place(positions, made, records, threads)
        return most_color

    tables = run_tables(classified.voxels, axis, threads=threads)
    decoding = decoding_of(record, float(density.max(initial=0.0)), most_color)
    return drain(record_steps(tables, classified.voxels, write, model, record, decoding, threads=threads))


def run_tables(voxels: VisibleVoxels, axis: int, *, threads: int = 0) -> RunTables:
    """``table_steps`` at once."""
    return drain(table_steps(voxels, axis, threads=threads))


def table_steps(voxels: VisibleVoxels, axis: int, *, threads: int = 0):
    """Generator of fractions done: run-length tables of the visible voxels, without records.

    Parameters
    ----------
    axis : {0, 1, 2}
        Principal axis: x, y or z.
    threads : int
        0 for one per core.

    Returns
    -------
    RunTables

    Raises
    ------
    RleSplatError
        If there is no such axis.
    """
    if axis not in AXES:
        raise RleSplatError(f"The principal axis must be 0, 1 or 2 (x, y or z), not {axis!r}.")
    yield 0.0
    if not compiled():
        tables = reference.make_tables(voxels, axis)
    elif axis == 0:
        tables = yield from _across_steps(voxels, threads)
    else:
        tables = yield from _row_steps(voxels, axis, threads)
    return RunTables(axis, voxels.shape_xyz, *tables)


def record_steps(
    tables: RunTables, voxels: VisibleVoxels, write, model: str, record: int = 16, decoding=None, *, threads: int = 0
):
    """Generator of fractions done: add voxel records to run-length tables.

    Parameters
    ----------
    voxels : VisibleVoxels
        The voxels of ``tables``.
    write : callable
        ``write(positions, records)`` writes the records of some voxels (RecordPositions) to their positions in
        ``records`` (n, 4) float32, and returns the largest channel of their colors.
    model : {"extinction", "opacity"}
    record : {16, 8}
        Bytes of a voxel record.
    decoding : ndarray of float32 or None
        As of ``records.decoding_of``.
    threads : int
        0 for one per core.

    Returns
    -------
    RunLengthVolume
    """
    voxel_data = empty_records(record, tables.n_voxels)
    floats, codes = empty_records(16, 0), empty_records(record, 0)
    most_color, inverse = 0.0, None if decoding is None else 1.0 / decoding.astype(np.float64)
    in_order = tables.axis == 2  # records stay in the order of the voxels
    if not in_order:
        yield from map_steps(touch_steps(voxel_data), lambda _: 0.0)
    for fraction, *chunk in _cut_chunks(voxels):
        yield fraction
        if record == 16:
            most_color = max(most_color, write(_positions(tables, voxels, *chunk), voxel_data))
            continue
        for _, *planes in _cut_chunks(voxels, PACKED_AT_ONCE * thread_count(threads), *chunk):
            positions = RecordPositions.in_order(voxels, *planes)
            first, last = positions.span
            if len(floats) < last - first:
                floats = empty_records(16, last - first)
            if not in_order and len(codes) < last - first:
                codes = empty_records(record, last - first)
            most_color = max(most_color, write(positions, floats))
            made = voxel_data[first:last] if in_order else codes[: last - first]
            run_either(threads, passes.pack, reference.pack, floats[: last - first], inverse, made)
            if not in_order:
                _place(_positions(tables, voxels, *planes), words_of(made), words_of(voxel_data), threads)
    return tables.with_voxels(model, voxel_data, decoding, most_color)


def reorder_steps(tables: RunTables, voxels: VisibleVoxels, in_order: RunLengthVolume, *, threads: int = 0):
    """As ``record_steps``, from the records of principal z, ``in_order``, which are in the order of the voxels."""
    voxel_data = empty_records(in_order.record, tables.n_voxels)
    words, target = words_of(in_order.voxel_data), words_of(voxel_data)
    yield from map_steps(touch_steps(voxel_data), lambda _: 0.0)
    yield from place_chunks(tables, voxels, words, target, threads=threads)
    return tables.with_voxels(in_order.model, voxel_data, in_order.decoding, in_order.most_color)


def place_chunks(tables: RunTables, voxels: VisibleVoxels, words, target, *, threads: int = 0):
    """Generator of fractions done: copy records from the order of the voxels to the order of run-length tables.

    Parameters
    ----------
    words : (m, w) ndarray
        Records in the order of the voxels.
    target : (m, w) ndarray
        Output, in the order of ``tables``.
    threads : int
        0 for one per core.
    """
    for fraction, first_plane, last_plane in _cut_chunks(voxels):
        yield fraction
        positions = _positions(tables, voxels, first_plane, last_plane)
        first, last = positions.span
        _place(positions, words[first:last], target, threads)


def fetch_chunks(tables: RunTables, voxels: VisibleVoxels, words, source, *, threads: int = 0):
    """Generator of fractions done: copy records back from the order of run-length tables to the order of the voxels.

    Parameters
    ----------
    tables : RunTables
        Of principal x.
    words : (m, w) ndarray
        Output, in the order of the voxels.
    source : (m, w) ndarray
        Records in the order of ``tables``.
    threads : int
        0 for one per core.
    """
    if tables.axis != 0:
        raise ValueError(f"records are fetched from scanlines along y (axis 0) only, not from axis {tables.axis}")
    for fraction, first_plane, last_plane in _cut_chunks(voxels):
        yield fraction
        positions = _positions(tables, voxels, first_plane, last_plane)
        first, last = positions.span
        if compiled():
            with parallel_call(threads):
                moved = _pack_move(positions, words[first:last], read_only(_bytes(source)))
                passes.fetch_across(*moved, *_across(voxels))
        else:
            words[first:last] = source[find_targets(positions)]


def touch_steps(array: np.ndarray):
    """Generator of fractions: write to each page of a contiguous array that holds nothing yet.

    The system clears a page when it is first written to.  Who writes to all parts of a large array at once waits for
    all of them: 170 ms of 107 MB.
    """
    memory = array.reshape(-1).view(np.uint8)
    for first in range(0, memory.size, TOUCHED_AT_ONCE):
        yield first / memory.size
        memory[first : first + TOUCHED_AT_ONCE : PAGE] = 0


def brightest_steps(voxels: VisibleVoxels, write):
    """Generator: yield the fraction done, return the largest channel of any color.

    ``write``: see ``record_steps``; the records that it writes are discarded.
    """
    floats = empty_records(16, 0)
    most_color = 0.0
    for fraction, *chunk in _cut_chunks(voxels):
        yield fraction
        for _, *planes in _cut_chunks(voxels, PACKED_AT_ONCE * thread_count(0), *chunk):
            positions = RecordPositions.in_order(voxels, *planes)
            first, last = positions.span
            if len(floats) < last - first:
                floats = empty_records(16, last - first)
            most_color = max(most_color, write(positions, floats))
    return most_color


def _cut_chunks(voxels: VisibleVoxels, at_once: int | None = None, first: int = 0, last: int | None = None):
    """Yield (fraction done, first plane, last plane) for pieces of planes [first, last); None for all planes.

    ``at_once``: approximate number of visible voxels of a piece; None for RECORDS_AT_ONCE.
    """
    _, ny, nz = voxels.shape_xyz
    at_once, end = at_once or RECORDS_AT_ONCE, nz if last is None else last
    plane_start = voxels.row_start[::ny]
    while first < end:
        last = int(np.searchsorted(plane_start, plane_start[first] + at_once, side="right")) - 1
        last = min(max(last, first + 1), end)
        yield first / nz, first, last
        first = last


def _positions(tables: RunTables, voxels: VisibleVoxels, first_plane: int, last_plane: int) -> RecordPositions:
    """Positions of the records of some planes' voxels in ``tables``."""
    starts = tables.scanline_data_pointers
    # Planes are the slices of principal z, and the scanline numbers of the other two axes.
    starts = starts[first_plane:last_plane] if tables.axis == 2 else starts[:, first_plane:last_plane].T
    return RecordPositions(voxels, first_plane, tables.axis == 0, starts)


def _place(positions: RecordPositions, words, voxel_words, threads):
    """Copy the records of some planes, as words in the order of the voxels, to the scanlines of the tables."""
    if compiled():
        with parallel_call(threads):
            moved = _pack_move(positions, read_only(words), _bytes(voxel_words))
            if positions.across:
                passes.place_across(*moved, *_across(positions.voxels))
            else:
                passes.place_rows(*moved)
    else:
        voxel_words[find_targets(positions)] = words


def _pack_move(positions: RecordPositions, words, voxel_bytes) -> tuple:
    """Arguments of kernels that move records: ``words`` (n, w) of some planes, and the bytes of all records."""
    size = words.itemsize * words.shape[1]
    if size > passes.MOST_BYTES:
        raise ValueError(f"records have at most {passes.MOST_BYTES} bytes, not {size}")
    n_y, first_plane, row_start, _, _, data_starts = positions.arguments
    return n_y, first_plane, row_start, data_starts, size, _bytes(words), voxel_bytes


def _across(voxels: VisibleVoxels) -> tuple:
    """Further arguments of kernels that move records to scanlines along y."""
    return _bits_of(voxels), voxels.column


def _bits_of(voxels: VisibleVoxels) -> np.ndarray:
    """One bit per voxel of a row; those of a list that was not made of bits are made of its columns."""
    if voxels.bits is not None:
        return voxels.bits
    nx, ny, nz = voxels.shape_xyz
    seen, bits = np.zeros((nz * ny, nx), bool), np.empty((nz * ny, -(-nx // WORD)), np.uint64)
    seen[np.repeat(np.arange(nz * ny), np.diff(voxels.row_start)), voxels.column] = True
    mark_bits(seen, bits)
    return read_only(bits)


def _bytes(words) -> np.ndarray:
    """Records as flat uint8, so that one kernel moves records of all sizes."""
    return words.reshape(-1).view(np.uint8)


def _row_steps(voxels: VisibleVoxels, axis, threads):
    """Generator of fractions: tables of principal y or z, where a scanline is a row of the visible voxels."""
    nx, ny, nz = voxels.shape_xyz
    # Row z * ny + y belongs to slice z, scanline y for principal z; to slice y, scanline z for principal y.
    rows = np.arange(nz * ny, dtype=np.int64).reshape(nz, ny)
    rows = rows if axis == 2 else np.ascontiguousarray(rows.T)
    starts, ends = voxels.row_start[:-1], voxels.row_start[1:]
    last = np.zeros(len(starts), np.int64)  # one past the last visible voxel of each row
    seen = ends > starts
    last[seen] = voxels.column[ends[seen] - 1].astype(np.int64) + 1
    # Of one type: where memory has run out, numpy crashes when it finds no room to convert in.
    run_counts = 2 * voxels.row_pieces.astype(np.int64) + (seen & (last < nx)).astype(np.int64)
    scanline_pointers, n_runs = scanline_pointers_from_counts(run_counts[rows])
    scanline_data_pointers, n_voxels = pointers_from_counts((ends - starts)[rows])
    runs, bits = np.empty(n_runs, dtype=run_type(voxels.shape_xyz)), _bits_of(voxels)
    for first, last in cut_chunks(len(rows), rows.shape[1] * nx, TABLED_AT_ONCE):
        yield first / len(rows)
        with parallel_call(threads):
            passes.fill_row_runs(rows[first:last], bits, nx, scanline_pointers[first:last], runs)
    data_pointers = data_pointers_from_scanlines(scanline_data_pointers, n_voxels)
    return scanline_pointers, data_pointers, runs, scanline_data_pointers


def _across_steps(voxels: VisibleVoxels, threads):
    """Generator of fractions: tables of principal x, where scanlines run along y, so that each plane z crosses nx."""
    nx, ny, nz = voxels.shape_xyz
    # Filled instead of np.zeros: the system provides a page when it is first touched, which is slow from two threads
    # at once.
    run_counts, voxel_counts = np.full((2, nz, nx), 0, np.int32)
    bits, planes = _bits_of(voxels), list(cut_chunks(nz, nx * ny, TABLED_AT_ONCE))
    for first, last in planes:
        yield 0.5 * first / nz
        with parallel_call(threads):
            own = slice(first, last)
            passes.count_across(bits[first * ny : last * ny], ny, run_counts[own], voxel_counts[own])
    scanline_pointers, n_runs = scanline_pointers_from_counts(np.ascontiguousarray(run_counts.T))
    scanline_data_pointers, n_voxels = pointers_from_counts(np.ascontiguousarray(voxel_counts.T))
    runs = np.empty(n_runs, dtype=run_type(voxels.shape_xyz))
    starts = np.ascontiguousarray(scanline_pointers.T)
    for first, last in planes:
        yield 0.5 + 0.5 * first / nz
        with parallel_call(threads):
            passes.fill_across_runs(bits[first * ny : last * ny], ny, starts[first:last], runs)
    data_pointers = data_pointers_from_scanlines(scanline_data_pointers, n_voxels)
    return scanline_pointers, data_pointers, runs, scanline_data_pointers
