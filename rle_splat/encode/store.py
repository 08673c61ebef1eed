"""`.rle` files: the tables of one or more principal axes with what is needed to place and explain them.

A zip archive of uncompressed `.npy` members, as numpy's `savez` writes it, plus a JSON header.  Nothing in it is
ever unpickled, every member's size is checked before memory is taken for it, and the tables are validated before
any kernel sees them.
"""

from __future__ import annotations

import json
import math
import os
import struct
import tokenize
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..classify.limits import BRIGHTEST
from ..runtime.memory import refuse_beyond
from ..scene import RECORDS, RleSplatError, as_matrix
from ..volume.axes import AXES, AXIS_NAMES
from .tables import TABLES, RunLengthVolume
from .validate import scanline_data_pointers

FORMAT = "rle-splat"
VERSION = 2
HEADER = "header"
DECODING = "decoding"  # what the codes of short records are multiplied by
# What zipfile, numpy's reader of array headers (a Python literal) and the checks below raise at damaged files.
DAMAGE = (
    zipfile.BadZipFile, struct.error, tokenize.TokenError, SyntaxError, EOFError, LookupError, ValueError, TypeError,
    AttributeError, OverflowError, RuntimeError,
)  # fmt: skip
LONGEST_REASON = 150  # characters
CHUNK_BYTES = 1 << 24  # read at once, so that no table is ever held twice


@dataclass(frozen=True, eq=False)
class StoredVolume:
    """What a `.rle` file holds.

    ``axes``: axis (0, 1, 2) -> RunLengthVolume, one at least, all of one shape and model.
    ``affine``: (4, 4) float64, voxel index to the volume's own space in ``unit``.
    ``unit_length``: world length of one unit for which the extinctions are (see ``classification.unit_length``).
    ``transfer_function``, ``lighting``: JSON-ready descriptions of what the colours were made with.
    ``source``: name of the file the volume was read from.
    """

    axes: dict
    affine: np.ndarray
    unit: str = "mm"
    unit_length: float = 1.0
    transfer_function: object = None
    lighting: object = None
    source: str = ""
    remarks: tuple = field(default=())

    @property
    def shape_xyz(self) -> tuple[int, int, int]:
        return self._any_axis.shape_xyz

    @property
    def spacing(self) -> np.ndarray:
        """(3,) float64: distance between neighbouring voxel centres along x, y, z, in ``unit``."""
        return np.linalg.norm(self.affine[:3, :3], axis=0)

    @property
    def model(self) -> str:
        return self._any_axis.model

    @property
    def record(self) -> int:
        """Bytes of a voxel's record."""
        return self._any_axis.record

    @property
    def _any_axis(self) -> RunLengthVolume:
        return next(iter(self.axes.values()))


def save(path, stored: StoredVolume) -> None:
    """Write a `.rle` file; the old one stays until the new one is whole.  RleSplatError when it cannot be written."""
    if len({(e.shape_xyz, e.model, e.record) for e in stored.axes.values()}) != 1:
        raise RleSplatError("A .rle file holds at least one encoding, and all of the same volume, model and record.")
    header = {
        "format": FORMAT, "version": VERSION, "shape_xyz": list(stored.shape_xyz), "model": stored.model,
        "record": stored.record,
        "axes": [AXIS_NAMES[axis] for axis in sorted(stored.axes)],
        "affine": np.asarray(stored.affine).tolist(), "unit": stored.unit, "unit_length": stored.unit_length,
        "transfer_function": stored.transfer_function, "lighting": stored.lighting, "source": stored.source,
        "remarks": list(stored.remarks),
    }
    members = {HEADER: np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)}
    for axis in sorted(stored.axes):
        members.update({_member(axis, table): getattr(stored.axes[axis], table) for table in TABLES})
        if stored.axes[axis].decoding is not None:
            members[_member(axis, DECODING)] = stored.axes[axis].decoding
    path = Path(path)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with open(unfinished, "wb") as file:
            np.savez(file, **members)
        os.replace(unfinished, path)
    except OSError as problem:
        raise RleSplatError(f"Cannot write {path}: {problem.strerror or problem}.") from None
    finally:  # also when the user interrupts: nothing half-made is left behind
        unfinished.unlink(missing_ok=True)


def load(path) -> StoredVolume:
    """Read and validate a `.rle` file; RleSplatError, in one sentence, for anything that is not one."""
    try:
        with open(path, "rb") as file, zipfile.ZipFile(file) as archive:
            return _read(archive, os.fstat(file.fileno()).st_size)
    except RleSplatError as problem:
        raise RleSplatError(f"Cannot read {path}: {problem}") from None
    except DAMAGE as problem:
        told = str(problem).splitlines()[:1]
        reason = f" ({told[0][:LONGEST_REASON]})" if told else ""
        sentence = f"Cannot read {path}: it is not a whole .rle file{reason}; encode the volume again."
        raise RleSplatError(sentence) from None
    except OSError as problem:
        raise RleSplatError(f"Cannot read {path}: {problem.strerror or problem}.") from None


def _member(axis: int, table: str) -> str:
    return f"{AXIS_NAMES[axis]}_{table}"


def _read(archive: zipfile.ZipFile, file_bytes: int) -> StoredVolume:
    refuse_beyond(file_bytes, "its tables need", "encode fewer principal axes, or shorter voxel records")
    header = _read_header(_read_array(archive, HEADER, file_bytes))
    axes = {}
    for axis in header["axes"]:
        tables = [_read_array(archive, _member(axis, table), file_bytes) for table in TABLES]
        decoding = None
        if header["record"] != 16:
            decoding = _read_array(archive, _member(axis, DECODING), file_bytes)
        derived = scanline_data_pointers(axis, header["shape_xyz"], header["model"], *tables, decoding)
        axes[axis] = RunLengthVolume(axis, header["shape_xyz"], header["model"], *tables, derived, decoding)
        if axes[axis].record != header["record"]:
            raise ValueError("its voxel data are not of the kind it names")
        if not axes[axis].most_color <= 2.0 * BRIGHTEST:  # twice, since short records are rounded
            raise ValueError(f"its colours are brighter than {BRIGHTEST:g}, where white is 1")
    return StoredVolume(
        axes, header["affine"], header["unit"], header["unit_length"], header["transfer_function"],
        header["lighting"], header["source"], tuple(header["remarks"]),
    )


def _read_array(archive: zipfile.ZipFile, name: str, file_bytes: int) -> np.ndarray:
    """One `.npy` member in native byte order and C order; its claims are held against the file's size first."""
    entry = archive.getinfo(f"{name}.npy")
    if entry.compress_type != zipfile.ZIP_STORED or entry.file_size > file_bytes:
        raise ValueError(f"{name} is compressed or cut short")
    with archive.open(entry) as member:
        major = np.lib.format.read_magic(member)[0]
        read_claims = np.lib.format.read_array_header_1_0 if major == 1 else np.lib.format.read_array_header_2_0
        shape, fortran_order, dtype = read_claims(member)
        n_bytes = math.prod(shape) * dtype.itemsize
        if dtype.hasobject or fortran_order or not dtype.isnative or n_bytes != entry.file_size - member.tell():
            raise ValueError(f"{name} is not the array it says it is")
        content = np.empty(n_bytes, dtype=np.uint8)
        for start in range(0, n_bytes, CHUNK_BYTES):  # the archive verifies its checksum when the last byte is read
            part = content[start : start + CHUNK_BYTES]
            if member.readinto(part) != len(part):
                raise EOFError(f"{name} ends early")
    return content.view(dtype).reshape(shape)


def _read_header(stored: np.ndarray) -> dict:
    """The JSON header with its values checked, axis names as numbers and the affine as a matrix."""
    header = json.loads(stored.tobytes().decode())
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise ValueError("its header is not one of ours")
    if header.get("version") != VERSION:
        raise RleSplatError(
            f"it has format version {header.get('version')} and this program reads version {VERSION}; encode it again."
        )
    shape, names = header["shape_xyz"], header["axes"]
    if not (isinstance(shape, list) and len(shape) == 3 and all(type(n) is int and n > 0 for n in shape)):
        raise ValueError("its shape is not three whole numbers")
    if not (isinstance(names, list) and names and set(map(str, names)) <= set(AXIS_NAMES)):
        raise ValueError("it names no principal axis")
    if header["record"] not in RECORDS:
        raise ValueError("its voxel records have an unknown size")
    length = header["unit_length"]
    if not (isinstance(length, (int, float)) and math.isfinite(length) and length > 0.0):
        raise ValueError("its unit length is not a number above zero")
    if not (isinstance(header["unit"], str) and isinstance(header["source"], str)):
        raise ValueError("its unit or its source is not text")
    if not isinstance(header["remarks"], list):
        raise ValueError("its remarks are not a list")
    return {
        **header, "shape_xyz": tuple(shape), "axes": [axis for axis in AXES if AXIS_NAMES[axis] in names],
        "affine": as_matrix(header["affine"], "its affine"), "unit_length": float(length),
    }
