"""Which files a path stands for, and the pictures in them. The content of a file decides, not its suffix."""

import os
from dataclasses import dataclass, replace
from pathlib import Path

from ...runtime.steps import Progress, map_steps, step_within
from ..library_import import library_steps
from . import elements as read
from .pictures import is_segmentation, is_structures, picture_steps, series_key
from .refusals import Damaged, Refused, damage_error, no_images

MOST_FILES = 20_000
MOST_KEPT = 10_000  # files and pictures; 3.4 kB each, measured
SUFFIXES = (".dcm", ".dicom", ".ima")  # a file with one of these that is not DICOM is damaged
YIELD_FILES = 16  # files looked at between two steps, when they are no pictures


_kept: dict = {}  # path -> (what changes when the file does, its pictures)
_count = [0]  # of files and pictures that were kept since the last clearing


@dataclass(frozen=True)
class FoundPictures:
    """What a path holds.

    Attributes
    ----------
    pictures : tuple of pictures.ImageFrame
    refused : tuple of Refused
        Of DICOM files that hold no usable picture.
    broken : tuple of str
        Names of DICOM files that cannot be parsed.
    others : int
        Number of files that are not DICOM.
    series : str
        Hash of the series of the file that the path names; "" if it names several.
    segmentation : elements.Elements or None
        The path's file, if it is a DICOM SEG.
    structures : bool
        Whether the path's file is an RTSTRUCT.
    absent : int
        Number of files that a DICOMDIR lists and that are not there.
    """

    pictures: tuple
    refused: tuple
    broken: tuple
    others: int
    series: str = ""
    segmentation: read.Elements | None = None
    structures: bool = False
    absent: int = 0


def find_pictures(path):
    """Generator of Progress: find the pictures that a path stands for.

    Parameters
    ----------
    path : str or Path
        A folder, searched with its folders; a DICOMDIR; a multi-frame file; or any one file of a series, which stands
        for its folder.

    Returns
    -------
    FoundPictures

    Raises
    ------
    Refused
        If there is no usable picture, or the named file holds none.
    """
    path = Path(path)
    yield Progress(0.0, f"Looking for images in {path.name}")
    yield from library_steps("pydicom", "pydicom", "DICOM")
    if path.is_dir():
        found = yield from _scan((yield from _files_below(path)))
        return _check(found, path)
    own, stamp = _keep_pictures(path), _stamp(path)
    if not own:
        parsed = yield from _parse(path)
        if parsed is not None and parsed.is_directory:
            files, absent = yield from _directory_files(parsed)
            return replace(_check((yield from _scan(files)), path), absent=absent)
        if parsed is not None and read.quietly(is_segmentation, parsed):
            return FoundPictures((), (), (), 0, segmentation=parsed)
        if parsed is not None and read.quietly(is_structures, parsed):
            return FoundPictures((), (), (), 0, structures=True)
        own = yield from _pictures(parsed)
        if own is None:
            raise Refused(f"{path.name} is not a DICOM file; choose a file or the folder of a series.")
        _keep(path, stamp, own)
    series = own[0].series.key
    if own[0].storage.frames > 1:
        return FoundPictures(own, (), (), 0, series)
    files = (other for other in path.parent.iterdir() if not other.name.startswith("._"))  # of macOS's archives
    siblings = sorted(other for other in files if other.is_file())
    _refuse_more(path.parent, len(siblings), "copy those of the series into a folder of their own")
    found = yield from _scan(siblings)
    mine = tuple(picture for picture in found.pictures if picture.series.key == series)
    return FoundPictures(mine, found.refused, found.broken, found.others, series)


def _files_below(folder: Path):
    """Generator: files of a folder and its folders, sorted; hidden ones and those of macOS's archives left out."""
    found = []
    for here, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith(".") and name != "__MACOSX")
        files = (Path(here, name) for name in sorted(names) if not name.startswith("."))
        found += [file for file in files if file.is_file()]  # no pipes
        _refuse_more(folder, len(found), "choose the folder of one study or series")
        yield Progress(0.0, f"Looking for images in {folder.name}")
    return found


def _refuse_more(folder: Path, files: int, remedy: str) -> None:
    if files > MOST_FILES:
        raise Refused(f"{folder.name} holds more than {MOST_FILES} files; {remedy}.")


def _scan(paths):
    """Generator of Progress: read the headers of files; returns FoundPictures."""
    pictures, refused, broken, others = [], [], [], 0
    for i, path in enumerate(paths):
        try:
            own, stamp = _keep_pictures(path), _stamp(path)
            if own is None:
                own = yield from _pictures((yield from _parse(path)))
                _keep(path, stamp, own or ())
            if own:
                pictures += own
            elif path.suffix.lower() in SUFFIXES:
                broken.append(path.name)
            else:
                others += 1
        except Damaged:
            broken.append(path.name)
        except Refused as problem:
            refused.append(problem)
        if i % YIELD_FILES == 0 or pictures:
            yield Progress(i / len(paths), f"Reading headers: {i} of {len(paths)} files")
    return FoundPictures(tuple(pictures), tuple(refused), tuple(broken), others)


def _parse(path: Path):
    """Generator of Progress: the elements of one file; None if it is not DICOM."""
    doing = Progress(0.0, f"Reading the header of {path.name}")
    return (yield from map_steps(read.read_elements(path), lambda _: doing))


def _stamp(path: Path) -> tuple | None:
    """What changes when a file does."""
    try:
        stat = path.stat()
    except OSError:
        return None
    return stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_ino


def _keep_pictures(path: Path) -> tuple | None:
    """The pictures of a file that was read before and has not changed, () if it has none; None if it must be read."""
    stamp, pictures = _kept.get(path, (None, None))
    return pictures if stamp is not None and stamp == _stamp(path) else None


def _keep(path: Path, stamp: tuple | None, pictures: tuple) -> None:
    """Keep the pictures of a file, so that the next frame of a series in time is found without reading headers.

    ``stamp``: of before it was read, so that a file that changed meanwhile is read again.
    """
    _count[0] += 1 + len(pictures)
    if _count[0] > MOST_KEPT:
        _kept.clear()
        _count[0] = 1 + len(pictures)
    _kept[path] = (stamp, pictures)


def _pictures(found: read.Elements | None):
    """Generator of Progress: the pictures of a parsed file; None if it is none of DICOM's images."""

    def sort_out():
        if found is None or found.is_directory:
            return None
        return (yield from picture_steps(found))

    try:
        steps = step_within(sort_out(), read.quiet)
        return (yield from map_steps(steps, lambda _: Progress(0.0, f"Reading the header of {found.path.name}")))
    except Refused as problem:
        problem.series = read.quietly(series_key, found)
        raise
    except read.problems():
        raise damage_error(found.path) from None


def _directory_files(found: read.Elements):
    """Generator: the files that a DICOMDIR lists and that exist, and the number of the others."""
    files, absent = [], 0
    for record in found.frames:
        names = read.quietly(read.texts, record, "ReferencedFileID")
        if names:
            file = _list(found.path.parent, names)
            files += [file] if file is not None else []
            absent += file is None
        yield Progress(0.0, f"Reading {found.path.name}")
    if not files:
        raise Refused(f"The files that {found.path.name} lists are not beside it; choose the folder that holds them.")
    return files, absent


def _list(folder: Path, names) -> Path | None:
    """The file that a DICOMDIR names below its folder, in any case of letters; None if it is not there."""
    for name in names:
        if name in ("", ".", "..") or "/" in name or "\\" in name:
            return None
        inner = folder / name
        if not inner.exists():
            same = (
                [other for other in folder.iterdir() if other.name.lower() == name.lower()] if folder.is_dir() else []
            )
            inner = same[0] if same else inner
        folder = inner
    return folder if folder.is_file() else None


def _check(found: FoundPictures, path: Path) -> FoundPictures:
    """Refuse a path without pictures, by the reason that fits."""
    if found.pictures:
        return found
    if found.broken:
        raise damage_error(found.broken[0])
    if found.refused:
        raise found.refused[0]
    raise no_images(path, found.others)
