"""Splat the tables of a scalar volume on to their base plane, front to back, classified pixel by pixel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..classify.label_cells import LabelCells
from ..classify.lookup_table import LookupTable
from ..encode.scalars import ScalarVolume
from ..runtime.jit import compiled, read_only, thread_count
from ..scene import Mist, Quality
from ..view.base_plane import BasePlane
from ..view.depth_rules import Sheets
from ..volume.stored_scalars import StoredScalars
from .arguments import ChannelLookups, CodePlanes, Lookup, ScalarTables, box_of, rays_of
from .intermediate_image import IntermediateImage
from .label_fields import NO_LABELS, label_field
from .mist_block import mist_rays
from .pixel_block import BLOCK
from .reference.scalar_sheets import splat_scalar_sheets_numpy
from .sample_lamps import HELD, sample_lamps
from .scalar_group import GROUP
from .scalar_sheets import splat_scalar_rows
from .scratch import Scratch, scratch_for, worth_grouping
from .splat import OPAQUE, row_steps, sheet_list

ALMOST_MOST = 1.0 + 1e-5  # of the largest count: means of it may be rounded up, and the warp limits them anyway


def scalar_splat_steps(
    encoded: ScalarVolume, table: LookupTable, plane: BasePlane, quality: Quality, intervals=None,
    absorbs: bool = False, mist: Mist | None = None, further: tuple[LookupTable, ...] = (), labels=None,
):  # fmt: skip
    """As ``splat.splat_steps``, for post-classified sheets; ``table``: what they are classified by.

    ``absorbs``: only optical depths count, in any order, and what is absorbed is white (algorithm.md 4.2).
    ``further``: of further channels, whose extinctions are added.  ``labels``: a LabelLook, whose tables classify in
    place of ``table``, or None.
    """
    lookup = kernel_lookup(table, encoded.center)
    channels = channel_lookups(lookup, further, encoded.centers, encoded.codes, labels, encoded.center)
    if absorbs:
        extinctions, sums = (np.ascontiguousarray(each[:, 3]) for each in (table.entries, table.sums))
        lookup = lookup._replace(table=extinctions, sums=sums)
    image = yield from _steps(encoded, lookup, None, absorbs or None, plane, quality, intervals, mist, channels, labels)
    if absorbs:
        depths = image.pixels[..., 0].copy()
        image.pixels[..., :3] = -np.expm1(-depths)[..., None]
        np.exp(-depths, out=image.pixels[..., 3])
    return image


def value_splat_steps(encoded: ScalarVolume, values, plane: BasePlane, quality: Quality, intervals=None):
    """As ``splat.splat_steps``, for the largest, smallest or mean values of rays: ``values``, a ``ValueLook``.

    The image's first channel is the count of the value, times how much of the pixel lies inside the box of the volume,
    and the last one is one less that: they can be warped as color and transmittance are.
    """
    sign = values.sign or 1.0
    (origin,), (least,) = _from_center(sign * encoded.center, values.origin), _from_center(encoded.center, values.least)
    zero, nothing = np.float32(0.0), np.zeros(4, np.float32)
    lookup = Lookup(nothing, nothing, origin, zero, least, zero, zero, zero, zero, np.int32(0))
    image = yield from _steps(encoded, lookup, np.float32(values.sign), None, plane, quality, intervals)
    pixels, box = image.pixels, box_of(plane, encoded.tables.shape_xyz, BLOCK)
    if values.sign == 0.0:
        pixels[..., 0] /= np.maximum(pixels[..., 1], np.float32(1e-30))
    np.clip(pixels[..., 0], zero, np.float32(ALMOST_MOST * values.most), out=pixels[..., 0])
    if values.hollow:
        enter, leave = (
            reduce(column, row[:, None]) for reduce, column, row in zip((np.maximum, np.minimum), box.columns, box.rows)
        )
        if intervals is not None:
            enter, leave = np.maximum(enter, intervals[0]), np.minimum(leave, intervals[1])
        pixels[..., 3] = ~(enter < leave)
    pixels[..., 1:3] = 0.0
    image.note_filled()
    return image


def _from_center(center: float, *stored) -> list:
    return [np.float32(min(max(value - center, -1e38), 1e38)) for value in stored]


def kernel_lookup(table: LookupTable, center: float) -> Lookup:
    """The lookup table as kernels take it, for stored values less ``center``."""
    least, low, high, nearest, furthest, origin = _from_center(
        center, table.least, table.low, table.high, table.nearest, table.furthest, table.origin
    )
    return Lookup(
        table.entries.reshape(-1), table.sums.reshape(-1), origin, np.float32(table.rate), least, low, high, nearest,
        furthest, np.int32(len(table.entries) - 1),
    )  # fmt: skip


def channel_lookups(lookup: Lookup, further, centers, codes, labels, center: float) -> ChannelLookups | None:
    """The ChannelLookups of a volume's own Lookup, or of a LabelLook, and of LookupTables; None of a Lookup alone.

    ``further``, ``centers``: LookupTables, and what was taken from the values of each.  ``codes``: (m, channels) of the
    voxels, or None.  ``labels``: None without.  ``center``: what was taken from the volume's own values.
    """
    if not further and labels is None:
        return None
    own = [lookup] if labels is None else [kernel_lookup(table, center) for table in labels.tables]
    others = [kernel_lookup(table, each) for table, each in zip(further, centers, strict=True)]
    return ChannelLookups.of(own, others, 1 + _columns(codes))


class LabelLook(NamedTuple):
    """Which function each point belongs to, a LabelCells, and the LookupTable of each function by its number."""

    cells: LabelCells
    tables: tuple[LookupTable, ...]


def no_numbers(count: int, kind) -> np.ndarray:
    """(count, 0) of type ``kind``: what stands for codes or further values of voxels that have none."""
    return read_only(np.empty((count, 0), kind))


def _columns(array) -> int:
    return 0 if array is None else array.shape[1]


def _tables(encoded: ScalarVolume) -> ScalarTables:
    tables = encoded.tables
    return ScalarTables(
        read_only(tables.scanline_pointers), read_only(tables.scanline_data_pointers), read_only(tables.runs),
        StoredScalars.of(encoded.scalars),
        no_numbers(len(encoded.scalars), np.int16) if encoded.codes is None else read_only(encoded.codes),
        None if encoded.values is None else read_only(encoded.values), encoded.width,
    )  # fmt: skip


def _planes(encoded: ScalarVolume, light, plane: BasePlane, least, scratch: Scratch) -> CodePlanes:
    """``light``: the SampleLight that is wanted."""
    line = scratch.line.line.shape[1]
    planes = _planes_of(encoded)
    lamps = None if light is None else sample_lamps(light, plane, encoded.shape_xyz, least)
    thinning = encoded.codes.shape[1] if encoded.thinned else 0
    return CodePlanes(planes, line // planes, thinning, lamps)


def _planes_of(encoded: ScalarVolume) -> int:
    """Planes of a sheet: the scalar, codes, and values of further channels."""
    return 1 + _columns(encoded.codes) + _columns(encoded.values)


def _steps(
    encoded: ScalarVolume, lookup, sign, absorbs, plane: BasePlane, quality: Quality, intervals, mist=None,
    channels=None, labels=None,
):  # fmt: skip
    """Generator of fractions done: the IntermediateImage of ``splat_scalar_rows``."""
    tables = _tables(encoded)
    sheets = sheet_list(encoded, plane)
    rays = rays_of(plane, 1.0, True, intervals)
    box = box_of(plane, encoded.tables.shape_xyz, BLOCK)
    grouped = _grouped(plane.sheets, encoded.thinned, intervals, sign, absorbs, mist, channels)
    field = None if labels is None else label_field(labels.cells, plane)
    image = IntermediateImage.blank(plane)
    least = np.float32(max(quality.termination, OPAQUE))
    light = encoded.light if sign is None and absorbs is None else None
    arguments = (tables, sheets, rays, box, lookup, sign, absorbs)
    mist = mist_rays(plane, mist)
    if not compiled():
        yield from splat_scalar_sheets_numpy(
            *arguments, encoded.thinned, light, plane, mist, channels, field, least, *image.arrays
        )
        return image
    if channels is not None:  # one kernel is for channels, labels and both
        field = field or NO_LABELS
        if tables.values is None:
            arguments = (tables._replace(values=no_numbers(len(encoded.scalars), np.float32)), *arguments[1:])
    workers = thread_count(quality.threads)
    held, group = 0 if light is None else HELD, GROUP if grouped else 1
    count = _planes_of(encoded)
    scratch = scratch_for(workers, tables, sheets, rays, None, count, before=True, group=group, light=held)
    planes = _planes(encoded, light, plane, float(least), scratch)
    arguments = (*arguments, planes, mist, channels, field, grouped, least)
    yield from row_steps(splat_scalar_rows, arguments, plane, sheets, scratch, workers, image.arrays, field is not None)
    return image


def _grouped(sheets: Sheets, thinned: bool, *extras) -> bool | None:
    """Whether sheets are to be handled in groups: True, or None where they are not, which is left out of the kernel.

    ``extras``: what groups know nothing of, all None without it.
    """
    return True if worth_grouping(sheets) and not thinned and all(extra is None for extra in extras) else None
