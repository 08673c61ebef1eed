"""Sheets of classified voxels: what ``band_walker`` does with them (section 2.3 of the paper; algorithm.md 1.5, 1.6).

A sheet pixel is the sum of the footprints of the classified voxels around it, in the two (or more) slices that the
sheet lies between: premultiplied color and extinction (or opacity).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..runtime.jit import inner_loop, kernel
from ..runtime.lanes import GROUP, clear_group
from ..runtime.parallel import share_out
from ..view.footprints import TENT, first_tap, tap_count, tap_weight, voxel_at
from .arguments import Tables, Wide
from .band_walker import band_walker, row_walker, scanline_walker
from .interval_blocks import count_live, is_outside, is_shortened
from .mist_block import MistRays, copy_colors, fade_added
from .pixel_block import (
    BLOCK,
    TRANSMITTANCE,
    composite_added,
    composite_extinction,
    is_voxel_by_voxel,
    place_tent,
    resample_tent,
    resample_voxel_by_voxel,
)
from .sheet_row import composite_opacity, mix_blocks, note_half_depth, place_wide_taps, resample_wide
from .voxel_scanline import NO_BITS, ONE_BIT, WORD, add_runs, fetch_records

LIVE = 1  # of a block that nothing was composited over: some of its pixels are not opaque


class ClassifiedMedium(NamedTuple):
    """What sheets of classified voxels are splatted from.

    Attributes
    ----------
    wide : Wide or None
        The footprint, None for the plain tent.
    additive_opacity : bool or None
        For the paper's opacity model, whether opacities are taken as they are added (True) or corrected for the
        length of the ray (False); None for extinction.
    least : float32
        Transmittance at which a pixel is opaque.
    """

    tables: Tables
    wide: Wide | None
    additive_opacity: bool | None
    mist: MistRays
    least: np.float32


class Footprint(NamedTuple):
    """A footprint at the scale of one sheet: ``kind`` of ``view.footprints``; how much wider than a voxel it is made
    along (u) and across (v) scanlines, its radius then, and how many voxels it can reach at once."""

    kind: int
    stretch_u: float
    radius_u: float
    taps_u: int
    stretch_v: float
    radius_v: float
    taps_v: int


class Slab(NamedTuple):
    """A sheet's slab: ``begin`` and ``end`` along the viewing direction, ``thickness`` float32, all in voxels; its
    ``footprint``."""

    begin: float
    end: float
    thickness: np.float32
    footprint: Footprint


class BufferRow(NamedTuple):
    """A row of the band: ``slot`` of its first scanline, that scanline's number ``line``, and the row's ``position``
    among scanlines, in voxels."""

    slot: int
    line: int
    position: float


@inner_loop
def _stretch(widen, scale):
    """How much wider than a voxel a footprint is made at ``scale`` sheet pixels per voxel."""
    return max(1.0, 1.0 / scale) if widen else 1.0


@inner_loop
def _footprint(wide, scale_u, scale_v):
    """The Footprint of a sheet of ``scale`` sheet pixels per voxel."""
    if wide is None:
        return Footprint(TENT, 1.0, 1.0, 2, 1.0, 1.0, 2)
    kind, radius, widen = wide
    stretch_u, stretch_v = _stretch(widen, scale_u), _stretch(widen, scale_v)
    radius_u, radius_v = radius * stretch_u, radius * stretch_v
    return Footprint(kind, stretch_u, radius_u, tap_count(radius_u), stretch_v, radius_v, tap_count(radius_v))


@inner_loop
def _footprint_of(medium, scale_u, scale_v):
    """See ``band_walker.scanline_walker``."""
    footprint = _footprint(medium.wide, scale_u, scale_v)
    return footprint.radius_u, footprint.radius_v, footprint.taps_v, footprint


@inner_loop
def _margin(wide, line):
    """Voxels of zeros before a scanline's first: as many as a footprint reaches."""
    return line.weights.size // line.cells.size if wide is not None else 1


@inner_loop
def _place_row(medium, footprint, sheets, number, v, shift_v, scale_v):
    """See ``band_walker.scanline_walker``."""
    y = voxel_at(v, shift_v, scale_v)
    return True, y, first_tap(footprint.kind, y, footprint.radius_v)


@inner_loop
def _run_of(tables, sheets, number, deeper, scanline):
    """The first run of a scanline in the slice ``deeper`` behind the sheet's first, -1 where there is none or where
    the slice has no weight."""
    k = sheets.first_slice[number] + deeper
    if sheets.slice_weights[number, deeper] == 0.0 or k < 0 or k >= tables.pointers.shape[0]:
        return -1
    return int(tables.pointers[k, scanline])


@inner_loop
def _is_filled(medium, sheets, number, scanline):
    """See ``band_walker.scanline_walker``."""
    for deeper in range(sheets.slice_weights.shape[1]):
        if _run_of(medium.tables, sheets, number, deeper, scanline) >= 0:
            return True
    return False


@inner_loop
def _put_voxels(medium, footprint, sheets, number, scanline, slot, shift_u, scale_u, line, live_count, marks):
    """See ``band_walker.scanline_walker``."""
    tables, margin = medium.tables, _margin(medium.wide, line)
    line.reach[0], line.reach[1] = tables.width + margin, 0
    for deeper in range(sheets.slice_weights.shape[1]):
        run = _run_of(tables, sheets, number, deeper, scanline)
        if run < 0:  # the paper's flag: nothing on this scanline
            continue
        add_runs(
            line.line, line.reach, margin, marks, slot, scale_u, shift_u, footprint.radius_u,
            sheets.slice_weights[number, deeper], tables.runs, run, tables.voxels,
            tables.data_starts[sheets.first_slice[number] + deeper, scanline], tables.width, line.live, live_count,
        )  # fmt: skip


@inner_loop
def _fetch_next(medium, ahead, scanline, count):
    """See ``band_walker.scanline_walker``."""
    fetch_records(medium.tables.voxels, medium.tables.data_starts[ahead, scanline], count)


@inner_loop
def _resample_tents(width, is_new, b, at, shift_u, scale_u, line, samples):
    """A block by the plain tent; ``at``: its place in ``samples``."""
    voxels, _, _, cells, weights, _ = line
    if is_new:  # pixels beside the volume are drawn up to its edge, where footprints end
        place_tent(cells, weights, BLOCK * b, b * BLOCK - shift_u, scale_u, width + 0.5 + 1.0)
    if is_voxel_by_voxel(cells, BLOCK * b):
        resample_voxel_by_voxel(voxels, cells, weights, BLOCK * b, samples, at)
    else:
        resample_tent(voxels, cells, weights, BLOCK * b, samples, at)


@inner_loop
def _resample_any(footprint, margin, width, is_new, b, at, shift_u, scale_u, line, samples, mixed):
    """A block by a footprint of any width; ``mixed``: (4 * BLOCK,) scratch."""
    voxels, _, _, cells, weights, _ = line
    kind, stretch, radius, taps, _, _, _ = footprint
    cells, weights = cells[BLOCK * b : BLOCK * (b + 1)], weights[BLOCK * taps * b :]
    if is_new:  # pixels beside the volume are drawn up to it, but not so near that a footprint with an edge would reach
        low, top = -radius - 0.5, width - 0.5 + radius
        place_wide_taps(cells, weights, taps, kind, stretch, radius, b * BLOCK, shift_u, scale_u, margin, low, top)
    resample_wide(voxels, cells, weights, taps, mixed, samples, at)


@inner_loop
def _resample(wide, footprint, width, is_new, b, at, shift_u, scale_u, line, samples, mixed):
    if wide is None:
        _resample_tents(width, is_new, b, at, shift_u, scale_u, line, samples)
    else:
        _resample_any(
            footprint, _margin(wide, line), width, is_new, b, at, shift_u, scale_u, line, samples, mixed
        )  # fmt: skip


@inner_loop
def _resample_block(medium, footprint, is_new, b, at, shift_u, scale_u, line, samples, block):
    """See ``band_walker.scanline_walker``."""
    _resample(
        medium.wide, footprint, medium.tables.width, is_new, b, 4 * BLOCK * at, shift_u, scale_u, line, samples,
        block.samples,
    )  # fmt: skip


@inner_loop
def _clear_line(medium, line):
    """See ``band_walker.scanline_walker``."""
    for i in range(line.reach[0], line.reach[1], GROUP):  # clearing a slice would be a call that saves all registers
        clear_group(line.line, 4 * i)


@inner_loop
def _slab_of(medium, sheets, first, together, waiting):
    """See ``band_walker.row_walker``."""
    footprint = _footprint(medium.wide, sheets.scale[first, 0], sheets.scale[first, 1])
    return Slab(sheets.begin[first], sheets.end[first], np.float32(sheets.thickness[first]), footprint)


@inner_loop
def _row_of(medium, slab, v, r, here, there, waiting):
    """See ``band_walker.row_walker``."""
    return True, BufferRow(here.row_slot[r], here.row_line[r], here.row_position[r])


@inner_loop
def _marked(medium, slab, row, r, word, here, there):
    """See ``band_walker.row_walker``."""
    bits = NO_BITS
    for tap in range(slab.footprint.taps_v):
        bits |= here.marks[row.slot + tap, word]
    return bits


@inner_loop
def _is_marked(marks, slot, b):
    return (marks[slot, b // WORD] >> np.uint64(b % WORD)) & ONE_BIT != NO_BITS


@inner_loop
def _add_scanlines(kind, y, first, taps, stretch, slot, b, blocks, sheet, marks, to):
    """sheet[to:] = block ``b`` of the ``taps`` scanlines from ``slot`` on, by a footprint of any height around ``y``;
    ``first``: number of the first."""
    mixed = sheet[to : to + 4 * BLOCK]
    mixed[:] = np.float32(0.0)
    total = 0.0
    for tap in range(taps):
        total += tap_weight(kind, y, first + tap, stretch)
    for tap in range(taps):
        if not _is_marked(marks, slot + tap, b):
            continue
        weight = np.float32(tap_weight(kind, y, first + tap, stretch) / total)
        at = 4 * BLOCK * ((slot + tap) * blocks + b)
        block = sheet[at : at + 4 * BLOCK]
        for i in range(4 * BLOCK):
            mixed[i] += weight * block[i]


@inner_loop
def _inside_intervals(intervals, v, first_pixel, count, begin, end, lengths, deep, length_inside):
    """Shorten the rays of one block to the part of a slab within their intervals (see ``arguments.Rays``)."""
    for i in range(count):
        u = first_pixel + i
        outside = max(intervals[0, v, u] - begin, 0.0) + max(end - intervals[1, v, u], 0.0)
        for hole in range(2, intervals.shape[0], 2):
            outside += max(min(end, intervals[hole + 1, v, u]) - max(begin, intervals[hole, v, u]), 0.0)
        length_inside[i] = lengths[deep + i] * np.float32(min(max(1.0 - outside / (end - begin), 0.0), 1.0))


@inner_loop
def _scanline_positions(wide, slab, row, b, blocks, here):
    """Where block ``b`` of the two scanlines of a row begins; of a wide footprint, whose scanlines are added up here,
    twice where their sum is."""
    samples, marks = here.samples, here.marks
    mixed = samples.size - 4 * BLOCK
    if wide is None:
        empty = samples.size - 8 * BLOCK  # nothing is ever written there
        upper = 4 * BLOCK * (row.slot * blocks + b) if _is_marked(marks, row.slot, b) else empty
        lower = 4 * BLOCK * ((row.slot + 1) * blocks + b) if _is_marked(marks, row.slot + 1, b) else empty
        return upper, lower
    kind, _, _, _, stretch, _, taps = slab.footprint
    _add_scanlines(kind, row.position, row.line, taps, stretch, row.slot, b, blocks, samples, marks, mixed)
    return mixed, mixed


@inner_loop
def _lay_over(
    wide, additive_opacity, samples, upper, lower, down, length, deep, thickness, least, state, row, before
):  # fmt: skip
    """Composite a block by the model of the medium; see ``pixel_block.composite_extinction``."""
    if additive_opacity is None:
        return composite_extinction(samples, upper, lower, down, length, deep, thickness, least, state, row, before)
    if additive_opacity:
        return composite_added(samples, upper, lower, down, length, deep, thickness, least, state, row, before)
    mixed = samples.size - 4 * BLOCK
    if wide is None:
        mix_blocks(samples, upper, lower, down, mixed)
    return composite_opacity(samples, mixed, length, deep, thickness, least, state, row, before)


@inner_loop
def _composite_slab(
    intervals, wide, additive_opacity, mist, least, slab, row, window, r, b, here, rows, block, half
):  # fmt: skip
    """Composite block ``b`` of row ``r`` of the band; how many of its pixels are not opaque."""
    begin, end, thickness, _ = slab
    blocks = rows.bright.shape[1]
    v, first_pixel = window.top_row + r, b * BLOCK
    count = min(BLOCK, window.image_width - first_pixel)
    at = BLOCK * (r * blocks + b)
    state, to = rows.state, 4 * at
    shortened = False
    if intervals is not None:
        if is_outside(rows.bounds, r, b, begin, end):
            return LIVE
        shortened = is_shortened(rows.bounds, r, b, begin, end)
    upper, lower = _scanline_positions(wide, slab, row, b, blocks, here)
    length, deep = rows.length, at
    if intervals is not None:
        if shortened:
            _inside_intervals(intervals, v, first_pixel, count, begin, end, rows.length, at, block.length_inside)
            length, deep = block.length_inside, 0
    if mist is not None:
        if mist.place.size > 0:
            copy_colors(state, to, block.colors)
    pixels = _lay_over(
        wide, additive_opacity, here.samples, upper, lower, np.float32(row.position - row.line), length, deep,
        thickness, least, state, to, block.before,
    )  # fmt: skip
    if mist is not None:
        if mist.place.size > 0:
            fade_added(mist, state, to, block.colors, block.before, 0.5 * (begin + end), v, first_pixel, count)
    bright = pixels >> 8
    if bright != rows.bright[r, b]:
        rows.bright[r, b] = bright
        note_half_depth(
            None, intervals, block.before, state, to + TRANSMITTANCE, begin, end, half, v, first_pixel, count,
            block.samples,
        )  # fmt: skip
    return count_live(intervals, pixels & 255, rows.bounds, r, b, end, state, to, least, v, first_pixel, count)


@inner_loop
def _composite_block(cut, medium, sheets, slab, row, window, r, b, queued, rays, here, there, own, image):
    """See ``band_walker.row_walker``."""
    _, half, _ = image
    if cut is None:
        live = _composite_slab(
            None, medium.wide, medium.additive_opacity, None, medium.least, slab, row, window, r, b, here, own.rows,
            own.block, half,
        )  # fmt: skip
    else:
        live = _composite_slab(
            rays.intervals, medium.wide, medium.additive_opacity, medium.mist, medium.least, slab, row, window, r, b,
            here, own.rows, own.block, half,
        )  # fmt: skip
    return live, queued


@inner_loop
def _composite_queue(medium, sheets, slab, window, r, word, queued, here, own, image):
    """See ``band_walker.row_walker``: sheets of classified voxels are handled one by one."""
    return False


@inner_loop
def _clear_scratch(medium, own):
    """See ``band_walker.band_walker``."""
    own.line.line[:] = np.float32(0.0)
    own.sheet.samples[own.sheet.samples.size - 8 * BLOCK :] = np.float32(0.0)
    own.block.length_inside[:] = np.float32(0.0)


@inner_loop
def _group_at(medium, sheets, sheet):
    """See ``band_walker.band_walker``."""
    return 1


_splat_bands = band_walker(
    _clear_scratch, _group_at,
    scanline_walker(_footprint_of, _place_row, _is_filled, _put_voxels, _fetch_next, _resample_block, _clear_line),
    row_walker(_slab_of, _row_of, _marked, _composite_block, _composite_queue),
    keeps_sheet_before=False,
)  # fmt: skip


@kernel
def splat_rows(
    tables, sheets, rays, wide, least, additive_opacity, mist, first_row, last_row, workers, next_band, scratch, out,
    half, filled,
):  # fmt: skip
    """Splat rows [first_row, last_row) of the intermediate image (algorithm.md 1.5, 1.6).

    What is None is left out of the compiled kernel: numba compiles one, when it is first needed, for each combination
    of records, footprint and model.

    Parameters
    ----------
    tables : Tables
    sheets : SheetList
    rays : Rays
    wide, least, additive_opacity, mist
        See ``ClassifiedMedium``.
    first_row, last_row : int
    workers : int
        Threads that take bands, whichever is free the next one.
    next_band : (1,) int64, zero
    scratch : Scratch
        For as many workers.
    out : (H, W, 4) float32
        Written: premultiplied scene-linear color and transmittance.
    half : (H, W) float32
        Written: depth along the viewing direction of the axis, in voxels, at which the transmittance falls below one
        half; inf where it does not.
    filled : (2, H) int32
        Written: first column of each row that may have anything in it, and the one behind the last.
    """
    medium = ClassifiedMedium(tables, wide, additive_opacity, mist, least)
    share_out(
        _splat_bands, workers,
        (medium, sheets, rays, first_row, last_row, next_band, scratch, (out, half, filled)),
    )  # fmt: skip
