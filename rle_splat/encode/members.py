"""The members of stored run-length tables: files of a folder, or the same in one file, a zip that is not compressed.

The members are a header and a few tables of bare numbers. A chunk of planes z is encoded as a volume by itself; its
tables follow those of the chunk before. The pointers of the whole volume follow from the number of runs and voxels of
each scanline when the tables are opened; a scanline may lie anywhere in them.

    rows      scanlines along x, in the order of the planes: the tables of principal z, and of y, whose scanlines are
              the same
    across    scanlines along y, chunk by chunk: the tables of principal x

Members are mapped, not read. The header has a checksum of each chunk of each table, which is compared, and the chunk's
runs are validated, before a kernel reads it.
"""

from __future__ import annotations

import json
import mmap
import os
import struct
import zipfile
import zlib
from copy import copy
from pathlib import Path

import numpy as np

from ..read.format import refuse_pipe
from ..scene import RleSplatError
from ..volume.axes import AXIS_NAMES

FORMAT, VERSION = "rle-splat", 4
HEADER, JOURNAL = "header.json", "journal"  # a journal is in a folder that is not complete
COARSE = "coarse"  # members inside: the same volume in larger voxels
COUNTS, RUNS = "counts", "runs"  # tables of each order; the others hold one entry for each voxel
SURFACE = "surface"  # table of the codes of which post-classified voxels are lit
LIGHT_MODEL = "samples"  # how they are lit: ``shade.sample_light``
ROWS, ACROSS = "rows", "across"  # orders
ORDER_OF = {2: ROWS, 1: ROWS, 0: ACROSS}  # principal axis -> order of its scanlines
LITTLE = "<"
MOST_HEADER = 1 << 28  # bytes
LOCAL_HEADER = "<26xHH"  # of a zip's member; the sizes of its name and of what follows the name
ALIGNED, PADDING, ZIP64 = 64, 0xD935, 20  # tables begin at multiples of it; the kind of a zip's padding; bytes of sizes
AT_ONCE = 1 << 24  # bytes written between two looks at a checksum
# Exceptions that checks of members, json and zipfile raise.
DAMAGE = (
    zipfile.BadZipFile, struct.error, EOFError, LookupError, ValueError, TypeError, AttributeError, OverflowError,
    RuntimeError,
)  # fmt: skip
LONGEST_REASON = 150  # characters


def reason_of(problem: Exception) -> str:
    """An exception of DAMAGE as a remark in brackets, or nothing."""
    lines = str(problem).splitlines()
    return f" ({lines[0][:LONGEST_REASON]})" if lines else ""


def make_damage_error(path, what: str) -> RleSplatError:
    """The error for members that do not fit together; ``what``: a clause."""
    return RleSplatError(f"The tables in {Path(path).name} are damaged: {what}; encode the volume again.")


def unreadable(path, problem: OSError) -> RleSplatError:
    """The error for a file that cannot be read."""
    why = problem.strerror or problem
    return RleSplatError(f"Cannot read {path}: {why}; check the path and its permissions.")


class FolderMembers:
    """Members that are the files of a folder. Its methods raise OSError."""

    def __init__(self, path):
        self.path = Path(path)

    def size(self, name: str) -> int:
        """Bytes of a member now."""
        return (self.path / name).stat().st_size

    def array(self, name: str, dtype) -> np.ndarray:
        """A member that is not empty, mapped: flat."""
        return np.asarray(np.memmap(self.path / name, dtype=dtype, mode="r"))

    def read(self, name: str, most: int) -> bytes:
        """At most so many bytes of a member."""
        with open(self.path / name, "rb") as stream:  # a buffer of so many bytes is made whatever the size of the file
            return stream.read(min(os.fstat(stream.fileno()).st_size, most))

    def inside(self, name: str) -> FolderMembers:
        """The members of a folder inside."""
        return FolderMembers(self.path / name)


class FileMembers:
    """Members of a zip file that is mapped: what replaces it under its name later is not seen.

    As of FolderMembers; making it raises one of DAMAGE, too.
    """

    def __init__(self, path):
        self.path, self._prefix = Path(path), ""
        with open(path, "rb") as file, zipfile.ZipFile(file) as archive:
            self._mapping = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            self._places = {one.filename: (self._begin(one), one.file_size) for one in archive.infolist()}

    def _begin(self, member: zipfile.ZipInfo) -> int:
        """Where the content of a member begins."""
        begin = member.header_offset
        if begin >= 0:
            begin += struct.calcsize(LOCAL_HEADER) + sum(struct.unpack_from(LOCAL_HEADER, self._mapping, begin))
        if not 0 <= begin <= len(self._mapping) - member.file_size or member.compress_type != zipfile.ZIP_STORED:
            raise ValueError(f"{member.filename} is compressed or truncated")
        return begin

    def size(self, name: str) -> int:
        """Bytes of a member now."""
        if self._mapping.size() < len(self._mapping):
            raise make_damage_error(self.path, "it was cut while it was open")
        return self._place(name)[1]

    def array(self, name: str, dtype) -> np.ndarray:
        """A member, mapped: flat; a copy of one that does not begin where such numbers may be."""
        begin, size = self._place(name)
        content = np.frombuffer(self._mapping, np.uint8)[begin : begin + size]
        return np.require(content.view(dtype), requirements="A")

    def read(self, name: str, most: int) -> bytes:
        """At most so many bytes of a member."""
        begin, size = self._place(name)
        return self._mapping[begin : begin + min(size, most)]

    def inside(self, name: str) -> FileMembers:
        """The members of a folder inside."""
        found = copy(self)
        found._prefix += f"{name}/"
        return found

    def _place(self, name: str) -> tuple[int, int]:
        if self._prefix + name not in self._places:
            raise FileNotFoundError(2, f"it lacks {name}", name)
        return self._places[self._prefix + name]


def find_members(path) -> FolderMembers | FileMembers:
    """The members of a `.rle` file or folder; RleSplatError for a file that is none."""
    if Path(path).is_dir():
        return FolderMembers(path)
    refuse_pipe(path)
    try:
        return FileMembers(path)
    except DAMAGE as problem:
        sentence = f"Cannot read {path}: it is not a complete .rle file{reason_of(problem)}; encode the volume again."
        raise RleSplatError(sentence) from None
    except OSError as problem:
        raise unreadable(path, problem) from None


def describe_tables(
    volume, *, classification: str, model: str, record: int, axes, unit_length: float, transfer_function, lighting,
    source: str,
) -> dict:  # fmt: skip
    """What the header says of all tables; ``validate.check_header`` reads it.

    ``volume``: with the shape, the place and the remarks; ``axes``: principal axes. The others: see StoredVolume.
    """
    return {
        "classification": classification, "shape_xyz": list(volume.shape_xyz), "model": model, "record": record,
        "axes": [AXIS_NAMES[axis] for axis in sorted(axes)], "affine": np.asarray(volume.affine).tolist(),
        "unit": volume.unit, "space": volume.space, "source": source, "unit_length": unit_length,
        "remarks": list(volume.remarks), "transfer_function": transfer_function, "lighting": lighting,
    }  # fmt: skip


def make_header(header: dict) -> bytes:
    """The content of the member HEADER: its checksum, and JSON."""
    content = json.dumps({"format": FORMAT, "version": VERSION, **header})
    return f"{zlib.crc32(content.encode()):08x}{content}".encode()


def read_header(members) -> dict:
    """The header of members; RleSplatError if it is missing or damaged."""
    path = members.path
    try:
        text = members.read(HEADER, MOST_HEADER).decode()
    except OSError as problem:
        if os.path.isfile(path / JOURNAL):  # False without rights, where Path.is_file raises
            raise RleSplatError(
                f"{path} is not complete: its encoding was interrupted. Encode the volume again with the same command, "
                "which goes on where it was."
            ) from None
        raise unreadable(path, problem) from None
    except ValueError:
        raise make_damage_error(path, "its header is not text") from None
    try:
        header = json.loads(text[8:]) if int(text[:8], 16) == zlib.crc32(text[8:].encode()) else None
    except (ValueError, RecursionError):
        header = None
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise make_damage_error(path, "its header is not complete")
    if header.get("version") != VERSION:
        raise RleSplatError(
            f"{path} has the format version {header.get('version')}, and this program reads version {VERSION}; encode "
            "the volume again."
        )
    return header


def write_file(path, members: dict) -> None:
    """Write members, name -> bytes, into a file; raises OSError."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name, content in members.items():
            member = zipfile.ZipInfo(name)  # without a date, so that the same tables are the same file
            begin = archive.start_dir + struct.calcsize(LOCAL_HEADER) + len(name) + ZIP64 + 4
            padding = -begin % ALIGNED
            member.extra = struct.pack("<HH", PADDING, padding) + bytes(padding)
            with archive.open(member, "w", force_zip64=True) as target:
                for first in range(0, len(content), AT_ONCE):
                    target.write(content[first : first + AT_ONCE])


def bytes_of(array: np.ndarray) -> memoryview:
    """The bytes of an array as they are stored."""
    stored = np.ascontiguousarray(array.astype(array.dtype.newbyteorder(LITTLE), copy=False))
    return stored.reshape(-1).view(np.uint8).data


def words_of_entry(array: np.ndarray) -> list:
    """[dtype, words of an entry (0 for one number), 0] of a table, for the header."""
    return [array.dtype.str[1:], int(np.prod(array.shape[1:])) if array.ndim > 1 else 0, 0]
