"""Segmentations that lie beside a scan: DICOM SEG and RTSTRUCT files, and label maps by their names."""

import os
import re
from itertools import islice
from pathlib import Path

from ..runtime.steps import Progress
from .dicom.pictures import hash_text
from .formats import FORMATS, RAW, format_of, suffixes
from .masks import reads_mask_folder

# Words in the names of label maps, those of masks, which are one organ each, and what is between words.
LABELS = re.compile(r"^(labels?|labelmaps?|[ad]?segs?|segmentations?|segmented)$")
MASKS = re.compile(r"^masks?$")
BETWEEN = re.compile(r"[^a-z0-9]+")
OF_FORMATS = {word for suffix in suffixes() for word in BETWEEN.split(suffix)} - {"seg"}  # which 3D Slicer appends
# SOP classes of segmentations, label map segmentations and structure sets, near the beginning of their files.
CLASSES = re.compile(rb"1\.2\.840\.10008\.5\.1\.4\.1\.1\.(66\.[47]|481\.3)(?![.\d])")
UID = re.compile(rb"[0-9.]{8,64}")
HEAD, REFERENCES = 1 << 11, 1 << 22  # bytes that say what a file is, and of which series it is
MOST_FILES, AT_ONCE = 20_000, 64


def find_segmentations_steps(path, series: str = ""):
    """Generator of Progress: the segmentations that seem to be of a scan.

    Parameters
    ----------
    path : str or Path
        The scan's file or DICOM folder.
    series : str
        ``Volume.series`` of the scan.

    Returns
    -------
    list of Path
        For DICOM, SEG and RTSTRUCT files that refer to the series, in the scan's folder, the folders in it, if the path
        is a folder, and the folder above it. For others, files and folders of masks in the same folder that are named
        as labels, if the scan is the only one there or has more words of its name in common with them than other scans.
    """
    path = Path(path)
    yield Progress(0.0, "looking for segmentations")
    kind = format_of(path)
    try:
        if kind is not None and kind.name == "DICOM":
            return (yield from _dicom_steps(path, series))
        return [] if path.is_dir() else _named_as_labels(path)
    except OSError:  # a folder may be closed to us
        return []


def _dicom_steps(path: Path, series: str):
    """Generator of Progress: the SEG and RTSTRUCT files by a DICOM file or folder that refer to a series."""
    folder = path if path.is_dir() else path.parent
    below = folder.rglob("*") if path.is_dir() else folder.iterdir()
    found = set()
    for files in (below, folder.parent.iterdir()):
        for number, file in enumerate(islice(files, MOST_FILES)):
            if not file.name.startswith(".") and file.is_file() and _are_segments_of(file, series):
                found.add(file)
            if number % AT_ONCE == 0:
                yield Progress(0.0, "looking for segmentations")
    return sorted(found)


def _are_segments_of(file: Path, series: str) -> bool:
    try:
        with open(file, "rb") as stream:
            if not CLASSES.search(stream.read(HEAD)):
                return False
            stream.seek(0)
            return any(hash_text(uid.decode()) == series for uid in set(UID.findall(stream.read(REFERENCES))))
    except OSError:
        return False


def _words(name: str) -> set[str]:
    return set(BETWEEN.split(name.lower())) - OF_FORMATS


def _named_as_labels(path: Path) -> list[Path]:
    """The files and folders of labels beside the file of a scan that are more alike to it than to other scans."""
    images = tuple(suffix for entry in FORMATS if entry is not RAW for suffix in entry.suffixes)
    scans, labels = [path], []
    for other in sorted(Path(entry.path) for entry in islice(os.scandir(path.parent), MOST_FILES)):
        words = _words(other.name)
        is_labels, is_file = any(map(LABELS.match, words)), other.name.lower().endswith(images)
        if other == path or other.name.startswith("."):
            continue
        if is_labels and (is_file if other.is_file() else reads_mask_folder(other)):
            labels.append(other)
        elif is_file and not any(map(MASKS.match, words)):
            scans.append(other)

    def common(one, two) -> int:
        return len(_words(one.name) & _words(two.name))

    if any(map(LABELS.match, _words(path.name))):
        return []  # itself a map of labels
    return [one for one in labels if all(common(one, path) > common(one, other) for other in scans[1:])]
