"""Splat the tables of a scalar volume on to their base plane, front to back, classified pixel by pixel."""

from __future__ import annotations

import numpy as np

from ..classify.value_table import ValueTable
from ..encode.scalars import ScalarVolume
from ..encode.voxel_light import light_planes
from ..jit import compiled, thread_count
from ..scene import Quality
from ..view.base_plane import BasePlane
from .arguments import ScalarTables, box_of, rays_of
from .intermediate_image import IntermediateImage
from .pixel_block import BLOCK
from .scalar_sheets import splat_scalar_rows
from .scalar_sheets_numpy import splat_scalar_sheets_numpy
from .scratch import scratch_for
from .splat import OPAQUE, row_steps, sheet_list


def scalar_splat_steps(
    encoded: ScalarVolume, table: ValueTable, plane: BasePlane, quality: Quality, limits=None
):
    """As ``splat.splat_steps``, for post-classified sheets; ``table``: what they are classified by."""
    tables = ScalarTables(
        encoded.tables.scanline_pointers, encoded.tables.scanline_data_pointers, encoded.tables.runs, encoded.scalars,
        encoded.lights, np.float32(encoded.light_unit), encoded.width,
    )
    sheets = sheet_list(encoded, plane)
    rays = rays_of(plane, 1.0, True, limits)
    box = box_of(plane, encoded.tables.shape_xyz, BLOCK)
    least, low, high, nearest, furthest, origin = (
        np.float32(np.clip(end - encoded.centre, -1e38, 1e38))
        for end in (table.least, table.low, table.high, table.nearest, table.furthest, table.origin)
    )
    look = (
        table.entries.reshape(-1), table.sums.reshape(-1), origin, np.float32(table.rate), least, low, high,
        nearest, furthest, np.int32(len(table.entries) - 1),
    )  # fmt: skip
    matt, gloss = ((), ()) if encoded.lights is None else light_planes(encoded.lights.shape[1])
    pixels = np.empty((plane.height, plane.width, 4), np.float32)
    half = np.full((plane.height, plane.width), np.inf, np.float32)
    least = np.float32(max(quality.termination, OPAQUE))
    arguments = (tables, sheets, rays, box, look, matt, gloss, least)
    if not compiled(quality.backend):
        yield from splat_scalar_sheets_numpy(*arguments, pixels, half)
        return IntermediateImage(plane, pixels, half)
    workers = thread_count(quality.threads)
    channels = 1 if encoded.lights is None else 1 + encoded.lights.shape[1]
    scratch = scratch_for(workers, tables, sheets, rays, None, channels, before=True)
    yield from row_steps(splat_scalar_rows, arguments, plane, sheets, scratch, workers, pixels, half)
    return IntermediateImage(plane, pixels, half)
