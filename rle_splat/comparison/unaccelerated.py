"""The baseline of the paper's Table 2: sheet-buffer splatting that visits every voxel.

It runs the same compiled loops, on the same threads, with the same termination.  Its tables hold each scanline as one
run of "non-transparent" voxels, so that no run is skipped.  That is the only difference.
"""

import numpy as np

from ..encode.tables import (
    RunLengthVolume,
    data_pointers_from_scanlines,
    pointers_from_counts,
    run_type,
    scanline_pointers_from_counts,
)
from ..scene import Quality
from . import ours
from .decode import decode
from .medium import ShadedScene
from .system import ReadySystem

DIFFERS = (
    "The same compiled loops, threads and termination as ours, on tables in which every voxel counts as "
    "non-transparent: no run is ever skipped."
)


def prepare(medium: ShadedScene, quality: Quality) -> ReadySystem:
    """The renderer at ``quality``, visiting every voxel."""
    encoded = ours.encode_axes(medium, quality)
    axes = {axis: every_voxel(tables) for axis, tables in encoded.items()}
    return ours.prepare_tables(medium, quality, axes)


def every_voxel(encoded: RunLengthVolume) -> RunLengthVolume:
    """The same volume with all voxels stored: for each scanline a transparent run of length 0 and one of all voxels."""
    voxels = decode(encoded).reshape(-1, 4)
    shape = (encoded.n_slices, encoded.n_scanlines)
    scanline_pointers, _ = scanline_pointers_from_counts(np.full(shape, 2, np.int64))
    scanline_data_pointers, n_voxels = pointers_from_counts(np.full(shape, encoded.width, np.int64))
    runs = np.tile(np.array((0, encoded.width), run_type(encoded.shape_xyz)), shape[0] * shape[1])
    return RunLengthVolume(
        encoded.axis, encoded.shape_xyz, scanline_pointers,
        data_pointers_from_scanlines(scanline_data_pointers, n_voxels), runs, scanline_data_pointers, encoded.model,
        voxels, None, encoded.most_color,
    )  # fmt: skip
