"""Estimate the memory of a picture from a few planes of a volume, or from its histogram.

``sheet_kind`` decides once what a classification makes of a volume: its tables and their memory.  No kernels are loaded
here: what only looks at a file does not wait for a compiler.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from ..classify.sizes import TYPICAL_NEAR, TYPICAL_PIECE
from ..scene import Quality
from ..volume.counts import counts_values, stored_values
from .memory_estimate import Found, MemoryEstimate, estimate_classified, estimate_scalars

SAMPLED_PLANES = 32  # at most, and of large planes fewer
SAMPLED_VOXELS, LEAST_PLANES = 1 << 24, 4


@dataclass(frozen=True)
class ClassifiedSheets:
    """Sheets of voxels that are classified before they are splatted.

    Attributes
    ----------
    record : int
        Bytes of a voxel record.
    """

    record: int

    scalar_sheets: ClassVar[bool] = False  # whether sheets hold the scalar; the medium then fills the box by itself
    traces_rays: ClassVar[bool] = False  # whether single rays can go through the medium

    def estimate(self, found: Found, axes: int, shaded: bool, picture: int) -> MemoryEstimate:
        """What the tables take; ``found``: the visible voxels."""
        return estimate_classified(found, self.record, axes, shaded, picture)


@dataclass(frozen=True)
class ScalarSheets(ClassifiedSheets):
    """Sheets of the scalar, classified after interpolation."""

    scalar_sheets: ClassVar[bool] = True
    traces_rays: ClassVar[bool] = True

    def estimate(self, found: Found, axes: int, shaded: bool, picture: int) -> MemoryEstimate:
        """As of ClassifiedSheets.  More voxels are kept than are visible; the estimate tells how many are visible."""
        near = min(round(TYPICAL_NEAR * found.count), math.prod(found.shape_xyz))
        needs = estimate_scalars(found._replace(count=near), axes, shaded, picture)
        return replace(needs, visible_voxels=found.count)


def sheet_kind(quality: Quality) -> ClassifiedSheets:
    """What the sheets of a quality are made of, for whoever has no voxels to choose a source for."""
    return (ScalarSheets if quality.classification == "post" else ClassifiedSheets)(quality.record)


def estimate(
    volume, tf, quality: Quality | None = None, *, axes: int = 1, shaded: bool | None = None, picture: int = 0
) -> MemoryEstimate:
    """What tables of a volume take, quickly: visible voxels are counted for 8- and 16-bit volumes, else, and for the
    number of runs, in a few planes.

    Parameters
    ----------
    volume : Volume
    tf : TransferFunction
    quality : Quality, optional
        By default, that of pre-classified voxels.
    axes : int
        How many principal axes are held, mostly one.
    shaded : bool, optional
        Whether something shines; by default, as the transfer function has it.
    picture : int
        See ``memory_estimate.picture_bytes``.

    Returns
    -------
    MemoryEstimate
    """
    quality = quality or Quality(classification="pre")
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
        values = volume.physical(stored_values(volume.voxels.dtype))
        count = int(volume.value_counts[tf.alpha_at(values) > 0.0].sum())
    shaded = tf.shade is not None if shaded is None else shaded
    found = Found(volume.shape_xyz, volume.voxels.dtype, count, pieces, lines, volume.voxels.nbytes)
    return sheet_kind(quality).estimate(found, axes, shaded, picture)


def estimate_from_histogram(
    shape_xyz, dtype, values, counts, tf, quality: Quality, *, shaded: bool = True, picture: int = 0
) -> MemoryEstimate:
    """As ``estimate`` for one principal axis, roughly, without the voxels.

    Parameters
    ----------
    shape_xyz : (nx, ny, nz)
    dtype : dtype
        Of the volume's voxels.
    values, counts : (n,) ndarray
        Physical values, and how many voxels have each.
    tf : TransferFunction
    quality : Quality
    shaded : bool
        Whether something shines.
    picture : int
        See ``memory_estimate.picture_bytes``.

    Returns
    -------
    MemoryEstimate
    """
    _, ny, nz = shape_xyz
    count = int(counts[tf.alpha_at(values) > 0.0].sum())
    pieces, dtype = count // TYPICAL_PIECE, np.dtype(dtype)
    held = math.prod(shape_xyz) * dtype.itemsize
    found = Found(tuple(shape_xyz), dtype, count, pieces, min(pieces, ny * nz), held)
    return sheet_kind(quality).estimate(found, 1, shaded, picture)


class SheetSides(NamedTuple):
    """Sheet pixels along each side."""

    width: int
    height: int


def likely_sides(shape_xyz, quality: Quality, width: int, height: int) -> SheetSides:
    """Of the sheets of a volume that fills a frame of so many pixels, seen along z."""
    density = quality.sheet_density
    return SheetSides(*((int(density * side) for side in (width, height)) if density else shape_xyz[:2]))
