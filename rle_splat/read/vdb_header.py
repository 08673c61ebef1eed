"""Check that a file is an OpenVDB file and complete, before OpenVDB reads it.

A truncated file can end the whole process in some builds of OpenVDB. A damaged count can keep the library busy for
hours or exhaust the memory. Layout of a file: magic, version, library version, a flag for offsets, a UUID, metadata,
the number of grids. Then for each grid: name, type, instance parent and the three offsets of tree, blocks and end,
where the next grid follows. At the tree's offset: compression, metadata, the transform, the number of buffers, the
background and the numbers of tiles and children of the root.
"""

import os
import struct
from pathlib import Path

from ..scene import RleSplatError

MAGIC = b" BDV\0\0\0\0"  # the first eight bytes of every VDB file
LAYOUT_SINCE = 222  # first file version with the layout above; OpenVDB 3 wrote it in 2014
UUID_LENGTH = 36
NAME_LIMIT = 1 << 16  # bytes of a name or type; longer ones come from damaged data
# Bytes of a transform by its type. With any other transform the root is not checked.
MAP_BYTES = {
    b"UniformScaleMap": 120, b"ScaleMap": 120, b"UniformScaleTranslateMap": 144, b"ScaleTranslateMap": 144,
    b"TranslationMap": 24, b"AffineMap": 128,
}  # fmt: skip
VALUE_BYTES = {b"float": 4, b"double": 8, b"int32": 4, b"int64": 8, b"bool": 1}
DELAYED = b"__delayedload"  # metadata that begin with the number of leaves, for which the library allocates memory
LEAF_BYTES = 64  # least bytes of a leaf in the file
CHILD_VOXELS = 4096  # along an edge of the root's children in trees of 32, 16 and 8 along an edge
INDEX_BYTES = 12  # bytes of the index of a tile or child: three int32


class _CutShort(Exception):
    """The file ends before what its header announces, or holds impossible values."""


def check_header(path: str | Path) -> None:
    """Check an OpenVDB file.

    Files of versions before 222 and files without offsets are only checked for the magic number.

    Raises
    ------
    RleSplatError
        If the file is not an OpenVDB file, is shorter than its header says, or cannot be read.
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
            f"{name} is damaged: its {size} bytes are too few for its header, or its header is invalid; copy or "
            "export it again."
        ) from None
    except OSError as problem:
        raise RleSplatError(
            f"Cannot read {path}: {problem.strerror or problem}; check the path and its permissions."
        ) from None


def _walk(stream, size: int) -> None:
    """Check the header and every grid of a file of ``size`` bytes."""
    (version,) = _numbers(stream, "<I")
    if version < LAYOUT_SINCE:
        return
    _numbers(stream, "<II")  # version of the library
    (has_positions,) = _numbers(stream, "<B")
    _bytes(stream, UUID_LENGTH)
    _metadata(stream, size)
    grids = _count(stream)
    if not has_positions:
        return
    for _ in range(grids):
        _text(stream)  # name of the grid
        kind, parent = _text(stream), _text(stream)
        tree, blocks, end = _numbers(stream, "<qqq")
        if not stream.tell() <= tree <= blocks <= end <= size:
            raise _CutShort
        stream.seek(tree)
        _walk_tree(stream, blocks, kind, is_instance=bool(parent))
        stream.seek(end)


def _walk_tree(stream, blocks: int, kind: bytes, is_instance: bool) -> None:
    """Check what lies between a tree's offset and its ``blocks``, as far as it holds counts."""
    _numbers(stream, "<I")  # compression
    _metadata(stream, blocks)
    transform = _text(stream)
    value = VALUE_BYTES.get(kind.split(b"_")[1] if kind.startswith(b"Tree_") else b"")
    if is_instance or value is None or transform not in MAP_BYTES:
        return
    _skip(stream, blocks, MAP_BYTES[transform])
    _numbers(stream, "<I")  # buffers
    _skip(stream, blocks, value)  # the background
    tiles, children = _numbers(stream, "<II")
    if stream.tell() + tiles * (INDEX_BYTES + value + 1) + children * INDEX_BYTES > blocks:
        raise _CutShort
    if children and kind.endswith(b"_5_4_3"):
        _skip(stream, blocks, tiles * (INDEX_BYTES + value + 1))
        if any(index % CHILD_VOXELS for index in _numbers(stream, "<iii")):  # of the first child; others follow it
            raise _CutShort


def _metadata(stream, end: int) -> None:
    """Skip metadata (names, types and values), which must end before ``end``."""
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
            _decode(_bytes(stream, length))


def _bytes(stream, count: int) -> bytes:
    """Read ``count`` bytes."""
    read = stream.read(count)
    if len(read) != count:
        raise _CutShort
    return read


def _numbers(stream, layout: str) -> tuple:
    """Read numbers by a ``struct`` layout."""
    return struct.unpack(layout, _bytes(stream, struct.calcsize(layout)))


def _count(stream) -> int:
    """Read an unsigned 32-bit number."""
    return _numbers(stream, "<I")[0]


def _text(stream) -> bytes:
    """Read a text with its length."""
    length = _count(stream)
    if length > NAME_LIMIT:
        raise _CutShort
    return _decode(_bytes(stream, length))


def _decode(text: bytes) -> bytes:
    """Return ``text`` if it is UTF-8; the library's Python module may end the process if it is not."""
    try:
        text.decode("utf-8")
    except UnicodeDecodeError:
        raise _CutShort from None
    return text


def _skip(stream, end: int, count: int) -> None:
    """Skip ``count`` bytes, which must end before ``end``."""
    if stream.tell() + count > end:
        raise _CutShort
    stream.seek(count, os.SEEK_CUR)
