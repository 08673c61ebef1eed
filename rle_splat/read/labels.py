"""Label maps: whole numbers on the grid of a scan, and the names of labels in ITK-SNAP's text files."""

import re
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np

from ..runtime.steps import Progress, announce, drain
from ..scene import RleSplatError
from ..scene.color import linear
from ..volume.counts import counts_values
from ..volume.regrid import on_grid_steps
from ..volume.volume import NamedLabel, Volume, range_steps
from .dicom.reader import read_dicom_steps
from .formats import RAW, format_of, read_steps
from .streaming import convert_steps

TEXT_SUFFIXES = (".txt", ".label")
MOST_TEXT = 1 << 20  # bytes of a file of names
ROW = re.compile(r'^\s*(\d{1,9})\s+(\d{1,3})\s+(\d{1,3})\s+(\d{1,3})\s+([\d.]+)\s+([01])\s+([01])\s+"(.*)"\s*$')
LARGEST = 2**31 - 1
NARROW = (np.uint16, np.int16)
DOING = "reading labels"


def read_labels(path: str | PathLike | Volume, volume: Volume, frame: int = 1) -> Volume:
    """Read a label map, DICOM SEG, RTSTRUCT or folder of masks, and bring it onto the grid of a volume.

    Parameters
    ----------
    path : str, Path or Volume
        A file of a known format, or a folder of masks. A raw file is read with the shape of the volume, and an
        RTSTRUCT on its grid. Or a label map on another grid, such as of ``read_sitk``.
    volume : Volume
        The scan.
    frame : int
        Time point, starting at 1, of a map that changes with time.

    Returns
    -------
    Volume
        Whole numbers, for ``Labels``, with the frames of the file. ``named_labels`` has the names and colors of the
        file, or else those of a text file of ITK-SNAP with the same name beside it.

    Raises
    ------
    RleSplatError
        If the file cannot be read, or lies elsewhere than the volume.
    """
    if isinstance(path, Volume):
        return drain(_on_volume_steps(path, volume))
    return drain(read_label_steps(path, volume, frame))


def read_label_steps(path, volume: Volume, frame: int = 1):
    """Generator of Progress: as ``read_labels``, of a file or folder."""
    path = Path(path)
    kind = format_of(path) if path.is_file() else None
    if kind is not None and kind.read_steps is read_dicom_steps:
        labels = yield from read_dicom_steps(path, scan=volume)
    else:
        bare = dict(shape=volume.shape_xyz, spacing=volume.spacing) if kind is RAW else {}
        labels = yield from read_steps(path, **bare, **({"frame": frame} if frame > 1 else {}))
    labels = yield from _on_volume_steps(labels, volume)
    return labels if labels.named_labels else replace(labels, named_labels=_names_beside(path))


def _on_volume_steps(labels: Volume, volume: Volume):
    """Generator of Progress: a label map as whole numbers in few bytes, on the grid of a volume."""
    labels = yield from _narrow_steps((yield from _whole_steps(labels)))
    return (yield from on_grid_steps(labels, volume))


def changes_with_time(labels: Volume) -> bool:
    """Whether a label map is one of several frames in time."""
    return labels.frames > 1 and labels.frame_axis == "time"


def remarks_beside(labels: Volume, frames: int) -> tuple[str, ...]:
    """The remarks on a label map, with a sentence where it has another number of frames than the scan."""
    count = labels.frames if changes_with_time(labels) else 1
    if count in (1, frames):
        return labels.remarks
    shown = f"the first {frames} are" if frames > 1 else "the first is"
    if count < frames:
        shown = "beyond them the last one is"
    return *labels.remarks, f"The segmentation file has {count} volumes and the scan {frames}; {shown} shown."


def _whole_steps(labels: Volume):
    """Generator of Progress: a label map stored as floats or with a slope, as integers if all values are whole."""
    if labels.voxels.dtype.kind in "iu" and (labels.slope, labels.intercept) == (1.0, 0.0):
        return labels
    voxels = np.empty(labels.voxels.shape, dtype=np.int32)
    for z, stored in enumerate(labels.voxels):
        values = labels.physical(stored)
        if (values != np.round(values)).any():
            return labels  # no label map; Labels says so
        _check_numbers(float(values.min()), float(values.max()))
        voxels[z] = values
        yield Progress(z / len(voxels), DOING)
    return replace(labels, voxels=voxels, slope=1.0, intercept=0.0)


def _narrow_steps(labels: Volume):
    """Generator of Progress: a label map of 32 bits in 16, if its values fit, so that lookup tables classify it."""
    if labels.voxels.dtype.kind not in "iu" or counts_values(labels.voxels.dtype):
        return labels
    low, high = yield from announce(range_steps(labels), 0.0, 1.0, DOING)
    _check_numbers(low, high)
    fits = [kind for kind in NARROW if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max]
    if not fits:
        return labels
    return replace(labels, voxels=(yield from convert_steps(labels.voxels, fits[0], DOING)))


def _check_numbers(low: float, high: float) -> None:
    """RleSplatError if labels from ``low`` to ``high`` have numbers that tables of labels cannot hold."""
    if max(-low, high) > LARGEST:
        number = high if high > LARGEST else low
        raise RleSplatError(f"The segmentation file has the number {number:.0f}; give labels numbers below 2^31.")


def _names_beside(path: Path) -> tuple[NamedLabel, ...]:
    """The names in a text file of ITK-SNAP beside a label map; none if there is no such file."""
    stem = path.name.split(".")[0]
    for suffix in TEXT_SUFFIXES:
        file = path.with_name(stem + suffix)
        if file.is_file() and is_label_text(file):
            return tuple(label for label, _ in read_label_text(file))
    return ()


def is_label_text(path) -> bool:
    """Whether a file holds rows of ITK-SNAP's label descriptions."""
    return any(ROW.match(line) for line in _lines(path))


def read_label_text(path) -> tuple[tuple[NamedLabel, bool], ...]:
    """Read a label description file of ITK-SNAP; RleSplatError if the file cannot be read or holds no such row.

    Parameters
    ----------
    path : str or Path
        Each row: number, red, green, blue (0 to 255), opacity, visible (0 or 1), mesh visible, "name".

    Returns
    -------
    tuple of (NamedLabel, bool)
        Each label and whether it is visible.
    """
    rows = [found for line in _lines(path) if (found := ROW.match(line))]
    if not rows:
        raise RleSplatError(
            f'{Path(path).name} is no label description of ITK-SNAP (rows such as 1 255 0 0 1 1 1 "liver"); check it.'
        )
    labels = []
    for row in rows:
        number, *color = (int(text) for text in row.groups()[:4])
        color = linear([min(channel, 255) / 255.0 for channel in color])
        labels.append((NamedLabel(number, row[8], color), row[6] == "1"))
    return tuple(labels)


def _lines(path) -> list[str]:
    """The lines of a text file."""
    try:
        with open(path, "rb") as stream:
            return stream.read(MOST_TEXT).decode("utf-8", "replace").splitlines()
    except OSError as problem:
        raise RleSplatError(f"Cannot read {path}: {problem.strerror or problem}; check the path.") from None
