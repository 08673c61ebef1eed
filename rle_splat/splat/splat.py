"""Splat one set of run-length tables on to its base plane, front to back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..encode.tables import RunLengthVolume
from ..jit import compiled, parallel_call
from ..scene import Quality
from ..view.base_plane import BasePlane
from .intermediate_image import IntermediateImage
from .sheet_buffer import splat_rows
from .sheet_buffer_numpy import splat_sheets_numpy

# Transmittance below which a pixel is opaque whatever the plan says: keeps denormal numbers out of the loop.
OPAQUE = 1e-30
# Pixel-sheets between two chances to report progress or to cancel, about a tenth of a second's work.
WORK_AT_ONCE = 40_000_000


@dataclass(frozen=True, eq=False)
class SheetArguments:
    """What both forms of the sheet-buffer loop take from the base plane; shapes as in ``splat_rows``."""

    lower: np.ndarray
    fraction: np.ndarray
    thickness: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    scale: np.ndarray
    offset: np.ndarray
    path_length: np.ndarray
    limits: np.ndarray


def splat_steps(
    encoded: RunLengthVolume, plane: BasePlane, quality: Quality, length_unit: float = 1.0, limits=None
):
    """Generator: yields fractions done in [0, 1], returns an IntermediateImage.

    ``length_unit``: world length in which path lengths are counted, 1 for extinction per world length, the
    opacity unit distance for the opacity model.  ``limits``: (2, H, W) float32, where each sheet pixel's ray
    begins and ends along the viewing direction of the axis in voxels, or None for no limits.
    Deterministic: the same bits for any number of threads.
    """
    sheets = plane.sheets
    arguments = SheetArguments(
        sheets.lower, sheets.fraction, sheets.thickness, sheets.begin, sheets.end, plane.scale, plane.offset,
        (plane.path_length() / np.float32(length_unit)).astype(np.float32),
        np.zeros((0, 0, 0), np.float32) if limits is None else np.ascontiguousarray(limits, np.float32),
    )
    pixels = np.empty((plane.height, plane.width, 4), np.float32)
    half = np.full((plane.height, plane.width), np.inf, np.float32)
    least = np.float32(max(quality.termination, OPAQUE))
    additive_opacity = quality.model == "opacity"
    if not compiled(quality.backend):
        yield from splat_sheets_numpy(
            encoded, arguments, least, additive_opacity, quality.length_correction, pixels, half
        )
        return IntermediateImage(plane, pixels, half)
    voxels = encoded.voxel_data.reshape(-1)
    rows_at_once = max(16, int(WORK_AT_ONCE / max(plane.width * len(sheets), 1)))
    for first in range(0, plane.height, rows_at_once):
        yield first / plane.height
        with parallel_call(quality.threads) as workers:
            splat_rows(
                first, min(first + rows_at_once, plane.height), workers, encoded.scanline_pointers,
                encoded.scanline_data_pointers, encoded.runs, voxels, encoded.width, arguments.lower,
                arguments.fraction, arguments.thickness, arguments.begin, arguments.end, arguments.scale,
                arguments.offset, arguments.path_length, arguments.limits, least, additive_opacity,
                quality.length_correction, pixels, half,
            )
    return IntermediateImage(plane, pixels, half)
