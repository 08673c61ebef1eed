"""Sheets of the scalar, classified pixel by pixel: what ``band_walker`` does with them (algorithm.md 1.14).

A sheet holds the scalar itself, and what samples are lit by, interpolated; a lookup table makes extinction and color of
it when a slab is composited.  The medium fills the box of the voxel centers: a ray's first and last slab end where it
enters and leaves the box.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..runtime.jit import inner_loop, kernel
from ..runtime.parallel import share_out
from ..runtime.prefetch import fetch_ahead
from ..shade.sample_light import NORMAL
from ..view.depth_rules import BETWEEN, OWN
from ..view.footprints import voxel_at
from .arguments import Box, ChannelLookups, CodePlanes, Lookup, ScalarTables
from .band_walker import band_walker, row_walker, scanline_walker
from .label_fields import LabelField
from .mist_block import MistRays
from .pixel_block import BLOCK, place_inside
from .rays_in_box import NO_ROW, block_at
from .sample_block import clear_light
from .scalar_block import resample_lit_planes, resample_plane
from .scalar_group import GROUP
from .scalar_scanline import NOT_KEPT, fetch_scalars, put_scanline
from .scalar_slab import LIVE, NO_SHARE, Pixels, Samples, composite_slab
from .scratch import BAND
from .voxel_scanline import NO_BITS, ONE_BIT, WORD
from .waiting_blocks import composite_waiting, look_up_waiting, marked_by_both


class ScalarMedium(NamedTuple):
    """What sheets of the scalar are splatted from.

    Attributes
    ----------
    sign : float32 or None
        Which value of a ray is wanted in place of compositing: 1 the largest, -1 the smallest, 0 the mean; of
        ``lookup`` only origin and least count then.
    absorbs : True or None
        True where only the sum of optical depths is wanted; the table has one channel then.
    channels : ChannelLookups or None
        Of several channels, which then classify in place of ``lookup``.
    labels : LabelField or None
        Which of the ``channels`` of the volume's own values classifies where.
    grouped : True or None
        True where sheets are handled in groups (``scalar_group``), which needs ``sign``, ``absorbs`` and ``channels``
        to be None, no mist, whole rays, no thinning, and sheets with slabs of their own.
    least : float32
        Transmittance at which a pixel is opaque.
    """

    tables: ScalarTables
    box: Box
    lookup: Lookup
    planes: CodePlanes
    sign: np.float32 | None
    absorbs: bool | None
    mist: MistRays
    channels: ChannelLookups | None
    labels: LabelField | None
    grouped: bool | None
    least: np.float32


class SheetGroup(NamedTuple):
    """One sheet, or a group of ``together`` sheets from number ``first`` on: ``kind`` of ``view.depth_rules``; from
    where (``front``) to where (``behind``) they reach along the viewing direction, voxels."""

    first: int
    together: int
    kind: int
    front: float
    behind: float


class ScalarRow(NamedTuple):
    """A row of the band: where its rays ``enter`` and ``leave`` the box sideways, voxels along the viewing direction;
    ``slot`` of its first scanline and the fraction ``down`` (float32) towards the next one, in this sheet and in the
    one before; slots are NO_ROW where there is none."""

    enter: np.float32
    leave: np.float32
    slot: int
    down: np.float32
    slot_before: int
    down_before: np.float32


@inner_loop
def _footprint_of(medium, scale_u, scale_v):
    """See ``band_walker.scanline_walker``: always the tent, and samples beside the box are taken at its face."""
    return 1.0 + medium.box.overhang, medium.box.overhang, 2, None


@inner_loop
def _place_row(medium, footprint, sheets, number, v, shift_v, scale_v):
    """See ``band_walker.scanline_walker``."""
    box_rows, n_scanlines = medium.box.rows, medium.tables.pointers.shape[1]
    if sheets.begin[number] >= box_rows[1, v] or sheets.far[number] <= box_rows[0, v]:
        return False, 0.0, 0
    y = min(max(voxel_at(v, shift_v, scale_v), 0.0), n_scanlines - 1.0)
    return True, y, max(min(int(y), n_scanlines - 2), 0)


@inner_loop
def _slices_of(sheets, number):
    """The nearer slice that a sheet reads and its weight, and the weight of the next one, 0 where it reads one only."""
    first, weight, far_weight = (
        sheets.first_slice[number], sheets.slice_weights[number, 0], sheets.slice_weights[number, 1]
    )  # fmt: skip
    if weight == 0.0:
        return first + 1, far_weight, np.float32(0.0)
    return first, weight, far_weight


@inner_loop
def _is_filled(medium, sheets, number, scanline):
    """See ``band_walker.scanline_walker``: a sample that lacks one of its voxels is transparent."""
    near, _, far_weight = _slices_of(sheets, number)
    pointers = medium.tables.pointers
    if int(pointers[near, scanline]) < 0:  # the paper's flag: nothing on this scanline
        return False
    return far_weight == np.float32(0.0) or int(pointers[near + 1, scanline]) >= 0


@inner_loop
def _put_voxels(medium, footprint, sheets, number, scanline, slot, shift_u, scale_u, line, live_count, marks):
    """See ``band_walker.scanline_walker``."""
    line.reach[1] = 0
    if not _is_filled(medium, sheets, number, scanline):
        return
    tables, planes = medium.tables, medium.planes
    near, weight, far_weight = _slices_of(sheets, number)
    far_run, far_voxel = 0, 0
    if far_weight != np.float32(0.0):
        far_run, far_voxel = int(tables.pointers[near + 1, scanline]), tables.data_starts[near + 1, scanline]
    line.reach[0] = tables.width
    put_scanline(
        line.line, planes.stride, line.reach, marks, slot, scale_u, shift_u, medium.box.overhang, tables.runs,
        tables.scalars, tables.codes, tables.values, planes.lamps, weight, int(tables.pointers[near, scanline]),
        tables.data_starts[near, scanline], far_weight, far_run, far_voxel, tables.width, line.live, live_count,
    )  # fmt: skip


@inner_loop
def _fetch(values, tables, ahead, scanline, count):
    first, codes = tables.data_starts[ahead, scanline], tables.codes
    fetch_scalars(tables.scalars, first, count)
    fetch_ahead(codes, first * codes.shape[1], count * codes.shape[1])
    if values is not None:
        fetch_ahead(values, first * values.shape[1], count * values.shape[1])


@inner_loop
def _fetch_next(medium, ahead, scanline, count):
    """See ``band_walker.scanline_walker``."""
    _fetch(medium.tables.values, medium.tables, ahead, scanline, count)


@inner_loop
def _resample_block(medium, footprint, is_new, b, at, shift_u, scale_u, line, samples, block):
    """See ``band_walker.scanline_walker``."""
    voxels, _, _, cells, fractions, _ = line
    planes, stride = medium.planes.count, medium.planes.stride
    if is_new:
        place_inside(cells, fractions, BLOCK * b, b * BLOCK - shift_u, scale_u, medium.tables.width - 1.0)
    to = BLOCK * planes * at
    first = _resample_lit(medium.planes.lamps, voxels, stride, cells, fractions, BLOCK * b, samples, to)
    for plane in range(first, planes):
        resample_plane(voxels, plane * stride, stride, cells, fractions, BLOCK * b, samples, to + BLOCK * plane)


@inner_loop
def _resample_lit(lamps, voxels, stride, cells, fractions, first, samples, to):
    """Resample the planes that all samples have that are lit; how many these are."""
    if lamps is None:
        return 0
    resample_lit_planes(voxels, 0, stride, cells, fractions, first, samples, to)
    return 1 + NORMAL


@inner_loop
def _clear_line(medium, line):
    """See ``band_walker.scanline_walker``: light of voxels that are not kept does not count."""
    first, last = line.reach[0], line.reach[1]
    line.line[first:last] = NOT_KEPT
    _clear_channels(medium.channels, line.line, medium.planes.stride, first, last)


@inner_loop
def _clear_channels(channels, numbers, stride, first, last):
    """Voxels [first, last) of a line, or pixels of a block, have no value in any further channel."""
    if channels is not None:
        for number in range(channels.own, channels.planes.size):
            plane = stride * channels.planes[number]
            numbers[plane + first : plane + last] = NOT_KEPT


# The next three are functions, since numba leaves a branch out only where an argument is None: as plain loops over the
# one sheet of a group that is none, they cost a frame of the quality draft 3 to 6 %.


@inner_loop
def _note_depths(grouped, sheets, first, together, waiting):
    """The thickness of each sheet of a group."""
    if grouped is not None:
        for number in range(together):
            waiting.depths[number] = sheets.thickness[first + number]


@inner_loop
def _note_downs(grouped, slab, r, here, waiting):
    """The fraction of a row towards the second of its scanlines, in each sheet of a group."""
    if grouped is not None:
        for number in range(slab.together):
            at = BAND * number + r
            waiting.downs[number] = here.row_position[at] - here.row_line[at] if here.row_slot[at] != NO_ROW else 0.0


@inner_loop
def _mark_group(grouped, together, r, word, here):
    """The blocks that a row has in the other sheets of a group than the first."""
    bits = NO_BITS
    if grouped is not None:
        for number in range(1, together):
            bits |= marked_by_both(here.marks, here.row_slot[BAND * number + r], word)
    return bits


@inner_loop
def _slab_of(medium, sheets, first, together, waiting):
    """See ``band_walker.row_walker``."""
    _note_depths(medium.grouped, sheets, first, together, waiting)
    return SheetGroup(first, together, sheets.kind[first], sheets.begin[first], sheets.end[first + together - 1])


@inner_loop
def _row_of(medium, slab, v, r, here, there, waiting):
    """See ``band_walker.row_walker``."""
    enter, leave = medium.box.rows[0, v], medium.box.rows[1, v]
    slot = here.row_slot[r]
    slot_before = there.row_slot[r] if slab.kind == BETWEEN else NO_ROW
    down = np.float32(here.row_position[r] - here.row_line[r]) if slot != NO_ROW else NO_SHARE
    down_before = np.float32(there.row_position[r] - there.row_line[r]) if slot_before != NO_ROW else NO_SHARE
    is_crossed = slab.behind > enter and slab.front < leave
    if is_crossed:
        _note_downs(medium.grouped, slab, r, here, waiting)
    return is_crossed, ScalarRow(enter, leave, slot, down, slot_before, down_before)


@inner_loop
def _marked(medium, slab, row, r, word, here, there):
    """See ``band_walker.row_walker``."""
    bits = marked_by_both(here.marks, row.slot, word) | marked_by_both(there.marks, row.slot_before, word)
    return bits | _mark_group(medium.grouped, slab.together, r, word, here)


@inner_loop
def _samples_of(sheet, slot, down, b, planes, blocks):
    """Where block ``b`` of a row's two scanlines is; where there is nothing, at the block without samples."""
    absent = sheet.samples.size - planes * BLOCK
    if slot == NO_ROW:
        return Samples(sheet.samples, absent, absent, down)
    upper = block_at(sheet.marks, slot, b, planes, blocks, absent)
    lower = block_at(sheet.marks, slot + 1, b, planes, blocks, absent)
    return Samples(sheet.samples, upper, lower, down)


@inner_loop
def _composite_member(cut, medium, sheets, slab, member, row, slot, down, pixels, rays, here, there, own, half):
    """Composite a block of one sheet of a group, number ``member``; how many of its pixels are not opaque."""
    number = slab.first + member
    planes, blocks = medium.planes.count, own.rows.bright.shape[1]
    begin, end, thickness = sheets.begin[number], sheets.end[number], np.float32(sheets.thickness[number])
    sample = _samples_of(here, slot, down, pixels.b, planes, blocks)
    sample_before = _samples_of(there, row.slot_before, row.down_before, pixels.b, planes, blocks)
    if cut is None:
        return composite_slab(
            None, medium.sign, medium.absorbs, None, medium.channels, medium.labels, medium, sheets, number, slab.kind,
            begin, end, thickness, row, sample, sample_before, pixels, own.rows, own.block, half,
        )  # fmt: skip
    return composite_slab(
        rays.intervals, medium.sign, medium.absorbs, medium.mist, medium.channels, medium.labels, medium, sheets,
        number, slab.kind, begin, end, thickness, row, sample, sample_before, pixels, own.rows, own.block, half,
    )  # fmt: skip


@inner_loop
def _composite_in_turn(medium, sheets, slab, row, pixels, rays, here, there, own, half):
    """Composite a block of all sheets of a group, one after the other; how many of its pixels are not opaque."""
    b, word = pixels.b, pixels.b // WORD
    bit = ONE_BIT << np.uint64(b % WORD)
    box_blocks = medium.box.blocks
    live = LIVE
    for member in range(slab.together):
        number = slab.first + member
        begin, end = sheets.begin[number], sheets.end[number]
        slot, down = here.row_slot[BAND * member + pixels.r], own.waiting.downs[member]
        if end <= row.enter or begin >= row.leave or end <= box_blocks[0, b] or begin >= box_blocks[3, b]:
            continue
        if marked_by_both(here.marks, slot, word) & bit == NO_BITS:
            continue
        live = _composite_member(
            None, medium, sheets, slab, member, row, slot, down, pixels, rays, here, there, own, half
        )  # fmt: skip
        if live == 0:
            break
    return live


@inner_loop
def _composite(cut, grouped, medium, sheets, slab, row, window, r, b, queued, rays, here, there, own, half):
    box_blocks = medium.box.blocks
    if slab.behind <= box_blocks[0, b] or slab.front >= box_blocks[3, b]:
        return LIVE, queued
    first_pixel = b * BLOCK
    pixels = Pixels(r, b, window.top_row + r, first_pixel, min(BLOCK, window.image_width - first_pixel))
    if grouped is None:
        live = _composite_member(
            cut, medium, sheets, slab, 0, row, row.slot, row.down, pixels, rays, here, there, own, half
        )  # fmt: skip
        return live, queued
    if cut is not None:
        return LIVE, queued  # never: the rays of groups are whole
    enters, leaves = max(box_blocks[1, b], row.enter), min(box_blocks[2, b], row.leave)
    if slab.together == GROUP and slab.front >= enters and slab.behind <= leaves:
        return LIVE, look_up_waiting(
            queued, r, b, here, medium.planes.count, own.rows.bright.shape[1], own.waiting, medium.lookup
        )
    return _composite_in_turn(medium, sheets, slab, row, pixels, rays, here, there, own, half), queued


@inner_loop
def _composite_block(cut, medium, sheets, slab, row, window, r, b, queued, rays, here, there, own, image):
    """See ``band_walker.row_walker``."""
    _, half, _ = image
    return _composite(
        cut, medium.grouped, medium, sheets, slab, row, window, r, b, queued, rays, here, there, own, half
    )  # fmt: skip


@inner_loop
def _composite_queued(grouped, medium, sheets, slab, window, r, word, queued, here, own, half):
    if grouped is None:
        return False
    return composite_waiting(
        queued, r, word, window, slab.first, sheets, medium.lookup.table, medium.planes.lamps, medium.least,
        here.samples, own.waiting, own.rows, own.block, half,
    )  # fmt: skip


@inner_loop
def _composite_queue(medium, sheets, slab, window, r, word, queued, here, own, image):
    """See ``band_walker.row_walker``."""
    _, half, _ = image
    return _composite_queued(medium.grouped, medium, sheets, slab, window, r, word, queued, here, own, half)


@inner_loop
def _clear_scratch(medium, own):
    """See ``band_walker.band_walker``."""
    planes, stride = medium.planes.count, medium.planes.stride
    clear_light(medium.planes.lamps, own.rows.light)
    line = own.line.line
    line[:stride] = NOT_KEPT
    line[stride:] = np.float32(0.0)
    _clear_channels(medium.channels, line, stride, 0, stride)
    for samples in (own.sheet.samples, own.sheet_before.samples):
        absent = samples.size - planes * BLOCK
        samples[absent:] = np.float32(0.0)
        samples[absent : absent + BLOCK] = NOT_KEPT
        _clear_channels(medium.channels, samples, BLOCK, absent, absent + BLOCK)


@inner_loop
def _count_together(grouped, sheets, sheet):
    if grouped is None:
        return 1
    last = sheet + GROUP - 1
    return GROUP if last < sheets.kind.size and sheets.kind[last] == OWN else 1


@inner_loop
def _group_at(medium, sheets, sheet):
    """See ``band_walker.band_walker``."""
    return _count_together(medium.grouped, sheets, sheet)


_splat_bands = band_walker(
    _clear_scratch, _group_at,
    scanline_walker(_footprint_of, _place_row, _is_filled, _put_voxels, _fetch_next, _resample_block, _clear_line),
    row_walker(_slab_of, _row_of, _marked, _composite_block, _composite_queue),
    keeps_sheet_before=True,
)  # fmt: skip


@kernel
def splat_scalar_rows(
    tables, sheets, rays, box, lookup, sign, absorbs, planes, mist, channels, labels, grouped, least, first_row,
    last_row, workers, next_band, scratch, out, half, filled,
):  # fmt: skip
    """Splat rows [first_row, last_row) of the intermediate image, post-classified (algorithm.md 1.14), or gather values
    or depths (4.2).

    What is None is left out of the compiled kernel.

    Parameters
    ----------
    tables : ScalarTables
    sheets : SheetList
    rays : Rays
    box, lookup, sign, absorbs, planes, mist, channels, labels, grouped, least
        See ``ScalarMedium``.
    first_row, last_row, workers, next_band, scratch
        See ``sheet_buffer.splat_rows``.
    out, half, filled
        Written: see ``sheet_buffer.splat_rows``; without compositing, see ``ray_sums``.
    """
    medium = ScalarMedium(tables, box, lookup, planes, sign, absorbs, mist, channels, labels, grouped, least)
    share_out(
        _splat_bands, workers,
        (medium, sheets, rays, first_row, last_row, next_band, scratch, (out, half, filled)),
    )  # fmt: skip
