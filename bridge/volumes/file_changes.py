"""What changes when a file, or one in a folder, is written: by it a change is noticed without reading."""

import hashlib
import os
import stat
import time
from typing import NamedTuple

from ...rle_splat.read.dicom.discovery import MOST_FILES

FRESH = 1.0  # seconds
SHARE = 50.0  # times as long as looking at a folder takes, until it is looked at again
DIRECTORY = "DICOMDIR"


class _Looked(NamedTuple):
    """State of a file or a folder, hash of the files that it stands for, and when they are looked at again."""

    own: tuple
    inside: str
    until: float


_folders: dict = {}  # path of a folder, or of a file of a series -> _Looked


def state_of(path, is_series: bool = False) -> tuple:
    """Size and time of a file; of a folder or a series also a hash of the names, sizes and times of its files.

    Panels and handlers ask often, so that a folder is looked at once in FRESH seconds, and a large one less often.

    Parameters
    ----------
    is_series : bool
        Whether a DICOM series was read from it: a file then stands for the files beside it, a DICOMDIR for those below
        it.

    Raises
    ------
    OSError
        If there is no such file.
    """
    status = os.stat(path)
    own = status.st_size, status.st_mtime_ns
    is_folder = stat.S_ISDIR(status.st_mode)
    if not (is_folder or is_series):
        return own
    began = time.monotonic()
    looked = _folders.get(path)
    if looked is None or began > looked.until or looked.own != own:
        is_deep = is_folder or os.path.basename(path).upper() == DIRECTORY
        inside = _digest_of_files(path if is_folder else os.path.dirname(path), is_deep)
        now = time.monotonic()
        _folders[path] = _Looked(own, inside, now + max(FRESH, SHARE * (now - began)))
    return own, _folders[path].inside


def _digest_of_files(folder: str, is_deep: bool) -> str:
    """Hash of the names, sizes and times of a folder's files, and with ``is_deep`` of those in its folders."""
    found = []
    for here, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith(".")) if is_deep else []
        for name in sorted(names):
            if not name.startswith(".") and ".blend" not in name:  # a scene saved beside its scan changes nothing
                path = os.path.join(here, name)
                found.append((os.path.relpath(path, folder), *_size_and_time(path)))
        if len(found) > MOST_FILES:
            break
    return digest(found)


def _size_and_time(path: str) -> tuple:
    """Size and modification time of a file; nothing of one that is gone."""
    try:
        status = os.stat(path)
    except OSError:
        return ()
    return status.st_size, status.st_mtime_ns


def digest(found) -> str:
    """Hash of plain data, the same in every session."""
    return hashlib.blake2b(repr(tuple(found)).encode("utf-8", "surrogateescape"), digest_size=16).hexdigest()


def forget() -> None:
    """Look at every folder again when it is asked for."""
    _folders.clear()
