"""The files that a detached header names: one, a list, or a numbered pattern."""

import os
import re
from pathlib import Path

from ..scene import RleSplatError
from .header import damage_error
from .streaming import Part

MOST_FILES = 20_000


def find_data_files(path: Path, given: str, listed) -> list[Path]:
    """The data files of a header.

    Parameters
    ----------
    path : Path
        The header; names are relative to its folder.
    given : str
        A name, a pattern such as ``a%03d.raw 1 20 1``, or ``LIST`` with the names in ``listed``.
    listed : sequence of str

    Raises
    ------
    RleSplatError
        If a file is missing or outside the folder of the header; the message names it.
    """
    names = list(listed) if given.upper().split()[:1] == ["LIST"] else _pattern_names(path, given)
    names = [os.path.normpath(name.strip().replace("\\", "/")) for name in names if name.strip()]
    for name in names:
        if _is_outside(path.parent, name):  # a header of others must not choose among one's files
            raise RleSplatError(
                f"{path.name} names {name}, which is outside its folder; move that file beside it and correct the name."
            )
    files = [path.parent / name for name in names]
    missing = next((file for file in files if not file.is_file()), None)
    if missing is not None or not files:
        gone = missing.name if missing is not None else "a list of files"
        raise RleSplatError(f"{path.name} needs {gone} beside it, which is not there; copy all its files.")
    return files


def _is_outside(folder: Path, name: str) -> bool:
    """Whether a normalized name, absolute or relative to a folder, is of a file neither in the folder nor below it."""
    if "\0" in name or (not Path(name).anchor and Path(name).parts[:1] != ("..",)):
        return False  # no file has a NUL in its name, and the system looks none up
    file = folder / name
    if Path(os.path.abspath(file)).anchor != Path(os.path.abspath(folder)).anchor:
        return True  # on another drive or computer, where nothing is looked up
    return not Path(os.path.realpath(file.parent)).is_relative_to(os.path.realpath(folder))


def _pattern_names(path, given: str) -> list[str]:
    """One name, or the names of a pattern."""
    words = given.split()
    if not (
        len(words) in (4, 5)
        and re.search(r"%0?\d*d", words[0])
        and all(re.fullmatch(r"-?\d{1,6}", word) for word in words[1:])
    ):
        return [given]
    first, last, step = (int(word) for word in words[1:4])
    numbers = range(first, last + (1 if step > 0 else -1), step) if step else ()
    if not 0 < len(numbers) <= MOST_FILES:
        raise damage_error(path, "the pattern of its data files names none, or too many")
    return [re.sub(r"%(0?\d*)d", lambda found, n=n: format(n, f"{found[1]}d"), words[0]) for n in numbers]


def part_of(file: Path, offset: int, skip: int, packing: str | None, size: int) -> Part:
    """The Part of a data file; ``skip`` bytes before its voxels, or -1 if its last ``size`` bytes are the voxels."""
    if skip == -1 and packing is None:
        return Part(file, max(0, os.path.getsize(file) - size), None, 0)
    return Part(file, offset, packing, max(0, skip))
