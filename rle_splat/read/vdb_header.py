"""Whether a file is OpenVDB's and whether all of it is there, seen from its own table of positions.

OpenVDB itself meets a file that was cut off with anything from an exception to the end of the whole process,
depending on the build, so this is asked first.  Layout of a file: magic, version, library version, a flag for
positions, a UUID, metadata, the number of grids; then for each grid its name, type, instance parent and the three
positions of tree, blocks and end, where the next grid's entry stands.  At the tree's position: how it is compressed,
metadata, the transform, the number of buffers, the background and how many tiles and children the root has.  A
number of things that the file has no room for would keep the library busy for hours, or take all memory.
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
# Bytes of a transform by its type; of others the root is not looked at.
MAP_BYTES = {
    b"UniformScaleMap": 120, b"ScaleMap": 120, b"UniformScaleTranslateMap": 144, b"ScaleTranslateMap": 144,
    b"TranslationMap": 24, b"AffineMap": 128,
}  # fmt: skip
VALUE_BYTES = {b"float": 4, b"double": 8, b"int32": 4, b"int64": 8, b"bool": 1}
DELAYED = b"__delayedload"  # metadata that begin with the number of leaves, for which the library takes memory
LEAF_BYTES = 64  # of the file, at the least
CHILD_VOXELS = 4096  # along an edge of the root's children in trees of 32, 16 and 8 along an edge
PLACE_BYTES = 12  # of a tile or child: three int32


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
    _metadata(stream, size)
    grids = _count(stream)
    if not has_positions:
        return
    for _ in range(grids):
        _text(stream)  # its name
        kind, parent = _text(stream), _text(stream)
        tree, blocks, end = _numbers(stream, "<qqq")
        if not stream.tell() <= tree <= blocks <= end <= size:
            raise _CutShort
        stream.seek(tree)
        _walk_tree(stream, blocks, kind, is_instance=bool(parent))
        stream.seek(end)


def _walk_tree(stream, blocks: int, kind: bytes, is_instance: bool) -> None:
    """What stands between a tree's position and its ``blocks``, as far as it holds numbers of things."""
    _numbers(stream, "<I")  # how it is compressed
    _metadata(stream, blocks)
    transform = _text(stream)
    value = VALUE_BYTES.get(kind.split(b"_")[1] if kind.startswith(b"Tree_") else b"")
    if is_instance or value is None or transform not in MAP_BYTES:
        return
    _skip(stream, blocks, MAP_BYTES[transform])
    _numbers(stream, "<I")  # buffers
    _skip(stream, blocks, value)  # the background
    tiles, children = _numbers(stream, "<II")
    if stream.tell() + tiles * (PLACE_BYTES + value + 1) + children * PLACE_BYTES > blocks:
        raise _CutShort
    if children and kind.endswith(b"_5_4_3"):
        _skip(stream, blocks, tiles * (PLACE_BYTES + value + 1))
        if any(place % CHILD_VOXELS for place in _numbers(stream, "<iii")):  # of the first; others lie behind it
            raise _CutShort


def _metadata(stream, end: int) -> None:
    """Past names, types and values that have to end before ``end``."""
    for _ in range(_count(stream)):
        _text(stream)
        kind, length = _text(stream), _count(stream)
        begin = stream.tell()
        _skip(stream, end, length)
        if kind == DELAYED and length >= 4:
            stream.seek(begin)
            if _count(stream) * LEAF_BYTES > end:
                raise _CutShort
            stream.seek(begin + length)
        elif kind == b"string":
            stream.seek(begin)
            _decoded(_bytes(stream, length))


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
    return _decoded(_bytes(stream, length))


def _decoded(text: bytes) -> bytes:
    """The same text; the library's Python module may end the process when it is not UTF-8."""
    try:
        text.decode("utf-8")
    except UnicodeDecodeError:
        raise _CutShort from None
    return text


def _skip(stream, end: int, count: int) -> None:
    if stream.tell() + count > end:
        raise _CutShort
    stream.seek(count, os.SEEK_CUR)
