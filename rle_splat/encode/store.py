"""`.rle` files: run-length tables of one or more principal axes, with their position in space and their origin.

A file is a zip archive of uncompressed `.npy` members, as written by numpy's `savez`, and a JSON header. Nothing is
unpickled, the size of every member is checked before memory is allocated, and the tables are validated before any
kernel reads them.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from ..read.format import refuse_pipe
from ..runtime.memory import refuse_beyond
from ..runtime.whole_files import whole_file
from ..scene import RleSplatError
from ..volume.axes import AXIS_NAMES
from . import earlier
from .stored_folder import FolderVolume, load_folder
from .tables import TABLES, RunLengthVolume
from .validate import DAMAGE, checked_color, checked_header, reason_of, scanline_data_pointers

FORMAT = "rle-splat"
VERSION = 2
HEADER = "header"
DECODING = "decoding"  # scales of short records
CHUNK_BYTES = 1 << 24  # read at once, so that no table is held twice


@dataclass(frozen=True, eq=False)
class StoredVolume:
    """Content of a `.rle` file.

    Attributes
    ----------
    axes : dict of int to RunLengthVolume
        By principal axis (0, 1, 2); at least one, all of the same shape, model and record size.
    affine : (4, 4) ndarray of float64
        Voxel index (x, y, z, 1) to the volume's own space, in ``unit``.
    unit : str
        Unit of length of the volume's own space.
    unit_length : float
        World length of one unit to which the extinctions refer; see ``classification.unit_length``.
    transfer_function, lighting
        JSON-compatible descriptions of how the colors were made.
    source : str
        Name of the file from which the volume was read.
    remarks : tuple of str
    space : {"patient"} or None
        See Volume.
    key : str or None
        Hash of the checksums of the file's members; None of one that was not read from a file.
    """

    axes: dict
    affine: np.ndarray
    unit: str = "mm"
    unit_length: float = 1.0
    transfer_function: object = None
    lighting: object = None
    source: str = ""
    remarks: tuple = field(default=())
    space: str | None = None
    key: str | None = None

    holds_values: ClassVar[bool] = False
    classification: ClassVar[str] = "pre"

    @property
    def principal_axes(self) -> tuple[int, ...]:
        """The principal axes that it holds."""
        return tuple(self.axes)

    @property
    def visible_voxels(self) -> int:
        """Number of visible voxels."""
        return self._any_axis.visible_voxels

    def held(self, _used: dict) -> dict:
        """Principal axis -> tables that are in memory: all of the file, whatever a picture uses."""
        return dict(self.axes)

    def tables_steps(self, axis: int):
        """Generator of fractions done: the tables of a principal axis, and nothing else; see FolderVolume."""
        yield 1.0
        return self.axes[axis], {}

    @property
    def shape_xyz(self) -> tuple[int, int, int]:
        """Number of voxels along x, y, z."""
        return self._any_axis.shape_xyz

    @property
    def spacing(self) -> np.ndarray:
        """(3,) float64: distance between the centers of neighboring voxels along x, y, z, in ``unit``."""
        return np.linalg.norm(self.affine[:3, :3], axis=0)

    @property
    def model(self) -> str:
        """Model of the voxel data: "extinction" or "opacity"."""
        return self._any_axis.model

    @property
    def record(self) -> int:
        """Bytes of a voxel record."""
        return self._any_axis.record

    @property
    def _any_axis(self) -> RunLengthVolume:
        """Any of the encodings."""
        return next(iter(self.axes.values()))


def save(path, stored: StoredVolume) -> None:
    """Write a `.rle` file. An existing file is replaced only when the new one is complete.

    Parameters
    ----------
    path : str or Path
    stored : StoredVolume

    Raises
    ------
    RleSplatError
        If the encodings do not match or the file cannot be written.
    """
    with whole_file(path) as part:
        write(part, stored)


def write(path, stored: StoredVolume) -> None:
    """As ``save``, in place; raises OSError."""
    if len({(e.shape_xyz, e.model, e.record) for e in stored.axes.values()}) != 1:
        raise RleSplatError(
            "A .rle file needs at least one encoding, and all of the same volume, model and record size; encode again."
        )
    header = {
        "format": FORMAT, "version": VERSION, "shape_xyz": list(stored.shape_xyz), "model": stored.model,
        "record": stored.record,
        "axes": [AXIS_NAMES[axis] for axis in sorted(stored.axes)],
        "affine": np.asarray(stored.affine).tolist(), "unit": stored.unit, "unit_length": stored.unit_length,
        "transfer_function": stored.transfer_function, "lighting": stored.lighting, "source": stored.source,
        "remarks": list(stored.remarks), "space": stored.space,
    }
    members = {HEADER: np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)}
    for axis in sorted(stored.axes):
        members.update({_member(axis, table): getattr(stored.axes[axis], table) for table in TABLES})
        if stored.axes[axis].decoding is not None:
            members[_member(axis, DECODING)] = stored.axes[axis].decoding
    with open(path, "wb") as file:
        np.savez(file, **members)


def load(path) -> StoredVolume | FolderVolume:
    """Read and validate a `.rle` file, or open a folder of tables.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    StoredVolume, or FolderVolume

    Raises
    ------
    RleSplatError
        If the file cannot be read or is not a valid `.rle` file.
    """
    if Path(path).is_dir():
        return load_folder(path)
    refuse_pipe(path)
    try:
        with open(path, "rb") as file, zipfile.ZipFile(file) as archive:
            return _read(archive, os.fstat(file.fileno()).st_size)
    except RleSplatError as problem:
        raise RleSplatError(f"Cannot read {path}: {problem}") from None
    except DAMAGE as problem:
        sentence = f"Cannot read {path}: it is not a complete .rle file{reason_of(problem)}; encode the volume again."
        raise RleSplatError(sentence) from None
    except OSError as problem:
        raise RleSplatError(
            f"Cannot read {path}: {problem.strerror or problem}; check the path and its permissions."
        ) from None


def _member(axis: int, table: str) -> str:
    """Name of an array in the archive."""
    return f"{AXIS_NAMES[axis]}_{table}"


def _read(archive: zipfile.ZipFile, file_bytes: int) -> StoredVolume:
    """Read and validate the content of an archive."""
    refuse_beyond(file_bytes, "its tables need", "encode fewer principal axes, or use smaller voxel records")
    facts = checked_header(_read_header(_read_array(archive, HEADER, file_bytes)))
    shape, model, record = (facts.pop(name) for name in ("shape_xyz", "model", "record"))
    encoded = {}
    for axis in facts.pop("axes"):
        tables = [_read_array(archive, _member(axis, table), file_bytes) for table in TABLES]
        decoding = None if record == 16 else _read_array(archive, _member(axis, DECODING), file_bytes)
        if record in earlier.TYPES:
            tables[-1], decoding = earlier.lengthen(tables[-1], decoding)
        derived = scanline_data_pointers(axis, shape, model, *tables, decoding)
        encoded[axis] = RunLengthVolume(axis, shape, model, *tables, derived, decoding)
        if encoded[axis].record != earlier.RECORDS.get(record, record):
            raise ValueError("its voxel data do not have the stated record size")
        checked_color(encoded[axis].most_color)
    return StoredVolume(encoded, **facts, key=_key_of(archive))


def _key_of(archive: zipfile.ZipFile) -> str:
    """Hash of what the archive says of its members, whose checksums were compared while they were read."""
    members = [(member.filename, member.file_size, member.CRC) for member in archive.infolist()]
    return hashlib.blake2b(repr(members).encode(), digest_size=16).hexdigest()


def _read_array(archive: zipfile.ZipFile, name: str, file_bytes: int) -> np.ndarray:
    """Read one `.npy` member (native byte order, C order); its header is checked against the file's size first."""
    entry = archive.getinfo(f"{name}.npy")
    if entry.compress_type != zipfile.ZIP_STORED or entry.file_size > file_bytes:
        raise ValueError(f"{name} is compressed or truncated")
    with archive.open(entry) as member:
        major = np.lib.format.read_magic(member)[0]
        read_claims = np.lib.format.read_array_header_1_0 if major == 1 else np.lib.format.read_array_header_2_0
        shape, fortran_order, dtype = read_claims(member)
        n_bytes = math.prod(shape) * dtype.itemsize
        if dtype.hasobject or fortran_order or not dtype.isnative or n_bytes != entry.file_size - member.tell():
            raise ValueError(f"{name} does not match its own header")
        content = np.empty(n_bytes, dtype=np.uint8)
        for start in range(0, n_bytes, CHUNK_BYTES):  # the archive checks the checksum at the last byte
            part = content[start : start + CHUNK_BYTES]
            if member.readinto(part) != len(part):
                raise EOFError(f"{name} ends early")
    return content.view(dtype).reshape(shape)


def _read_header(stored: np.ndarray) -> dict:
    """Parse the JSON header; RleSplatError for one of another version."""
    header = json.loads(stored.tobytes().decode())
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise ValueError("its header is not that of a .rle file")
    if header.get("version") != VERSION:
        raise RleSplatError(
            f"its format version is {header.get('version')}, and this program reads version {VERSION}; encode it again."
        )
    return header
