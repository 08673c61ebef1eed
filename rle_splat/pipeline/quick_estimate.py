"""Count the voxels of an estimate of memory in a few planes of a volume, or in its histogram.

No kernels are loaded here: what only looks at a file does not wait for a compiler.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..classify.transfer_function import TransferFunction
from ..scene import Quality, QualityName, as_quality
from ..volume.counts import counts_values, list_stored_values
from ..volume.volume import Volume
from .memory_estimate import MemoryEstimate, PlannedTables, VoxelCount, estimate_tables

SAMPLED_PLANES = 32  # at most, and of large planes fewer
SAMPLED_VOXELS, LEAST_PLANES = 1 << 24, 4
# Voxels kept for scalar sheets, corners of cells that are shown, for each visible one: 1.25 to 1.85 in scans.
TYPICAL_NEAR = 1.5
TYPICAL_PIECE = 4  # visible voxels side by side in a row of a scan, where nothing but a histogram is known


def estimate_memory(
    volume: Volume, transfer_function: TransferFunction, quality: Quality | QualityName | None = None, *, axes: int = 1,
    shaded: bool | None = None, picture: int = 0,
) -> MemoryEstimate:  # fmt: skip
    """What tables of a volume take, quickly: visible voxels are counted for 8- and 16-bit volumes, else, and for the
    number of runs, in a few planes.

    Parameters
    ----------
    volume : Volume
        The scan.
    transfer_function : TransferFunction
        That of the scene, which decides on the visible voxels.
    quality : Quality or str, optional
        As ``render`` takes it. Left out, "standard".
    axes : int
        How many principal axes are held, mostly one.
    shaded : bool, optional
        Whether the picture is lit; by default, if the transfer function has ``shade``. Shadows and ambient occlusion
        take more.
    picture : int
        Bytes of the sheets and finished pixels, which the estimate adds; 0 for the tables alone.

    Returns
    -------
    MemoryEstimate
        ``needed`` is the number of bytes still to be allocated.
    """
    shaded = transfer_function.shade is not None if shaded is None else shaded
    count = count_in_planes(volume, transfer_function)
    return estimate_visible(count, as_quality(quality), axes=axes, shaded=shaded, picture=picture)


def count_in_planes(volume, tf) -> VoxelCount:
    """The visible voxels of a volume, counted as ``estimate`` counts them."""
    wanted = min(max(SAMPLED_VOXELS // volume.voxels[0].size, LEAST_PLANES), SAMPLED_PLANES)
    planes = volume.voxels[:: max(len(volume.voxels) // wanted, 1)]
    count = pieces = lines = 0
    for plane in planes:
        seen = tf.alpha_at(volume.physical(plane)) > 0.0
        count += int(seen.sum())
        pieces += int((seen[:, 1:] & ~seen[:, :-1]).sum() + seen[:, 0].sum())
        lines += int(seen.any(axis=1).sum())
    share = len(volume.voxels) / len(planes)
    count, pieces, lines = round(share * count), round(share * pieces), round(share * lines)
    if counts_values(volume.voxels.dtype):
        values = volume.physical(list_stored_values(volume.voxels.dtype))
        count = int(volume.value_counts[tf.alpha_at(values) > 0.0].sum())
    return VoxelCount(volume.shape_xyz, volume.voxels.dtype, count, pieces, lines, volume.voxels.nbytes)


def count_in_histogram(shape_xyz, dtype, values, counts, tf) -> VoxelCount:
    """The visible voxels of a volume, roughly, without its voxels.

    Parameters
    ----------
    shape_xyz : (nx, ny, nz)
    dtype : dtype
        Of the volume's voxels.
    values, counts : (n,) ndarray
        Physical values, and how many voxels have each.
    tf : TransferFunction
    """
    _, ny, nz = shape_xyz
    count = int(counts[tf.alpha_at(values) > 0.0].sum())
    pieces, dtype = count // TYPICAL_PIECE, np.dtype(dtype)
    held = math.prod(shape_xyz) * dtype.itemsize
    return VoxelCount(tuple(shape_xyz), dtype, count, pieces, min(pieces, ny * nz), held)


def estimate_visible(
    found: VoxelCount, quality: Quality, *, axes: int = 1, shaded: bool = True, picture: int = 0
) -> MemoryEstimate:  # fmt: skip
    """What tables take, by the visible voxels ``found``; the parameters are those of ``estimate``.

    Post-classified sheets keep more voxels than are visible; the estimate tells how many are visible.
    """
    if quality.classification != "post":
        return estimate_tables(found, PlannedTables(quality.record, axes, shaded), picture)
    near = min(round(TYPICAL_NEAR * found.count), math.prod(found.shape_xyz))
    needs = estimate_tables(found._replace(count=near), PlannedTables(axes=axes, lit=shaded), picture)
    return replace(needs, visible_voxels=found.count)


class SheetSides(NamedTuple):
    """Sheet pixels along each side."""

    width: int
    height: int


def likely_sides(shape_xyz, quality: Quality, width: int, height: int) -> SheetSides:
    """Of the sheets of a volume that fills a frame of so many pixels, seen along z."""
    density = quality.sheet_density
    return SheetSides(*((int(density * side) for side in (width, height)) if density else shape_xyz[:2]))
