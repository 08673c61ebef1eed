"""Whether a file is OpenVDB's and whether all of it is there, seen from its own table of positions.

OpenVDB itself meets a file that was cut off with anything from an exception to the end of the whole process,
depending on the build, so this is asked first.  Layout of a file: magic, version, library version, a flag for
positions, a UUID, metadata, the number of grids; then for each grid its name, type, instance parent and the three
positions of tree, blocks and end, where the next grid's entry stands.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path

from ..scene import RleSplatError

MAGIC = b" BDV\0\0\0\0"  # the first eight bytes of every VDB file
LAYOUT_SINCE = 222  # file version from which the layout above holds; OpenVDB 3 wrote it in 2014
UUID_LENGTH = 36
NAME_LIMIT = 1 << 16  # bytes of a name or type; longer ones are read out of damaged data


class _CutShort(Exception):
    """The file ends, or makes no sense, before what its header announces."""


def check_header(path) -> None:
    """Raise a RleSplatError unless the file is OpenVDB's and as long as its own header says.

    Versions before 222 and files without positions are only checked for the magic number.
    """
    name = Path(path).name
    try:
        size = os.path.getsize(path)
        with open(path, "rb") as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise RleSplatError(f"{name} is not an OpenVDB file; check how it was written.")
            _walk(stream, size)
    except _CutShort:
        raise RleSplatError(
            f"{name} is damaged: its {size} bytes are fewer than its header announces, or make no sense; copy or "
            "export it again."
        ) from None
    except OSError as problem:
        raise RleSplatError(
            f"Cannot read {path}: {problem.strerror or problem}; check its place and permissions."
        ) from None


def _walk(stream, size: int) -> None:
    (version,) = _numbers(stream, "<I")
    if version < LAYOUT_SINCE:
        return
    _numbers(stream, "<II")  # the library's version
    (has_positions,) = _numbers(stream, "<B")
    _bytes(stream, UUID_LENGTH)
    for _ in range(_count(stream)):  # metadata: name, type, value
        _text(stream)
        _text(stream)
        _skip(stream, size, _count(stream))
    grids = _count(stream)
    if not has_positions:
        return
    for _ in range(grids):
        _text(stream), _text(stream), _text(stream)  # name, type, instance parent
        tree, blocks, end = _numbers(stream, "<qqq")
        if not stream.tell() <= tree <= blocks <= end <= size:
            raise _CutShort
        stream.seek(end)


def _bytes(stream, count: int) -> bytes:
    read = stream.read(count)
    if len(read) != count:
        raise _CutShort
    return read


def _numbers(stream, layout: str) -> tuple:
    return struct.unpack(layout, _bytes(stream, struct.calcsize(layout)))


def _count(stream) -> int:
    return _numbers(stream, "<I")[0]


def _text(stream) -> bytes:
    length = _count(stream)
    if length > NAME_LIMIT:
        raise _CutShort
    return _bytes(stream, length)


def _skip(stream, size: int, count: int) -> None:
    if stream.tell() + count > size:
        raise _CutShort
    stream.seek(count, os.SEEK_CUR)
