"""Run-length tables as tests look at them: checked as a whole, and as dense grids in the order of the volume."""

from __future__ import annotations

import numpy as np

from rle_splat.encode.tables import RunLengthVolume
from rle_splat.encode.validate import check_records, scanline_starts
from rle_splat.scene import RleSplatError
from rle_splat.volume.axes import AXES


def validate(encoded: RunLengthVolume) -> None:
    """Raise RleSplatError unless all tables, the derived one too, are in the canonical form of algorithm.md 1.1."""
    check_records(encoded.axis, encoded.voxel_data, encoded.decoding)
    derived = scanline_starts(
        encoded.axis, encoded.shape_xyz, encoded.scanline_pointers, encoded.data_pointers, encoded.runs,
        len(encoded.voxel_data),
    )  # fmt: skip
    if not np.array_equal(derived, encoded.scanline_data_pointers):
        raise RleSplatError("The tables are damaged: the derived pointers do not follow from the runs.")


def to_volume_order(dense: np.ndarray, axis: int) -> np.ndarray:
    """A (n_slices, n_scanlines, width, ...) grid of principal ``axis`` as a (nz, ny, nx, ...) view."""
    along, across, principal = AXES[axis]
    place = {principal: 0, across: 1, along: 2}  # volume axis (0 x, 1 y, 2 z) -> array axis that holds it
    return dense.transpose(place[2], place[1], place[0], *range(3, dense.ndim))
