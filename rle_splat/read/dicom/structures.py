"""DICOM RTSTRUCT: closed contours of regions as a label map on the grid of the scan that they were drawn on."""

import math
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from ...runtime.memory import bytes_text, refuse_beyond
from ...runtime.steps import Progress, drain, map_steps, step_within
from ...scene import RleSplatError
from ...scene.color import linear
from ...volume.regrid import on_grid_steps
from ...volume.volume import PATIENT, NamedLabel, Volume
from . import elements as read
from .contours import fill_slices
from .pictures import hash_text
from .refusals import Refused, damage_error
from .segmentation import LARGEST_LABEL

CLOSED = ("CLOSED_PLANAR", "CLOSEDPLANAR_XOR")
FLAT = 0.1  # slices; contours whose points are further from one slice are turned against the grid
OFF_PLANE = 0.5  # of the distance of planes; points further from their contour's plane are an error
FEWEST_POINTS = 3


@dataclass(frozen=True)
class _Region:
    """A region of interest: ``contours`` are (n, 3) arrays of LPS millimeters; ``place``: hash of its frame."""

    number: int
    name: str
    color: tuple | None
    place: str
    contours: tuple


def read_structures_steps(path, volume: Volume):
    """Generator of Progress: read the contours of an RTSTRUCT as a label map.

    Parameters
    ----------
    path : str or Path
    volume : Volume
        The scan; the labels have its grid.

    Returns
    -------
    Volume
        Numbers, names and colors in ``named_labels`` are those of the regions. Contours of one region in one plane
        fill even-odd, so that inner ones are holes. Slices between planes are interpolated. Where regions overlap, the
        highest number counts.

    Raises
    ------
    RleSplatError
        If the file is damaged, holds no closed contours, or belongs to another frame of reference or place.
    """
    doing = Progress(0.0, f"Reading the contours of {path.name}")
    skipped = Counter()
    try:
        found = yield from map_steps(read.read_elements(path, contours=True), lambda _: doing)
        regions = yield from map_steps(step_within(_regions(found, skipped), read.quiet), lambda _: doing)
    except read.problems():
        raise damage_error(path) from None
    if volume.space != PATIENT:
        raise Refused(
            f"{path.name} holds contours in the coordinates of the patient, and the volume does not say how it lies in "
            "the patient; choose the series of images itself."
        )
    if not regions:
        raise Refused(f"{path.name} holds no closed contours{_list_skipped(skipped)}; export the regions as contours.")
    here = [region for region in regions if not (region.place and volume.place_key) or region.place == volume.place_key]
    if not here:
        raise Refused(
            f"The contours of {path.name} belong to another frame of reference than the scan; choose the file of this "
            "scan."
        )
    skipped["regions of another frame of reference"] = len(regions) - len(here)
    highest = max(region.number for region in here)
    dtype = np.dtype(np.uint8 if highest < 256 else np.uint16)
    needed = volume.voxels.size * dtype.itemsize
    refuse_beyond(needed, f"Labels of {bytes_text(needed)} need")
    merged, overlaps, interpolated, labels = np.zeros(volume.voxels.shape, dtype), 0, 0, []
    for number, region in enumerate(here):
        voxels = 0
        for k, mask, crossing, between in _fill_region(region, volume, skipped):
            voxels += np.count_nonzero(mask)
            overlaps += np.count_nonzero(merged[k][mask])
            merged[k][mask] = region.number
            interpolated += between
            skipped["contours that cross and are filled even-odd"] += crossing
            yield Progress(number / len(here), f"Filling contours ({number + 1} of {len(here)} regions)")
        if voxels:
            labels.append(NamedLabel(region.number, region.name, region.color))
        skipped["regions without a voxel in the scan"] += not voxels
    if not labels:
        raise RleSplatError(f"No contour of {path.name} lies within the scan; choose the file of this scan.")
    remarks = [f"{path.name} holds {what} ({count})." for what, count in skipped.items() if count]
    if interpolated:
        remarks.append(f"Slices of regions that lie between contours were interpolated ({interpolated}).")
    if overlaps:
        remarks.append(f"Regions overlap in {overlaps} voxels, which show the region with the highest number.")
    return Volume(
        voxels=merged, affine=volume.affine, unit="mm", modality="RTSTRUCT", name="DICOM RTSTRUCT", space=PATIENT,
        place_key=volume.place_key, remarks=tuple(remarks), named_labels=tuple(labels),
    )  # fmt: skip


def _list_skipped(skipped: Counter) -> str:
    """Such as ", only points (2) and open contours (1)"."""
    found = " and ".join(f"{what} ({count})" for what, count in skipped.items() if count)
    return f", only {found}" if found else ""


def _regions(found: read.Elements, skipped: Counter):
    """Generator: the regions that have closed contours, by number; ``skipped`` counts what else there is."""
    described = {read.whole(item, "ROINumber"): item for item in read.items(found.dataset, "StructureSetROISequence")}
    regions = {}
    for item in found.frames:
        number = read.whole(item, "ReferencedROINumber")
        own = described.get(number)
        contours = []
        for contour in read.items(item, "ContourSequence"):
            points, problem = _points(contour)
            if problem:
                skipped[problem] += 1
            else:
                contours.append(points)
            yield None
        color = read.numbers(item, "ROIDisplayColor", 3)
        if number is not None and contours:
            regions[number] = _Region(
                number, read.text(own, "ROIName") or f"Region {number}",
                None if color is None else linear([min(max(c, 0.0), 255.0) / 255.0 for c in color]),
                hash_text(read.text(own, "ReferencedFrameOfReferenceUID")), tuple(contours),
            )  # fmt: skip
    ordered = [regions[number] for number in sorted(regions)]
    if ordered and (ordered[0].number < 1 or ordered[-1].number > LARGEST_LABEL):
        ordered = [replace(region, number=i) for i, region in enumerate(ordered, 1)]
    return ordered


def _points(contour) -> tuple[np.ndarray | None, str]:
    """The points (n, 3) of a closed contour and "", or None and what it is instead."""
    kind = read.text(contour, "ContourGeometricType")
    if kind not in CLOSED:
        return None, "points" if kind == "POINT" else "open contours"
    values = read.decimals(contour, "ContourData")
    if values is None or len(values) % 3:
        return None, "damaged contours"
    points = values.reshape(-1, 3)
    points = points[np.any(points != np.roll(points, 1, axis=0), axis=1)]
    return (points, "") if len(points) >= FEWEST_POINTS else (None, "contours of fewer than 3 points")


def _fill_region(region: _Region, volume: Volume, skipped: Counter):
    """Generator, as ``contours.fill_slices``, for a region on the grid of a volume."""
    contours = [_to_grid(points, volume.affine) for points in region.contours]
    if all(np.ptp(points[:, 2]) <= 2.0 * FLAT for points in contours):
        yield from _fill_flat(contours, volume.voxels.shape, volume.spacing)
        return
    affine, shape = _own_grid(region.contours, volume.spacing)
    contours = [_to_grid(points, affine) for points in region.contours]
    flat = [points for points in contours if np.ptp(points[:, 2]) <= 2.0 * OFF_PLANE]
    skipped["contours that do not lie in one plane"] += len(contours) - len(flat)
    if not flat:
        return
    needed = math.prod(shape)
    refuse_beyond(needed, "Contours across the slices need", "export them in the planes of the slices")
    own, crossing = np.zeros(shape, np.uint8), 0
    for k, mask, found, _ in _fill_flat(flat, shape, np.linalg.norm(affine[:3, :3], axis=0)):
        own[k] = mask
        crossing += found
    try:
        placed = drain(on_grid_steps(Volume(own, affine, space=PATIENT), volume)).voxels != 0
    except RleSplatError:  # it lies outside
        return
    for k in np.flatnonzero(placed.any(axis=(1, 2))).tolist():
        yield k, placed[k], crossing, False
        crossing = 0


def _to_grid(points: np.ndarray, affine: np.ndarray) -> np.ndarray:
    """Millimeters (n, 3) as voxel indices."""
    return np.linalg.solve(affine[:3, :3], (points - affine[:3, 3]).T).T


def _fill_flat(contours, shape, spacing):
    """``contours.fill_slices`` for contours (n, 3) in slices of a grid."""
    places = np.array([points[:, 2].mean() for points in contours])
    return fill_slices([points[:, :2] for points in contours], places, shape, tuple(spacing[:2]))


def _own_grid(contours, spacing) -> tuple[np.ndarray, tuple]:
    """Affine and shape (slices, rows, columns) of a grid whose slices are the planes of contours (n, 3)."""
    ends = [(points - points[0], np.roll(points - points[0], -1, axis=0)) for points in contours]
    normals = np.array([np.cross(begin, end).sum(axis=0) for begin, end in ends])  # twice the areas, as vectors
    normal = normals[np.linalg.norm(normals, axis=1).argmax()]
    normal = normal / (np.linalg.norm(normal) or 1.0)
    row = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    row /= np.linalg.norm(row)
    turn = np.stack([row, np.cross(normal, row), normal], axis=1)
    step = float(np.min(spacing))
    depths = np.sort([points.mean(axis=0) @ normal for points in contours])
    gaps = np.diff(depths)
    gaps = gaps[gaps > OFF_PLANE * step]
    steps = np.array([step, step, float(np.median(gaps)) if gaps.size else step])
    local = np.concatenate(contours) @ turn / steps
    low = np.append(np.floor(local[:, :2].min(axis=0)) - 1.0, depths[0] / steps[2])
    high = np.append(np.ceil(local[:, :2].max(axis=0)) + 1.0, depths[-1] / steps[2])
    affine = np.eye(4)
    affine[:3, :3] = turn * steps
    affine[:3, 3] = affine[:3, :3] @ low
    return affine, tuple((np.ceil(high - low).astype(int) + 1).tolist()[::-1])
