"""DICOM SEG: segments of any kind as one label map with names and colors."""

import math

import numpy as np

from ...runtime.memory import bytes_text, refuse_beyond
from ...runtime.steps import Progress, map_steps, step_within
from ...scene import RleSplatError
from ...volume.volume import PATIENT, NamedLabel, Volume
from . import elements as read
from .grouping import collect_planes, has_geometry, parallel_parts
from .pictures import check_size, frame_steps
from .pixels import decode_planes
from .refusals import Refused, damage_error, no_positions
from .stacking import Stack, axes, common_orientation, places, sort_along, stack

LARGEST_LABEL = (1 << 16) - 1
D50_WHITE = np.array([0.9642, 1.0, 0.8251])  # of the profile connection space, in which DICOM gives colors
# XYZ under D50 to linear sRGB under D65, adapted by Bradford's method.
RGB_FROM_XYZ = np.array(
    [[3.1338561, -1.6168667, -0.4906146], [-0.9787684, 1.9161415, 0.0334540], [0.0719453, -0.2289914, 1.4052427]]
)


def read_segmentation_steps(found: read.Elements):
    """Generator of Progress: read a segmentation.

    Parameters
    ----------
    found : elements.Elements
        The parsed file.

    Returns
    -------
    Volume
        A label map in patient space; ``named_labels`` has the segments' numbers, names and colors. Where segments
        overlap, the highest number counts, so that the order in which frames are decoded does not matter. Slices
        between the file's, which hold no segment, are 0.

    Raises
    ------
    RleSplatError
        If the file is damaged, or does not say where its frames lie.
    """
    try:
        doing = Progress(0.0, f"Reading the header of {found.path.name}")
        steps = map_steps(step_within(_facts(found), read.quiet), lambda _: doing)
        pictures, segments, labels, threshold = yield from steps
        stacked, at = read.quietly(_stack, pictures, found)
    except read.problems():
        raise damage_error(found.path) from None
    check_size(pictures[0].storage)
    storage = pictures[0].storage
    highest = max([label.label for label in labels] + [s or 0 for s in segments])
    if highest > LARGEST_LABEL:
        raise damage_error(found.path)
    dtype = np.dtype(np.uint8 if highest < 256 and storage.allocated <= 8 else np.uint16)
    shape = (stacked.slices, storage.rows, storage.columns)
    what = f"{storage.columns} x {storage.rows} x {stacked.slices} labels"
    needed = math.prod(shape) * dtype.itemsize
    doing = f"Reading {what}, {bytes_text(needed)}"
    yield Progress(0.0, doing)
    refuse_beyond(needed, f"{what} need", "choose a smaller segmentation")
    merged, overlaps, done = np.zeros(shape, dtype), 0, 0
    for answer in decode_planes(pictures):
        if answer is not None:
            i, plane = answer
            for k in at[i]:
                overlaps += _put(merged[k], plane, segments[i], threshold)
            done += 1
        yield Progress(done / len(pictures), doing)
    remarks = []
    if stacked.kind == "irregular":
        remarks.append(
            "The segments' slices lie at irregular distances; each slice of the label map shows the nearest one."
        )
    if overlaps:
        remarks.append(f"Segments overlap in {overlaps} voxels, which show the segment with the highest number.")
    if threshold > 1:
        remarks.append("The segments are fractional; voxels with at least half of the largest value were taken.")
    return Volume(
        voxels=merged, affine=stacked.affine, unit="mm", modality="SEG", name="DICOM SEG", space=PATIENT,
        place_key=pictures[0].series.place, remarks=tuple(remarks), named_labels=labels,
    )  # fmt: skip


def _facts(found: read.Elements):
    """Generator: (pictures, number of the segment of each, labels, threshold) of a segmentation."""
    pictures = yield from frame_steps(found)
    return pictures, _segments(pictures, found), named_labels(found.dataset), _threshold(found)


def _segments(pictures, found: read.Elements) -> list:
    """The number of the segment of each frame; None for all in a label map."""
    if not found.frames:
        raise damage_error(found.path)
    if not all(has_geometry(picture) for picture in pictures):
        raise no_positions()
    if read.text(found.dataset, "SegmentationType") == "LABELMAP":
        return [None] * len(pictures)
    shared = read.item(found.dataset, "SharedFunctionalGroupsSequence")
    segments = []
    for frame in found.frames:
        own = read.item(frame, "SegmentIdentificationSequence") or read.item(shared, "SegmentIdentificationSequence")
        number = read.whole(own, "ReferencedSegmentNumber")
        if number is None or number < 1:
            raise damage_error(found.path)
        segments.append(number)
    return segments


def _threshold(found: read.Elements) -> int:
    """The stored value from which on a voxel belongs to a segment."""
    if read.text(found.dataset, "SegmentationType") != "FRACTIONAL":
        return 1
    return max(1, -(-(read.whole(found.dataset, "MaximumFractionalValue", 1) or 1) // 2))


def _put(target: np.ndarray, plane: np.ndarray, segment: int | None, threshold: int) -> int:
    """Write one frame into a slice of the label map, in place; returns the number of voxels that held another label."""
    labels = plane if segment is None else (plane >= threshold) * target.dtype.type(segment)
    both = np.count_nonzero((target != 0) & (labels != 0))
    np.maximum(target, labels.astype(target.dtype, copy=False), out=target)
    return int(both)


def _stack(pictures, found: read.Elements) -> tuple[Stack, list[list[int]]]:
    """Geometry of all frames, and for each frame the slices of the grid that it fills."""
    positions, orientations, spacings = collect_planes(pictures)
    if parallel_parts(pictures)[1:]:
        raise Refused(f"{found.path.name} holds segments in several directions; export each as a file of its own.")
    normal, positions = axes(common_orientation(orientations))[2], np.array(positions)
    order = sort_along(positions, normal)
    place = places(positions, normal)
    distinct = positions[order][np.unique(place[order], return_index=True)[1]]
    if len(distinct) == 1:
        distinct = np.stack([distinct[0], distinct[0] + normal * _thickness(found)])
    storage = pictures[0].storage
    stacked = stack(distinct, orientations, spacings, (storage.rows, storage.columns))
    nearest = stacked.below + (stacked.weight > 0.5)
    exact = stacked.weight == 0.0 if stacked.kind == "missing" else np.ones(stacked.slices, dtype=bool)
    return stacked, [np.flatnonzero((nearest == p) & exact).tolist() for p in place]


def _thickness(found: read.Elements) -> float:
    """Slice distance of a segmentation whose frames all lie at one place, in mm."""
    for group in (found.frames[0], read.item(found.dataset, "SharedFunctionalGroupsSequence")):
        measures = read.item(group, "PixelMeasuresSequence")
        for name in ("SpacingBetweenSlices", "SliceThickness"):
            value = read.number(measures, name)
            if value is not None and value > 0.0:
                return value
    raise RleSplatError(f"{found.path.name} is a single picture; labels need at least two slices.")


def named_labels(dataset) -> tuple[NamedLabel, ...]:
    """Numbers, names and colors of the segments of a dataset."""
    found = []
    for segment in read.items(dataset, "SegmentSequence"):
        number = read.whole(segment, "SegmentNumber")
        if number is None or number < 1:
            continue
        name = read.text(segment, "SegmentLabel") or f"Segment {number}"
        color = read.numbers(segment, "RecommendedDisplayCIELabValue", 3)
        found.append(NamedLabel(number, name, None if color is None else linear_rgb(color)))
    return tuple(found)


def linear_rgb(stored) -> tuple[float, float, float]:
    """Scene-linear RGB of a color as DICOM stores it.

    DICOM PS3.3, section C.10.7.1.1: L* is 0 to 100 and a*, b* are -128 to 127 for 0 to 65535.

    Parameters
    ----------
    stored : (3,) array_like
        CIELab under D50, scaled to 16 bits.
    """
    scaled = np.asarray(stored, dtype=np.float64) / 65535.0
    lightness, a, b = 100.0 * scaled[0], 255.0 * scaled[1] - 128.0, 255.0 * scaled[2] - 128.0
    y = (lightness + 16.0) / 116.0
    roots = np.array([y + a / 500.0, y, y - b / 200.0])
    linear = np.where(roots > 6.0 / 29.0, roots**3, 3.0 * (6.0 / 29.0) ** 2 * (roots - 4.0 / 29.0))
    return tuple(float(c) for c in np.clip(RGB_FROM_XYZ @ (linear * D50_WHITE), 0.0, 1.0))
