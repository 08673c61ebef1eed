"""Splat one set of run-length tables on to its base plane, front to back."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..encode.tables import RunLengthVolume
from ..runtime.jit import compiled, is_loaded, note_loaded, parallel_call, thread_count
from ..scene import Mist, Quality
from ..view.base_plane import BasePlane
from ..view.depth_rules import ALONE, BETWEEN, Sheets
from .arguments import Records, SheetList, Tables, rays_of, wide_of
from .intermediate_image import IntermediateImage
from .mist_block import mist_rays
from .reference.sheet_buffer import splat_sheets_numpy
from .scratch import BAND, scratch_for
from .sheet_buffer import splat_rows

# Transmittance below which a pixel is opaque whatever the plan says: keeps denormal numbers out of the loop.
OPAQUE = 1e-30
# Pixels and voxels along the rows of all sheets, for each thread between two steps: 8 to 20 ms.  In four steps in
# place of one a draft of the CT engine took 3 to 6 % longer.  With labels or channels each takes up to MIXED times as
# long.
WORK_AT_ONCE, MIXED = 12_000_000, 8
BANDS_EACH = 2  # for each of several threads at once, at least: with fewer, threads wait for one another
LOADING = None


def splat_steps(
    encoded: RunLengthVolume, plane: BasePlane, quality: Quality, length_unit: float = 1.0, intervals=None,
    mist: Mist | None = None,
):  # fmt: skip
    """Generator: yields fractions done in [0, 1], returns an IntermediateImage.

    Yields LOADING before a kernel is loaded, or compiled the first time ever, so that the caller can tell that time
    from the splat's own.

    ``length_unit``: world length in which path lengths are counted, 1 for extinction per world length, the
    opacity unit distance for the opacity model.  ``intervals``: (2, H, W) float32, where each sheet pixel's ray
    begins and ends along the viewing direction of the axis in voxels, or None for whole rays.  ``mist``: None for none.
    Deterministic: the same bits for any number of threads.
    """
    voxels, decoding = encoded.voxel_data, encoded.decoding
    if not compiled():
        voxels, decoding = encoded.decoded(), None
    tables = Tables(
        encoded.scanline_pointers, encoded.scanline_data_pointers, encoded.runs,
        Records.of(voxels, decoding), encoded.width,
    )  # fmt: skip
    sheets = sheet_list(encoded, plane)
    rays = rays_of(plane, length_unit, quality.length_correction, intervals)
    image = IntermediateImage.blank(plane)
    least = np.float32(max(quality.termination, OPAQUE))
    wide = wide_of(plane, quality)
    around = mist_rays(plane, mist)
    # Opacities are taken as they are added only where every sheet stands for one voxel of depth.
    as_added = not quality.length_correction and intervals is None and bool((plane.sheets.thickness == 1.0).all())
    model = (least, None if quality.model == "extinction" else as_added)
    if not compiled():
        yield from splat_sheets_numpy(tables, sheets, rays, wide, *model, around, *image.arrays)
        return image
    workers = thread_count(quality.threads)
    scratch = scratch_for(workers, tables, sheets, rays, wide)
    arguments = (tables, sheets, rays, wide, *model, around)
    yield from row_steps(splat_rows, arguments, plane, sheets, scratch, workers, image.arrays)
    return image


def row_steps(splat_rows, arguments, plane: BasePlane, sheets: SheetList, scratch, workers: int, out, mixed=False):
    """Generator: yields LOADING where that is to be done, then fractions done; all rows of a base plane by a kernel
    like ``splat_rows``, whose first ``arguments`` are given, into the arrays ``out``.

    ``mixed``: whether it has labels or channels.
    """

    def splat(first, last, threads):
        with parallel_call(threads):
            splat_rows(*arguments, first, last, threads, np.zeros(1, np.int64), scratch, *out)

    given = (*arguments, scratch, *out)
    if not is_loaded(splat_rows, given):
        yield LOADING
        splat(0, 0, 1)  # nothing but loading it: waking threads would take as long as preparing a frame
        note_loaded(splat_rows, given)
    work = BAND * (plane.width + arguments[0].width) * len(sheets.begin) * (MIXED if mixed else 1)
    bands = WORK_AT_ONCE // work
    rows_at_once = int(BAND * workers * max(BANDS_EACH if workers > 1 else 0.5, bands))
    for first in range(0, plane.height, rows_at_once):
        yield first / plane.height
        splat(first, min(first + rows_at_once, plane.height), workers)


def sheet_list(encoded, plane: BasePlane) -> SheetList:
    """The sheets of a base plane that the volume's voxels reach.  ``encoded``: a RunLengthVolume or ScalarVolume."""
    some, placed = _list_shown(plane.sheets, encoded.filled_slices.tobytes())
    *before, far, kind = placed
    return SheetList(*before, plane.scale[some], plane.offset[some], far, kind)


@lru_cache(maxsize=16)
def _list_shown(sheets: Sheets, filled_slices: bytes) -> tuple:
    """The sheets that are reached, as an index, and their columns of SheetList but for ``scale`` and ``offset``.

    ``filled_slices``: bytes of (n,) bool, which slices have voxels.  Kept, since most frames have the previous sheets.
    """
    shown = _find_reached(np.frombuffer(filled_slices, bool), sheets)
    between = sheets.kind == BETWEEN
    shown[1:] |= shown[:-1] & between[1:]  # the slab behind the last voxels
    kind = sheets.kind.copy()
    kind[1:][between[1:] & ~shown[:-1]] = ALONE
    columns = (
        sheets.first_slice, sheets.slice_weights, sheets.thickness, sheets.begin, sheets.end, sheets.far, kind,
    )  # fmt: skip
    some = slice(int(shown.argmax()), len(shown) - int(shown[::-1].argmax()))  # nearly always all of them
    some = some if shown[some].all() else shown
    return some, [column[some] for column in columns]


def _find_reached(filled: np.ndarray, sheets: Sheets) -> np.ndarray:
    """(n,) bool: which sheets the footprint of any slice with voxels reaches; the first, where none does.

    ``filled``: which slices have voxels.
    """
    reached = np.zeros(len(sheets.first_slice), bool)
    for tap in range(sheets.slice_weights.shape[1]):
        number = np.minimum(np.maximum(sheets.first_slice + (1 + tap), 0), len(filled) - 1)
        reached |= filled[number] & (sheets.slice_weights[:, tap] > 0.0)
    reached[0] |= not reached.any()
    return reached
