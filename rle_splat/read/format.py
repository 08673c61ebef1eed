"""One row of the table of formats, and the first bytes of a file by which a row recognizes it."""

import os
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..scene import RleSplatError

MEANING_OPTIONS = ("slope", "intercept", "unit", "value_unit", "modality")  # meaning of values, for every format
PLACE_OPTIONS = ("spacing", "orientation", "flip")  # corrections of the grid, for every format
LEVEL = "level"  # of a pyramid that a format has; for every other format, voxels that are left out
HEAD_BYTES = 4096  # bytes of a file that are looked at, packed and unpacked
PIECE = 16  # bytes unpacked at a time
GZIP_MAGIC = b"\x1f\x8b"
GZIP_WINDOW = 31  # zlib's window bits for data with a gzip header


@dataclass(frozen=True)
class Head:
    """The beginning of a file.

    Attributes
    ----------
    stored : bytes
        The first bytes as they are in the file.
    content : bytes
        The first bytes, unpacked if the file is a gzip file.
    """

    path: Path
    stored: bytes
    content: bytes

    @property
    def is_gzip(self) -> bool:
        """Whether the file begins as a gzip file, whatever its name."""
        return self.stored.startswith(GZIP_MAGIC)


def refuse_pipe(path) -> None:
    """Raise RleSplatError for what is neither a file nor a folder, such as a named pipe, which may be waited for."""
    if os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)):
        raise RleSplatError(f"{path} is neither a file nor a folder; give the path of one.")


def head_of(path) -> Head:
    """Read the beginning of a file; it is empty for anything that cannot be read."""
    path = Path(path)
    try:
        with open(path, "rb") as stream:
            stored = stream.read(HEAD_BYTES)
    except OSError:
        stored = b""
    return Head(path, stored, _unpack(stored) if stored.startswith(GZIP_MAGIC) else stored)


def _unpack(stored: bytes) -> bytes:
    """What the beginning of a gzip file unpacks to, up to damage: small pieces, since an error loses a whole piece."""
    decoder, content = zlib.decompressobj(GZIP_WINDOW), b""
    try:
        for start in range(0, len(stored), PIECE):
            content += decoder.decompress(stored[start : start + PIECE], HEAD_BYTES - len(content))
            if len(content) >= HEAD_BYTES:
                break
    except zlib.error:
        pass
    return content


@dataclass(frozen=True)
class Format:
    """One row of the table.

    Attributes
    ----------
    suffixes : tuple of str
        With the leading dot, lower case.
    options : tuple of str
        Options that ``read_steps`` takes itself. LEVEL and those of MEANING_OPTIONS and PLACE_OPTIONS that it does not
        take are applied to its result.
    read_steps : callable
        ``read_steps(path, **options)``: a generator of Progress that returns a Volume. It yields at least every
        0.1 s, so that it can be canceled, and calls ``refuse_beyond`` before it takes memory.
    recognizes : callable or None
        ``recognizes(head) -> bool``: whether a file is of this format, from its Head. None if only the suffix tells.
    reads_folder : callable or None
        ``reads_folder(path) -> bool``: whether the format reads this folder as one volume. None if it never does.
    write_steps : callable or None
        ``write_steps(volume, path)``: a generator of Progress that returns the options that are needed to read the
        file back; None if the format cannot be written.
    lost : callable or None
        ``lost(volume) -> list of str``: sentences on what the written file does not store.
    names_volume : bool
        Whether the reader names the volume by what it is, so that file names, which may name a patient, are not used.
    is_dropped : bool
        Whether Blender offers the format for files that are dropped into its window.
    """

    name: str
    suffixes: tuple
    description: str
    options: tuple
    read_steps: Callable
    recognizes: Callable | None = None
    reads_folder: Callable | None = None
    write_steps: Callable | None = None
    lost: Callable | None = None
    names_volume: bool = False
    is_dropped: bool = True

    @property
    def all_options(self) -> tuple:
        """All options of ``read_volume`` that apply to the format."""
        return tuple(dict.fromkeys((*self.options, *MEANING_OPTIONS, *PLACE_OPTIONS, LEVEL)))
