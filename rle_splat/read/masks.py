"""A folder of masks, one NIfTI file for each organ as TotalSegmentator writes them, as one label map."""

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
        ``named_labels``. Where masks overlap, the last one counts, and a remark tells how many voxels overlap.

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
    labels, overlaps = [], 0
    for number, file in enumerate(files, start=1):
        span = (number - 1) / len(files), number / len(files)
        doing = f"reading {path.name} ({number} of {len(files)} masks)"
        mask = yield from rescale(read_nifti_steps(file), *span, doing)
        if first is None:
            kind = np.uint8 if len(files) < 256 else np.uint16
            first, merged = mask, allocate(path, mask.shape_xyz, kind)
            merged[...] = 0
        mask = yield from on_grid_steps(mask, first)
        if mask.voxels.shape != merged.shape:
            raise _no_masks(path, len(files))
        counted = 0
        for z, values in enumerate(mask.voxels):
            there = values != 0
            if there.any():
                if (values[there] != values[there][0]).any():
                    raise _no_masks(path, len(files))
                counted += int(np.count_nonzero(there))
                overlaps += int(np.count_nonzero(merged[z][there]))
                merged[z][there] = number
            yield Progress(number / len(files), "merging masks")
        if counted:
            labels.append(NamedLabel(number, plain_name(file)))
    if not labels:
        raise RleSplatError(f"All {len(files)} masks in {path.name} are empty; choose another folder.")
    remark = f"Masks overlap in {overlaps} voxels, which show the last of them in the order of names."
    return Volume(
        voxels=merged, affine=first.affine, unit=first.unit, space=first.space, name=path.name,
        named_labels=tuple(labels), remarks=(*first.remarks, *((remark,) if overlaps else ())),
    )  # fmt: skip


def _no_masks(path: Path, count: int) -> RleSplatError:
    """The error for a folder of NIfTI files that are scans."""
    return RleSplatError(f"{path.name} holds {count} NIfTI files that are not masks on one grid; choose one of them.")
