"""Voxels read in pieces from files and from packed streams, so that reading can be canceled at any time."""

from __future__ import annotations

import bz2
import gzip
import math
import os
import zlib
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..runtime.memory import READING_REMEDY, bytes_text, refuse_beyond
from ..runtime.steps import Progress, map_steps, rescale
from ..scene import RleSplatError
from ..volume.volume import STORED_TYPES
from .format import GZIP_MAGIC, GZIP_WINDOW
from .layout import CHUNK_BYTES, DEFLATE_LIMIT, UNREADABLE, is_gzip, unreadable

ZLIB_WINDOW = 15  # zlib's window bits for data with a zlib header
BZIP2_LIMIT = 1 << 20  # bzip2 cannot expand data more than about this many times
LEAST_MAPPED = 1 << 28  # bytes of voxels from which a file is mapped: a smaller one is copied, and may be replaced
EXPANSION = {None: 1, "gzip": DEFLATE_LIMIT, "zlib": DEFLATE_LIMIT, "bzip2": BZIP2_LIMIT}  # packing -> largest factor


BOOKMARKS = 64  # 40 KB each
_bookmarks: dict = {}  # (file, unpacked bytes before) -> packed bytes before, decoder


class _InflatedStream:
    """Unpacked bytes of a gzip or zlib stream; the members of a gzip file follow one another.

    A packed stream can only be read from its begin on.  Bookmarks are where earlier ones of the same file ended: frames
    in turn are unpacked once each.
    """

    def __init__(self, stream, window: int):
        self._stream, self._window = stream, window
        self._decoder, self._input = zlib.decompressobj(window), b""
        status = os.fstat(stream.fileno())
        self._file = status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, stream.tell()
        self._position = 0

    def go_to_bookmark(self, position: int) -> int:
        """Go on at the last bookmark up to a position of the unpacked bytes; return where it is, 0 without one."""
        marks = {at: mark for (file, at), mark in _bookmarks.copy().items() if file == self._file and at <= position}
        self._position = max(marks, default=0)
        if marks:
            packed, decoder = marks[self._position]
            self._stream.seek(packed)
            self._decoder = decoder.copy()
        return self._position

    def put_bookmark(self) -> None:
        """Let later streams of the file go on here."""
        _bookmarks[self._file, self._position] = self._stream.tell() - len(self._input), self._decoder.copy()
        if len(_bookmarks) > BOOKMARKS:
            _bookmarks.pop(next(iter(_bookmarks)), None)

    def readinto(self, view) -> int:
        """Fill a view with up to its length of bytes; return how many, 0 at the end."""
        while True:
            if self._decoder.eof:
                self._input = self._decoder.unused_data or self._stream.read(CHUNK_BYTES)
                if self._window == ZLIB_WINDOW or not self._input.strip(b"\0"):  # gzip files may end in zeros
                    return 0
                self._decoder = zlib.decompressobj(self._window)
            if not self._input:
                self._input = self._stream.read(CHUNK_BYTES)
            data = self._decoder.decompress(self._input, len(view))
            ended = not self._input and not data and not self._decoder.eof
            self._input = self._decoder.unconsumed_tail
            if ended:
                raise EOFError
            if data:
                view[: len(data)] = data
                self._position += len(data)
                return len(data)


@contextmanager
def open_stream(path, offset: int = 0, packing: str | None = None):
    """Context manager: a source of bytes with ``readinto(view)``, from ``offset`` of a file on.

    ``packing``: None, "gzip", "zlib" or "bzip2". A failure of the system or of unpacking becomes a RleSplatError.
    """
    try:
        with open(path, "rb", buffering=0) as stream:
            stream.seek(offset)
            if packing is None:
                yield stream
            elif packing == "gzip" and stream.read(len(GZIP_MAGIC)) != GZIP_MAGIC:
                raise gzip.BadGzipFile
            elif packing == "bzip2":
                with bz2.open(stream, "rb") as source:
                    yield source
            else:
                stream.seek(offset)
                yield _InflatedStream(stream, GZIP_WINDOW if packing == "gzip" else ZLIB_WINDOW)
    except UNREADABLE as problem:
        raise unreadable(path, problem) from None


class EndsEarly(RleSplatError):
    """A file holds fewer bytes than its header says."""


def breaks_off(path, found: int, wanted: int) -> EndsEarly:
    """The error for a file that holds fewer bytes of voxels than its header says."""
    return EndsEarly(f"{Path(path).name} breaks off: {found} of {wanted} bytes of voxels are there; copy it again.")


def grid_text(shape, dtype) -> str:
    """Shape, type and bytes of voxels for a message."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    return f"{' x '.join(map(str, shape))} voxels of {np.dtype(dtype).name}, {bytes_text(size)}"


def allocate(path, shape, dtype, held: int | None = None) -> np.ndarray:
    """An empty array (nz, ny, nx) for the voxels of a file.

    Parameters
    ----------
    path : str or Path
        Named in messages.
    shape : (nx, ny, nz)
    dtype : numpy.dtype
    held : int or None
        The most bytes of voxels that the file can hold, however well they are packed; None if that is not known.

    Raises
    ------
    RleSplatError
        If the file cannot hold the voxels, or they do not fit into free memory. Nothing is allocated then.
    """
    needed = math.prod(shape) * np.dtype(dtype).itemsize
    if held is not None and needed > held:
        raise breaks_off(path, held, needed)
    what = f"The {' x '.join(map(str, shape))} voxels of {Path(path).name}"
    refuse_beyond(needed, f"{what} need", READING_REMEDY)
    try:
        return np.empty(shape[::-1], dtype=dtype)
    except MemoryError:
        raise RleSplatError(f"{what} do not fit into memory; {READING_REMEDY}.") from None


def bytes_held(path, offset: int = 0, packing: str | None = None) -> int:
    """The most bytes that a file can hold from ``offset`` on, unpacked."""
    try:
        return max(0, os.path.getsize(path) - offset) * EXPANSION[packing]
    except OSError as problem:
        raise unreadable(path, problem) from None


def fill_steps(path, source, target: np.ndarray, doing: str):
    """Generator of Progress: fill an array with the next bytes of a source; ``path`` is named in messages."""
    view = memoryview(target.reshape(-1).view(np.uint8))
    filled = 0
    while filled < len(view):
        try:
            count = source.readinto(view[filled : filled + CHUNK_BYTES])
        except EOFError:
            count = 0
        if not count:
            raise breaks_off(path, filled, len(view))
        filled += count
        yield Progress(filled / len(view), doing)


def skip_steps(path, source, count: int, doing: str):
    """Generator of Progress: read ``count`` bytes of a packed source and drop them."""
    scratch = np.empty(min(count, CHUNK_BYTES), np.uint8)
    for left in range(count, 0, -CHUNK_BYTES):
        yield from map_steps(fill_steps(path, source, scratch[:left], doing), lambda _: Progress(0.0, doing))


def bytes_steps(path, count: int, packing: str | None = None):
    """Generator of Progress: the first ``count`` bytes of a file, unpacked."""
    content = np.empty(count, dtype=np.uint8)
    with open_stream(path, 0, packing) as source:
        yield from fill_steps(path, source, content, f"reading {Path(path).name}")
    return content.tobytes()


@dataclass(frozen=True)
class Part:
    """One of the files that hold the voxels of a volume one after the other.

    Attributes
    ----------
    offset : int
        Bytes of the file before the data, or before the packed stream.
    packing : str or None
        None, "gzip", "zlib" or "bzip2".
    skip : int
        Bytes of the unpacked data before the voxels.
    """

    path: Path
    offset: int = 0
    packing: str | None = None
    skip: int = 0

    @property
    def held(self) -> int:
        """The most bytes of voxels that it can hold."""
        return max(0, bytes_held(self.path, self.offset, self.packing) - self.skip)


def map_file(path, shape, dtype, offset: int) -> np.ndarray | None:
    """Voxels of an unpacked file, mapped into memory read-only, so that only what is looked at is read.

    Parameters
    ----------
    path : Path
    shape : (nx, ny, nz)
    dtype : numpy.dtype
        In the byte order of the file.
    offset : int
        Bytes of the file before the voxels.

    Returns
    -------
    (nz, ny, nx) ndarray or None
        None where kernels could not read them there: of another byte order or type, or not aligned.
    """
    dtype = np.dtype(dtype)
    if not dtype.isnative or dtype.name not in STORED_TYPES or offset % dtype.alignment:
        return None
    try:
        return np.asarray(np.memmap(path, dtype=dtype, mode="r", offset=offset, shape=tuple(shape)[::-1]))
    except OSError as problem:
        raise unreadable(path, problem) from None


def _map_part(shape, dtype, parts, begin: int) -> np.ndarray | None:
    """``map_file`` voxels of a large volume in one unpacked file that is long enough; else None."""
    size = math.prod(shape) * dtype.itemsize
    if len(parts) != 1 or parts[0].packing is not None or not LEAST_MAPPED <= size <= parts[0].held - begin:
        return None
    return map_file(parts[0].path, shape, dtype, parts[0].offset + parts[0].skip + begin)


def voxel_steps(path, shape, dtype, parts, begin: int = 0, part_bytes: int | None = None):
    """Generator of Progress: read voxels, x fastest.

    Parameters
    ----------
    path : str or Path
        Named in messages.
    shape : (nx, ny, nz)
    dtype : numpy.dtype
        In the byte order of the files.
    parts : sequence of Part
    begin : int
        Bytes of voxels, over all parts, before the first that is wanted.
    part_bytes : int or None
        Bytes of voxels in each part; None if there is one part.

    Returns
    -------
    (nz, ny, nx) ndarray
        In native byte order; one of STORED_TYPES. A large volume in one unpacked file is mapped (see ``map_file``).
    """
    dtype = np.dtype(dtype)
    in_file = _map_part(shape, dtype, parts, begin)
    if in_file is not None:
        return in_file
    doing = f"reading {Path(path).name} ({grid_text(shape, dtype)})"
    size = math.prod(shape) * dtype.itemsize
    each = size + begin if part_bytes is None else part_bytes
    voxels = allocate(path, shape, dtype, max(0, sum(min(part.held, each) for part in parts) - begin))
    yield Progress(0.0, doing)
    target = voxels.reshape(-1).view(np.uint8)
    for number, part in enumerate(parts):
        first, last = max(number * each, begin), min((number + 1) * each, begin + size)
        if first < last:
            filled = target[first - begin : last - begin]
            share = (first - begin) / size, (last - begin) / size
            yield from rescale(_part_steps(part, first - number * each, filled, doing), *share)
    return (yield from storable_steps(voxels, doing))


def _part_steps(part: Part, begin: int, target: np.ndarray, doing: str):
    """Generator of Progress: fill an array with the bytes of a part from ``begin`` on."""
    before = part.skip + begin
    with open_stream(part.path, part.offset + (0 if part.packing else before), part.packing) as source:
        inflates = isinstance(source, _InflatedStream)
        begun = source.go_to_bookmark(before) if inflates else 0
        yield from skip_steps(part.path, source, before - begun if part.packing else 0, doing)
        yield from fill_steps(part.path, source, target, doing)
        if inflates:
            source.put_bookmark()
        if part.packing:
            source.readinto(memoryview(bytearray(1)))  # at its end a packed stream compares its checksum


def storable_steps(voxels: np.ndarray, doing: str):
    """Generator of Progress: convert voxels to native byte order and a stored type.

    64-bit integers become int32 if all fit, else float64; float16 becomes float32 and bool uint8.
    """
    if voxels.dtype == np.bool_:
        return voxels.view(np.uint8)
    if not voxels.dtype.isnative:
        for plane in voxels:
            plane.byteswap(inplace=True)
            yield Progress(1.0, doing)
        voxels = voxels.view(voxels.dtype.newbyteorder("="))
    if voxels.dtype.kind in "iu" and voxels.dtype.itemsize == 8:
        bounds, fits = np.iinfo(np.int32), True
        for plane in voxels:
            fits = fits and bounds.min <= plane.min() and plane.max() <= bounds.max
            yield Progress(1.0, doing)
        return (yield from convert_steps(voxels, np.int32 if fits else np.float64, doing))
    if voxels.dtype == np.float16:
        return (yield from convert_steps(voxels, np.float32, doing))
    return voxels


def convert_steps(voxels: np.ndarray, dtype, doing: str):
    """Generator of Progress: the voxels in another type, plane by plane."""
    needed = voxels.size * np.dtype(dtype).itemsize
    refuse_beyond(needed, "A copy of the voxels in another type needs", READING_REMEDY)
    converted = np.empty(voxels.shape, dtype=dtype)
    for plane, target in zip(voxels, converted):
        target[...] = plane
        yield Progress(1.0, doing)
    return converted


@contextmanager
def open_to_write(path):
    """Context manager: a stream that writes a file, packed with gzip if its name ends in .gz.

    The gzip header has neither a name nor a time, so that equal volumes give equal files.
    """
    with open(path, "wb") as stream:
        if not is_gzip(path):
            yield stream
            return
        with gzip.GzipFile(filename="", mode="wb", fileobj=stream, mtime=0, compresslevel=6) as packed:
            yield packed


def write_voxel_steps(voxels: np.ndarray, stream):
    """Generator of Progress: write voxels (nz, ny, nx) to a stream, little-endian, x fastest."""
    little = voxels.dtype.newbyteorder("<")
    for z, plane in enumerate(voxels):
        stream.write(np.ascontiguousarray(plane, dtype=little).data)
        yield Progress((z + 1) / len(voxels), "writing voxels")


def plain_name(path) -> str:
    """The file's name without its suffixes."""
    name = Path(path).name
    return name.split(".")[0] or name
