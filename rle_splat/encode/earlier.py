"""Import what versions 0.1 and 0.2 stored: files of numpy's members, voxel records of 6 and 4 bytes, and normals or
light on post-classified voxels.

A file was a zip archive of uncompressed `.npy` members, as written by numpy's `savez`: a JSON header, and the four
tables of each principal axis. It is opened as tables in memory. Folders were as they are. Short records are opened as
records of 8 bytes:

    bytes  color                       density: extinction or opacity
    6      11, 11 and 10 bits, linear  16-bit float
    4      7, 7 and 7 bits, linear     11 bits, the number of a density in the scales

Normals were unit gradients, x of all voxels, then y, then z; they are opened as a table SURFACE.  Light that was stored
cannot be made anew for samples, so that such a folder is unlit.
"""

import hashlib
import io
import json
import math
import zlib

import numpy as np

from ..runtime.memory import refuse_beyond
from ..scene import RleSplatError
from ..volume.axes import AXIS_NAMES
from .members import DAMAGE, NORMALS, ORDER_OF, SURFACE, FolderMembers, bytes_of, reason_of, words_of_entry
from .records import decoding_of, empty_records, float_of, words_of
from .reference import pack
from .tables import TABLES, RunLengthVolume
from .validate import check_color, check_header, check_records, scanline_starts

FORMAT, VERSION, HEADER = "rle-splat", 2, "header.npy"

TYPES = {6: np.uint16, 4: np.uint32}  # bytes of a record -> dtype of the array
WORDS = {6: 3, 4: 1}  # numbers of a record
SCALES = {6: 4, 4: 4 + 2048}  # red, green, blue and density; then the density of each code
COLOR_STEPS = {6: (2047, 2047, 1023), 4: (127, 127, 127)}  # largest code of red, green and blue
COLOR_BITS = {6: (0, 11, 22), 4: (0, 7, 14)}  # first bit of each
DENSITY_BIT = 21  # first bit of the density in 4 bytes
AT_ONCE = 1 << 20  # records converted at once, so that their numbers are not all in memory
MOST = 1e37  # bound of any scale
LIGHT = "light"  # table of the light on voxels
UNLIT = (
    "This .rle folder of an earlier version stores light on voxels, which is not used any more: its colors are shown "
    "without light; encode the volume again."
)


def lengthen(words: np.ndarray, scales) -> tuple[np.ndarray, np.ndarray]:
    """Convert records of 6 or 4 bytes to records of 8 bytes; ValueError if the scales do not fit the records.

    Parameters
    ----------
    words : (n, 3) ndarray of uint16, or (n,) or (n, 1) of uint32
    scales : (4,) or (2052,) ndarray of float32
        The decoding of the records.

    Returns
    -------
    voxel_data : (n,) ndarray of uint64
    decoding : (4,) ndarray of float32
        See ``records.decoding_of``.
    """
    record = {np.dtype(kind): record for record, kind in TYPES.items()}[words.dtype]
    scales, words = np.asarray(scales, np.float32), words.reshape(-1, WORDS[record])
    if scales.shape != (SCALES[record],) or not (scales.min() >= 0.0 and scales.max() <= MOST):
        raise ValueError("the scales of the voxel data are of the wrong size, or no numbers from 0 on")
    most_color = float((scales[:3] * np.array(COLOR_STEPS[record], np.float32)).max())
    decoding = decoding_of(8, float(scales[3:].max() if record == 6 else scales[4:].max()), most_color)
    voxel_data = empty_records(8, len(words))
    for first in range(0, len(words), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        pack(_numbers(words[part], record, scales), 1.0 / decoding.astype(np.float64), voxel_data[part])
    return voxel_data, decoding


def _numbers(words: np.ndarray, record: int, scales: np.ndarray) -> np.ndarray:
    """(n, 4) float32 (density * RGB, density) of records of 6 or 4 bytes."""
    if record == 6:
        density = float_of(words[:, 0]) * scales[3]
        codes = words[:, 1].astype(np.uint32) | (words[:, 2].astype(np.uint32) << np.uint32(16))
    else:
        codes = words[:, 0]
        density = scales[4:][codes >> np.uint32(DENSITY_BIT)]
    numbers = np.empty((len(words), 4), np.float32)
    for channel, (bit, steps) in enumerate(zip(COLOR_BITS[record], COLOR_STEPS[record])):
        color = ((codes >> np.uint32(bit)) & np.uint32(steps)).astype(np.float32) * scales[channel]
        numbers[:, channel] = density * color
    numbers[:, 3] = density
    return numbers


def lengthen_records(members, header: dict):
    """The members and the header of a folder; where its records have 6 or 4 bytes, those of 8 bytes in memory.

    Raises one of DAMAGE, or OSError.
    """
    record = header["record"]
    if record not in TYPES:
        return members, header
    header, scales, long = {**header, "record": 8, "dtypes": dict(header["dtypes"])}, header["decoding"], {}
    header["slabs"] = [[planes, dict(tables)] for planes, tables in header["slabs"]]
    for name in {f"{order}.records" for order in ORDER_OF.values()} & set(header["dtypes"]):
        refuse_beyond(2 * members.size(name), "its voxel records need", "encode the volume again")
        words, begin = members.array(name, np.dtype(TYPES[record]).newbyteorder("<")), 0
        long[name], decoding = lengthen(words, scales)
        header |= {"decoding": decoding.tolist()}
        header["dtypes"][name] = words_of_entry(words_of(long[name]))
        for _, tables in header["slabs"]:
            size, checksum = tables[name]
            first, last = begin // record, (begin + size) // record
            if zlib.crc32(bytes_of(words)[begin : begin + size]) != checksum:
                raise ValueError(f"the checksum of {name} does not fit")
            content = bytes_of(long[name][first:last])
            tables[name] = [len(content), zlib.crc32(content)]
            begin += size
    return _PartlyInMemory(members.path, long), header


def drop_light(header: dict) -> dict:
    """The header of post-classified tables as if nothing had lit them, where they have the light on voxels.

    Raises one of DAMAGE.
    """
    if not any(f"{order}.{LIGHT}" in header["dtypes"] for order in ORDER_OF.values()):
        return header
    kept = {name: entry for name, entry in header["dtypes"].items() if not name.endswith(f".{LIGHT}")}
    unlit = {**header["lighting"], "shaded": False}
    return {**header, "dtypes": kept, "light": None, "lighting": unlit, "remarks": [*header["remarks"], UNLIT]}


def turn_normals(of_voxels: dict) -> dict:
    """Tables of voxels by name: NORMALS (3, m), along the gradient, become SURFACE (m, 3), against it."""
    if NORMALS not in of_voxels:
        return of_voxels
    normals = of_voxels[NORMALS]
    refuse_beyond(normals.nbytes, "its normals need", "encode the volume again")
    codes = np.empty(normals.shape[::-1], np.int16)
    np.negative(np.maximum(normals.T, -np.iinfo(np.int16).max), out=codes)
    return {**{name: array for name, array in of_voxels.items() if name != NORMALS}, SURFACE: codes}


class _PartlyInMemory(FolderMembers):
    """Members of a folder, of which some, by name, are arrays."""

    def __init__(self, path, arrays: dict):
        super().__init__(path)
        self._arrays = arrays

    def size(self, name: str) -> int:
        return self._arrays[name].nbytes if name in self._arrays else super().size(name)

    def array(self, name: str, dtype) -> np.ndarray:
        return self._arrays[name] if name in self._arrays else super().array(name, dtype)


def read_file(members) -> dict | None:
    """Read the members of a file of an earlier version; RleSplatError if the file is damaged.

    Returns
    -------
    dict or None
        Arguments of ``StoredVolume.of``; None if the members are no such file.
    """
    if HEADER not in members.checksums:
        return None
    try:
        return _read(members)
    except RleSplatError as problem:
        raise RleSplatError(f"Cannot read {members.path}: {problem}") from None
    except DAMAGE as problem:
        raise RleSplatError(
            f"Cannot read {members.path}: it is not a complete .rle file{reason_of(problem)}; encode the volume again."
        ) from None


def _read(members) -> dict:
    """As ``read_file``; raises one of DAMAGE, too."""
    header = json.loads(_array(members, HEADER).tobytes().decode())
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise ValueError("its header is not that of a .rle file")
    if header.get("version") != VERSION:
        raise RleSplatError(f"its format version is {header.get('version')}, which is unknown; encode it again.")
    record = header["record"]
    facts = check_header({**header, "record": 8 if record in TYPES else record})
    shape, model, stored_as = (facts.pop(name) for name in ("shape_xyz", "model", "record"))
    needed = sum(members.size(name) for name in members.checksums)
    refuse_beyond(needed, "its tables need", "encode fewer principal axes, or use smaller voxel records")
    axes = {}
    for axis in facts.pop("axes"):
        name = AXIS_NAMES[axis]
        *pointers, runs, voxel_data = (_array(members, f"{name}_{table}.npy") for table in TABLES)
        decoding = None if record == 16 else _array(members, f"{name}_decoding.npy")
        if record in TYPES:
            voxel_data, decoding = lengthen(voxel_data, decoding)
        starts = scanline_starts(axis, shape, *pointers, runs, len(voxel_data))
        check_records(axis, voxel_data, decoding)
        axes[axis] = RunLengthVolume(axis, shape, *pointers, runs, starts, model, voxel_data, decoding)
        if axes[axis].record != stored_as:
            raise ValueError("its voxel data do not have the stated record size")
        check_color(axes[axis].most_color)
    stored = [(name, members.size(name), checksum) for name, checksum in members.checksums.items()]
    return {**facts, "axes": axes, "key": hashlib.blake2b(repr(stored).encode(), digest_size=16).hexdigest()}


def _array(members, name: str) -> np.ndarray:
    """A `.npy` member (native byte order, C order), whose checksum and header are compared with its bytes."""
    if name not in members.checksums:
        raise ValueError(f"{name} is missing")
    content = members.array(name, np.uint8)
    if zlib.crc32(content) != members.checksums[name]:
        raise ValueError(f"the checksum of {name} does not fit")
    member = io.BytesIO(content[: 1 << 16])
    major = np.lib.format.read_magic(member)[0]
    read_claims = np.lib.format.read_array_header_1_0 if major == 1 else np.lib.format.read_array_header_2_0
    shape, fortran_order, dtype = read_claims(member)
    numbers = content[member.tell() :]
    if dtype.hasobject or fortran_order or not dtype.isnative or math.prod(shape) * dtype.itemsize != len(numbers):
        raise ValueError(f"{name} does not match its own header")
    return numbers.view(dtype).reshape(shape).copy()  # aligned, and whole whatever becomes of the file
