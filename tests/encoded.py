"""Run-length tables as tests look at them: checked as a whole, and as dense grids in the order of the volume."""

from __future__ import annotations

import numpy as np

from rle_splat.encode.records import TYPES, WORDS
from rle_splat.encode.tables import (
    RunLengthVolume,
    counts_of,
    data_pointers_from_scanlines,
    pointers_from_counts,
    run_type,
    scanline_pointers_from_counts,
)
from rle_splat.encode.validate import check_records, check_runs
from rle_splat.scene import RleSplatError
from rle_splat.volume.axes import AXES


def validate(encoded: RunLengthVolume) -> None:
    """Raise RleSplatError unless all tables, the derived one too, are in the canonical form of algorithm.md 1.1."""
    forms = {(np.dtype(kind), WORDS[record]) for record, kind in TYPES.items()}
    data = encoded.voxel_data
    if (data.dtype, data.shape[1:]) not in forms or not data.flags.c_contiguous:
        raise RleSplatError("The tables are damaged: the voxel data are no records.")
    check_records(encoded.axis, data, encoded.decoding)
    counts = counts_of(encoded)
    check_runs(encoded.axis, counts, encoded.runs, encoded.width)
    pointers, _ = scanline_pointers_from_counts(counts[..., 0])
    starts, n_voxels = pointers_from_counts(counts[..., 1])
    same = (
        (encoded.scanline_pointers, pointers), (encoded.scanline_data_pointers, starts),
        (encoded.data_pointers, data_pointers_from_scanlines(starts, len(data))),
    )  # fmt: skip
    good = n_voxels == len(data) and encoded.runs.dtype == run_type(encoded.shape_xyz)
    if not good or not all(held.dtype == found.dtype and np.array_equal(held, found) for held, found in same):
        raise RleSplatError("The tables are damaged: pointers do not follow from the runs.")


def to_volume_order(dense: np.ndarray, axis: int) -> np.ndarray:
    """A (n_slices, n_scanlines, width, ...) grid of principal ``axis`` as a (nz, ny, nx, ...) view."""
    along, across, principal = AXES[axis]
    place = {principal: 0, across: 1, along: 2}  # volume axis (0 x, 1 y, 2 z) -> array axis that holds it
    return dense.transpose(place[2], place[1], place[0], *range(3, dense.ndim))
