"""Facts, histogram and memory estimate of a volume, stored on its object so that panels need no voxels."""

import json
import math
import os
from dataclasses import dataclass

import numpy as np

from ...rle_splat.pipeline.memory_estimate import MemoryEstimate, picture_bytes
from ...rle_splat.pipeline.quick_estimate import count_in_histogram, estimate_visible, likely_sides
from ...rle_splat.runtime.memory import bytes_text
from ...rle_splat.scene import NO_RAYS
from ...rle_splat.splat.scratch import scratch_bytes
from ...rle_splat.view.depth_rules import Sheets, place_sheets
from ...rle_splat.view.footprints import FOOTPRINTS
from ...rle_splat.volume.axes import AXIS_NAMES
from ...rle_splat.volume.orientation import short_orientation_text
from ...rle_splat.volume.volume import PATIENT
from ..translations import filled
from . import encoded

BINS = 256


def write_facts(volume_object, volume, counted) -> None:
    """Store a volume's facts, remarks, value range, units and histogram on its object.

    Parameters
    ----------
    counted : Histogram or None
        Of its values, with BINS bins; None of encoded voxels.
    """
    properties = volume_object.rle_splat
    properties.length_unit = volume.unit
    properties.found_spacing = volume.spacing
    properties.space = volume.space or ""
    properties.remarks = "\n".join(volume.remarks)
    properties.facts = "\n".join(fact_lines(volume, os.path.basename(properties.filepath.replace("\\", "/"))))
    if not volume.holds_values:
        properties.stored_transfer, properties.histogram = json.dumps(volume.transfer_function), ""
        function = encoded.transfer_of(volume_object)
        properties.transfer_name = function.name
        properties.transfer_unit = properties.value_unit = function.unit or ""
        properties.value_low, properties.value_high = function.span
        return
    properties.stored_transfer = ""
    properties.value_low, properties.value_high = volume.value_range
    properties.value_unit = volume.value_unit or ""
    properties.histogram = json.dumps({
        "edges": [float(counted.edges[0]), float(counted.edges[-1])], "counts": counted.counts.tolist(),
        "shape": list(volume.shape_xyz), "dtype": volume.voxels.dtype.name,
    })  # fmt: skip


def fact_lines(volume, file_name: str) -> list[str]:
    """Lines "Name: value" on a volume's file, or folder, without where it is, and on its grid, size and values."""
    unit = volume.unit
    extent = (np.array(volume.shape_xyz) - 1) * volume.spacing
    before, behind = _of_values(volume) if volume.holds_values else _of_tables(volume)
    oriented = [f"Orientation: {short_orientation_text(volume.affine)}"] if volume.space == PATIENT else []
    place = [f"Spacing: {_by(volume.spacing)} {unit}", f"Extent: {_by(extent)} {unit}"]
    return [f"File: {file_name}", *before, *oriented, *place, *behind]


def _of_values(volume) -> tuple[list[str], list[str]]:
    """Lines on the grid and the values of a Volume, before and behind those on its place."""
    low, high = volume.value_range
    value_unit = f" {volume.value_unit}" if volume.value_unit else ""
    lines = [f"Voxels: {_by(volume.shape_xyz)}, {volume.voxels.dtype.name}"]
    if volume.modality:
        lines.insert(0, f"Modality: {volume.modality}")
    if volume.frames > 1:
        lines.append(f"{'Time Points' if volume.frame_axis == 'time' else 'Volumes'}: {volume.frames}")
    return lines, [f"Values: {low:.6g} to {high:.6g}{value_unit}", f"In Memory: {bytes_text(volume.voxels.nbytes)}"]


def _of_tables(volume) -> tuple[list[str], list[str]]:
    """Lines on encoded voxels, as ``_of_values``."""
    share = volume.visible_voxels / math.prod(volume.shape_xyz)
    lines = [f"Encoded: {volume.classification}-classified", f"Voxels: {_by(volume.shape_xyz)}, {share:.1%} stored"]
    return lines, [f"Axes: {', '.join(AXIS_NAMES[axis] for axis in volume.principal_axes)}"]


def _by(numbers) -> str:
    return " × ".join(f"{n:.6g}" for n in numbers)


@dataclass(frozen=True)
class StoredHistogram:
    """A histogram with equal bins, as stored on an object.

    Attributes
    ----------
    counts : ndarray, shape (n,), int64
        Voxels in each bin.
    low, high : float
        Physical values at the outer edges of the first and the last bin.
    shape_xyz : tuple of int or None
        Number of voxels along x, y and z; None in files of earlier versions.
    dtype : str or None
        Stored type of a voxel; None in files of earlier versions.
    """

    counts: np.ndarray
    low: float
    high: float
    shape_xyz: tuple | None = None
    dtype: str | None = None

    @property
    def centers(self) -> np.ndarray:
        """(n,) float64: the value at the center of each bin."""
        return self.low + (self.high - self.low) * (np.arange(len(self.counts)) + 0.5) / len(self.counts)


def stored_histogram(properties) -> StoredHistogram | None:
    """The histogram stored on an object; None before an import stored one, and for one that is damaged."""
    if not properties.histogram:
        return None
    try:
        kept = json.loads(properties.histogram)
        return StoredHistogram(
            np.array(kept["counts"], dtype=np.int64), *kept["edges"], kept.get("shape"), kept.get("dtype")
        )
    except (ValueError, TypeError, LookupError, AttributeError):
        return None


def histogram_problem(properties) -> str:
    """What a panel says of a histogram that is damaged; "" for any other."""
    if not properties.histogram or stored_histogram(properties) is not None:
        return ""
    return filled("The histogram saved in this file is damaged; click Reload in the File panel.")


@dataclass(frozen=True)
class _LikelyPlane:
    """The fields of a base plane that its memory depends on, for a volume that fills the frame, viewed along z."""

    width: int
    height: int
    scale: np.ndarray
    sheets: Sheets
    axis: int = 2

    @classmethod
    def of(cls, shape_xyz, quality, width: int, height: int):
        nx, ny, nz = shape_xyz
        sides = likely_sides(shape_xyz, quality, width, height)
        scalars = quality.classification == "post"
        sheets = place_sheets(nz, 1, quality.depth_rule, None, FOOTPRINTS[quality.kernel], scalars)
        scale = np.array([[max(sides[0], 1) / nx, max(sides[1], 1) / ny]])
        return cls(*sides, scale, sheets)


def picture_memory(properties, transfer_function, quality, width: int, height: int, meshes: bool = False) -> str:
    """Estimate the memory of a picture, beside the voxels, from the stored histogram alone.

    Parameters
    ----------
    meshes : bool
        Whether meshes may occlude the volume, which needs their depths.

    Returns
    -------
    str
        One sentence without a period; "" without a stored histogram.  A preset may take single rays where its scene
        has hard walls, which only the voxels tell, so both are named.
    """
    counted = stored_histogram(properties)
    if counted is None or counted.dtype is None:
        return ""
    shape, scalars, shaded = counted.shape_xyz, quality.classification == "post", transfer_function.shade is not None
    plane = _LikelyPlane.of(shape, quality, width, height)
    found = count_in_histogram(shape, counted.dtype, counted.centers, counted.counts, transfer_function)

    def wanted(meshes: bool = False, traced: bool = quality.rays > 0.0) -> MemoryEstimate:
        scratch = scratch_bytes(plane, shape, quality, scalars, meshes)
        picture = picture_bytes(
            (plane,),
            width,
            height,
            quality,
            shortened=meshes,
            meshes=meshes,
            scratch=scratch,
            traced=traced and not meshes,
        )  # single rays are not used with meshes
        return estimate_visible(found, quality, shaded=shaded, picture=picture)

    alone, others = wanted(), []
    if quality.is_preset and scalars and quality.rays == NO_RAYS:
        others.append(filled("{memory} with exact pixels", memory=bytes_text(wanted(traced=True).needed)))
    if meshes:
        others.append(filled("{memory} among meshes", memory=bytes_text(wanted(meshes=True).needed)))
    beside = f" ({', '.join(others)})" if others else ""
    return filled(
        "Memory: about {memory}. {share} of the voxels are visible", memory=f"{bytes_text(alone.needed)}{beside}",
        share=f"{alone.visible_fraction:.1%}")  # fmt: skip
