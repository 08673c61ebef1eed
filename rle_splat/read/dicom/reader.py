"""Reading a DICOM series as a volume, slice by slice into the final array."""

import math
from itertools import islice
from pathlib import Path

import numpy as np

from ...runtime.memory import bytes_text, refuse_beyond
from ...runtime.steps import Progress, rescale
from ...scene import RleSplatError
from ...volume.volume import PATIENT, Volume
from ..header import check_frame, frame_remark
from . import elements
from .discovery import FoundPictures, find_pictures
from .grouping import ENOUGH_SLICES, Group, choose_group, groups_of, has_geometry
from .pictures import check_size
from .pixels import decode_planes, voxel_hash
from .refusals import contours_alone, damage_error
from .segmentation import read_segmentation_steps
from .stacking import Stack
from .structures import read_structures_steps
from .suv import UNIT as SUV
from .suv import suv_factor
from .titles import group_title, volume_name
from .values import (
    blend,
    common_dtype,
    common_mapping,
    lower_padding,
    lowest_real,
    padding_of,
    physical,
)  # fmt: skip

FILES_LOOKED_AT = 2000  # 0.1 s; before reading begins nothing can be canceled
TOLD_MM = 0.01  # slices that were moved by more are reported
HEADERS = 0.2  # share of the time that finding pictures takes


def recognizes_dicom(head) -> bool:
    """Whether a file is DICOM, from its ``format.Head``."""
    return elements.is_dicom_head(head.stored)


def reads_dicom_folder(path) -> bool:
    """Whether a folder holds a DICOM file, in it or in its folders, among the first FILES_LOOKED_AT."""
    for file in islice(Path(path).rglob("*"), FILES_LOOKED_AT):
        try:
            if file.is_file() and elements.is_dicom(file):
                return True
        except OSError:
            continue
    return False


def groups_in(found: FoundPictures) -> list[Group]:
    """The groups of the pictures that were found."""
    hashes = {}

    def same_voxels(a, b) -> bool:
        for picture in (a, b):
            if id(picture) not in hashes:
                hashes[id(picture)] = voxel_hash(picture)
        return hashes[id(a)] == hashes[id(b)] != ""

    return groups_of(found.pictures, same_voxels)


def read_dicom_steps(path, series=None, frame=None, spacing=None, series_key=None, scan=None):
    """Generator of Progress: read a DICOM series.

    Parameters
    ----------
    path : str or Path
        A folder, a DICOMDIR, a multi-frame file, or any one file of a series. A segmentation (DICOM SEG) is read as a
        label map.
    series : int or None
        Number of the series, from 1, where there are several.
    frame : int or None
        Number of the frame, from 1, of a series in time.
    spacing : (sx, sy, sz) or None
        Distances between voxels in mm, for files that do not say where they lie.
    series_key : str or None
        ``Volume.series`` of a series that was read before, to be found again; see ``grouping.choose_group``.
    scan : Volume or None
        On whose grid an RTSTRUCT is read as a label map; without it such a file is refused.

    Returns
    -------
    Volume
        In patient space (LPS millimeters) if the files say where they lie. Stored integers are kept, with one slope
        and intercept; where these differ between slices, the values become float32.

    Raises
    ------
    RleSplatError
        If the path holds no volume, or several and none is chosen.
    """
    found = yield from rescale(find_pictures(path), 0.0, HEADERS)
    if found.segmentation is not None:
        if (series, frame, spacing) != (None, None, None):
            raise RleSplatError(f"{Path(path).name} is a segmentation; leave out series, time point and spacing.")
        return (yield from rescale(read_segmentation_steps(found.segmentation), HEADERS, 1.0))
    if found.structures:
        if scan is None:
            raise contours_alone(path)
        return (yield from rescale(read_structures_steps(Path(path), scan), HEADERS, 1.0))
    groups = groups_in(found)
    group = choose_group(groups, series, group_title, series_key)
    number = check_frame(path, frame, len(group.frames))
    stack = group.stack(number - 1, spacing)
    pictures = group.frames[number - 1]
    if found.broken and stack.kind != "even":  # a damaged file may well be one of the slices that are missing
        raise damage_error(found.broken[0])
    for storage in {picture.storage.path: picture.storage for picture in pictures}.values():
        check_size(storage)
    mapping = common_mapping(pictures)
    voxels, padded = yield from rescale(_voxel_steps(pictures, stack, mapping), HEADERS, 1.0)
    slope, intercept = mapping or (1.0, 0.0)
    first, unit, reason = pictures[0], pictures[0].series.value_unit, ""
    if first.series.pet is not None and unit != SUV:
        factor, reason = suv_factor([picture.series.pet for picture in pictures])
        slope, intercept, unit = factor * slope, factor * intercept, unit if reason else SUV
    return Volume(
        voxels=voxels, affine=stack.affine, unit="mm", slope=slope, intercept=intercept,
        value_unit=unit, modality=first.series.modality or None, name=volume_name(group),
        space=PATIENT if has_geometry(first) else None, frames=len(group.frames), frame_axis=group.axis or "time",
        series=first.series.key, place_key=first.series.place,
        remarks=(
            *_files_left_out(found, first.series.key),
            *_slices_left_out(groups, group, named=bool(series or series_key)),
            *group.remarks, *_remarks(group, stack, mapping, padded),
            *((f"The values are not SUV, because {reason}; the stored values are used.",) if reason else ()),
            *frame_remark(number, len(group.frames), group.axis),
        ),
    )  # fmt: skip


def _voxel_steps(pictures, stack: Stack, mapping):
    """Generator of Progress: the voxels (slices, rows, columns) of a stack, and how many padding voxels were lowered.

    The files' slices are read into the end of the final array, and missing ones are then interpolated from its begin
    on, so that no second array is needed.
    """
    storage = pictures[0].storage
    dtype = common_dtype(pictures) if mapping else np.dtype(np.float32)
    shape = (stack.slices, storage.rows, storage.columns)
    needed = math.prod(shape) * dtype.itemsize
    what = f"{storage.columns} x {storage.rows} x {stack.slices} voxels"
    yield Progress(0.0, f"Reading {what}, {bytes_text(needed)}")
    refuse_beyond(needed, f"{what} need", "choose a smaller series")
    voxels = np.empty(shape, dtype=dtype)
    # In place only where no slice of the grid is written before the file's slices that later ones need have been used
    apart = not np.all(np.arange(stack.slices) <= stack.slices - len(pictures) + stack.below)
    if apart:
        refuse_beyond(2 * needed, f"{what} with irregular distances need", "choose a smaller series")
    read = np.empty((len(pictures), *shape[1:]), dtype=dtype) if apart else voxels[stack.slices - len(pictures) :]
    padded = yield from rescale(_decode_steps(pictures, read, mapping), 0.0, 0.9, f"Reading {what}")
    for k in range(stack.slices if stack.kind != "even" else 0):
        j, weight = int(stack.below[k]), float(stack.weight[k])
        voxels[k] = blend(read[j], read[j + 1], weight) if weight > 0.0 else read[j]
        yield Progress(0.9 + 0.1 * k / stack.slices, "Filling missing slices")
    return voxels, padded


def _decode_steps(pictures, target: np.ndarray, mapping):
    """Generator of Progress: decode pictures into ``target``; returns how many padding voxels were lowered."""
    done, lowest, paddings = 0, None, {}
    has_padding = any(padding_of(picture) is not None for picture in pictures)
    for answer in decode_planes(pictures):
        yield Progress(done / len(pictures), "")
        if answer is None:
            continue
        i, plane = answer
        picture = pictures[i]
        padding = padding_of(picture)
        if mapping is None:
            plane = physical(plane, picture)
            if padding is not None:
                ends = physical(np.array(padding), picture)
                padding = (ends.min(), ends.max())
        target[i] = plane
        if padding is not None:
            paddings[i] = padding
        if has_padding:
            here = lowest_real(plane, padding)
            lowest = here if lowest is None or (here is not None and here < lowest) else lowest
        done += 1
    lowered = 0
    for i, padding in paddings.items() if lowest is not None else ():
        if padding[1] > lowest:
            lowered += lower_padding(target[i], padding, lowest)
            yield Progress(1.0, "")
    return lowered


def _say_how_many(count: int, noun: str, rest: str = "") -> str:
    """Such as "1 file was" or "2 files were"; ``rest`` stands before the verb."""
    return f"{count} {noun}{'' if count == 1 else 's'}{rest} {'was' if count == 1 else 'were'}"


def _files_left_out(found: FoundPictures, key: str) -> list[str]:
    """Remarks on files that were not read and may hold slices of the series ``key``."""
    remarks = []
    if found.broken:
        names = ", ".join(found.broken[:3]) + (" and others" if len(found.broken) > 3 else "")
        remarks.append(f"{_say_how_many(len(found.broken), 'damaged DICOM file')} left out: {names}.")
    if found.absent:
        remarks.append(f"The DICOMDIR lists files that are not there ({found.absent}), so slices may be missing.")
    refused = [problem for problem in found.refused if problem.series == key]
    if refused:
        remarks.append(f"{_say_how_many(len(refused), 'file', ' of this series')} left out: {refused[0]}")
    return remarks


def _slices_left_out(groups, group: Group, named: bool) -> list[str]:
    """Remarks on groups that were not taken and are no localizers; ``named``: whether this one was asked for."""
    others = [other for other in groups if other is not group and not other.localizer]
    own = [other for other in others if other.first.series.key == group.first.series.key]
    odd = [other for other in own if other.slices < ENOUGH_SLICES]
    further = 0 if named else len(others) - len(odd)
    remarks = []
    if odd:
        count = sum(len(frame) for other in odd for frame in other.frames)
        remarks.append(
            f"{_say_how_many(count, 'slice', ' of this series')} left out: size, direction, spacing or place differs. "
            "The volume is interpolated or ends there."
        )
    if further:
        were = "was" if further == 1 else "were"
        fewer = f"with fewer than {ENOUGH_SLICES} slices"
        remarks.append(f"{further} other series {fewer} {were} left out; choose one by its number (series).")
    return remarks


def _remarks(group: Group, stack: Stack, mapping, padded: int) -> tuple:
    """Sentences about what is odd."""
    series, found = group.first.series, []
    if stack.kind == "missing":
        numbers = [str(k + 1) for k in stack.filled]
        names = ", ".join(numbers[:8]) + (" and others" if len(numbers) > 8 else "")
        missing = "1 slice is missing and was" if len(numbers) == 1 else f"{len(numbers)} slices are missing and were"
        found.append(f"{missing} interpolated: number {names} of {stack.slices}.")
    elif stack.kind == "irregular":
        found.append(
            f"The {group.slices} slices lie at irregular distances and were resampled to {stack.slices} slices, "
            f"{np.linalg.norm(stack.affine[:3, 2]):.4g} mm apart."
        )
    if stack.moved > TOLD_MM:
        found.append(f"Slices are up to {stack.moved:.3f} mm off the even, parallel stack that they were put into.")
    if not has_geometry(group.first):
        found.append("The files do not say where the slices lie; their order is that of their numbers.")
    if series.table is not None:
        found.append("The files hold a table of values (Modality LUT), which was applied; the values became float32.")
    elif mapping is None:
        found.append("Slices have different scales of values; the values were converted to float32.")
    if series.odd_values and series.table is None:
        found.append("The files hold a damaged table of values (Modality LUT), which is not applied.")
    if series.inverted:
        found.append("Low values are meant to be shown bright (MONOCHROME1); the values are unchanged.")
    if padded:
        found.append(f"{padded} voxels outside the scan were set to its lowest value.")
    return tuple(found)
