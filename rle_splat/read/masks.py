"""A folder of masks, NIfTI files of one organ each as TotalSegmentator writes them, as one label map."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..runtime.steps import Progress, rescale
from ..scene import RleSplatError
from ..volume.regrid import on_grid_steps
from ..volume.volume import NamedLabel, Volume
from .nifti import read_nifti_steps
from .streaming import allocate, plain_name

SUFFIXES = (".nii", ".nii.gz")
MOST_MASKS = 1000


def _masks(path: Path) -> list[Path]:
    """The NIfTI files of a folder, by name."""
    return sorted(file for file in Path(path).iterdir() if file.name.lower().endswith(SUFFIXES) and file.is_file())


def reads_mask_folder(path: Path) -> bool:
    """Whether a folder holds at least two NIfTI files; its other files, such as statistics, do not matter."""
    return len(_masks(path)) >= 2


def read_masks_steps(path: str | Path):
    """Generator of Progress: read a folder of masks; return a label map.

    Returns
    -------
    Volume
        uint8 or uint16. The masks in the order of their names are the labels 1, 2, ...; empty ones have no name in
        ``named_labels``. A file of several values that its header names is a mask of each of them. Where masks overlap,
        the last one counts, and a remark tells how many voxels overlap.

    Raises
    ------
    RleSplatError
        If a file cannot be read, or is no mask.
    """
    path = Path(path)
    files = _masks(path)
    if len(files) > MOST_MASKS:
        raise RleSplatError(f"{path.name} holds {len(files)} files; at most {MOST_MASKS} masks can be read.")
    first = merged = None
    labels, overlaps, most = [], 0, 0
    for place, file in enumerate(files, start=1):
        span = (place - 1) / len(files), place / len(files)
        doing = f"reading {path.name} ({place} of {len(files)} masks)"
        mask = yield from rescale(read_nifti_steps(file), *span, doing)
        if first is None or merged is None:
            first, merged = mask, allocate(path, mask.shape_xyz, np.uint8)
            merged[...] = 0
        own, values = {one.label: one for one in mask.named_labels if one.label != 0}, set()
        for plane in mask.voxels:
            values |= _values_of(plane)
            if len(values) > 1 and not values <= own.keys():  # a scan: seen in its first plane
                raise _no_masks(path, len(files))
        # A file of one value is named as the file, whatever table of labels its header has.
        named = {value: NamedLabel(0, plain_name(file)) for value in values} if len(values) == 1 else own
        rows = {value: replace(one, label=most + number) for number, (value, one) in enumerate(named.items(), start=1)}
        most += max(len(rows), 1)
        if most > np.iinfo(merged.dtype).max:
            merged = merged.astype(np.uint16)
        mask = yield from on_grid_steps(mask, first)
        if mask.voxels.shape != merged.shape:
            raise _no_masks(path, len(files))
        counted = set()
        for z, plane in enumerate(mask.voxels):
            overlaps += int(np.count_nonzero(merged[z][plane != 0]))
            for value in _values_of(plane):
                merged[z][plane == value] = rows[value].label
                counted.add(value)
            yield Progress(place / len(files), "merging masks")
        labels += (row for value, row in rows.items() if value in counted)
    if first is None or merged is None or not labels:
        raise RleSplatError(f"All {len(files)} masks in {path.name} are empty; choose another folder.")
    remark = f"Masks overlap in {overlaps} voxels, which show the last of them in the order of names."
    return Volume(
        voxels=merged, affine=first.affine, unit=first.unit, space=first.space, name=path.name,
        named_labels=tuple(labels), remarks=(*first.remarks, *((remark,) if overlaps else ())),
    )  # fmt: skip


def _values_of(plane) -> set:
    """The values of a plane but 0; the usual one of a mask is not sorted for."""
    there = plane[plane != 0]
    alike = there.size > 0 and (there == there[0]).all()
    return set((there[:1] if alike else np.unique(there)).tolist())


def _no_masks(path: Path, count: int) -> RleSplatError:
    """The error for a folder of NIfTI files that are scans."""
    return RleSplatError(f"{path.name} holds {count} NIfTI files that are not masks on one grid; choose one of them.")
