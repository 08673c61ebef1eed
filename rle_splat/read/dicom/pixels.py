"""Stored voxels of pictures, slice by slice: where each frame is in its file, and decoding it."""

import hashlib
import struct
from contextlib import suppress

import numpy as np

from . import elements as read
from .codestream import code_header
from .decoders import Order, decode_frames
from .pictures import JPEG, RLE, ImageFrame, Storage
from .refusals import breaks_off, damage_error, frame_damage_error, wrong_frame
from .values import choose_dtype, extract_stored_values

CODE_HEAD = 1 << 16  # bytes of a compressed frame that its header is looked for in
STARTS = (b"\xff\xd8", b"\xff\x4f")  # of JPEG and JPEG 2000 codestreams
RLE_RATIO = 64  # run-length encoding cannot shrink data more than this many times


def decode_planes(pictures):
    """Generator: decode pictures; Refused if a file breaks off, is damaged, or a frame cannot be decoded.

    Parameters
    ----------
    pictures : sequence of ImageFrame

    Yields
    ------
    (int, ndarray) or None
        The number of a picture and its stored voxels (rows, columns), in any order; None when none is ready.
    """
    places = {}
    for picture in pictures:
        storage = picture.storage
        if not storage.native and storage.path not in places:
            places[storage.path] = _fragments(storage)
            _check_compressed(picture, places[storage.path])
            yield None
    compressed = [i for i, picture in enumerate(pictures) if not picture.storage.native]
    rle = [i for i in compressed if pictures[i].storage.syntax == RLE]
    yield from _native_planes(pictures, [i for i, picture in enumerate(pictures) if picture.storage.native])
    for i in rle:
        yield i, _rle_plane(pictures[i], places)
    yield from _child_planes(pictures, sorted(set(compressed) - set(rle)), places)


def _native_planes(pictures, chosen):
    """Generator: planes of pictures that are not compressed, in their files' order."""
    by_path = {}
    for i in chosen:
        by_path.setdefault(pictures[i].storage.path, []).append(i)
    for numbers in by_path.values():
        storage = pictures[numbers[0]].storage
        try:
            with read.Bounded(storage.path) as stream:
                inflated = stream
                if storage.syntax in read.DEFLATED:
                    read.to_dataset(stream)
                    inflated = yield from read.inflate(stream)  # in which offsets count
                for i in numbers:
                    yield i, _native_plane(inflated, storage, pictures[i].number)
        except read.problems():
            raise damage_error(storage.path) from None


def _native_plane(stream, storage: Storage, frame: int) -> np.ndarray:
    """Stored voxels (rows, columns) of one frame that is not compressed."""
    start, end = (k * storage.frame_bits for k in (frame, frame + 1))
    first, last = start // 8, -(-end // 8)
    swapped = not storage.little_endian and storage.allocated <= 8 and storage.words
    if swapped:  # the two bytes of a word are in reverse order
        first, last = first - first % 2, last + last % 2
    data = bytearray(last - first)
    stream.seek(storage.offset + first)
    there = stream.readinto(data)
    if there < -(-end // 8) - first:
        raise breaks_off(storage.path, first + there, storage.total_bytes)
    if swapped:
        data = np.frombuffer(data, np.uint16).byteswap().view(np.uint8)
    if storage.allocated == 1:
        bits = np.unpackbits(np.frombuffer(data, np.uint8), bitorder="little")
        return bits[start - 8 * first : end - 8 * first].reshape(storage.rows, storage.columns)
    words = np.frombuffer(data, np.uint8)[start // 8 - first : end // 8 - first]
    return _plane(words.view(_file_dtype(storage)), storage, storage.stored, storage.high)


def _file_dtype(storage: Storage) -> np.dtype:
    letter = "u" if storage.kind == "integer" else "f"
    return np.dtype(f"{'<' if storage.little_endian else '>'}{letter}{storage.allocated // 8}")


def _plane(words: np.ndarray, storage: Storage, bits: int, high: int) -> np.ndarray:
    """Stored voxels (rows, columns) from allocated words in any byte order."""
    if not words.dtype.isnative:
        words = words.byteswap().view(words.dtype.newbyteorder("="))
    if storage.kind == "integer":
        words = extract_stored_values(words, bits, high, storage.signed, choose_dtype(storage))
    return words.reshape(storage.rows, storage.columns)


def _rle_plane(picture: ImageFrame, places) -> np.ndarray:
    """Stored voxels of one run-length-encoded frame, decoded by pydicom in Python."""
    from pydicom.encaps import encapsulate
    from pydicom.pixels import get_decoder

    storage = picture.storage
    if storage.allocated == 1:
        raise damage_error(storage.path)  # bytes are encoded, no bits
    data = _frame_data(storage, places[storage.path][picture.number])
    try:
        words = read.quietly(
            get_decoder(RLE).as_array, encapsulate([data]), index=0, raw=True, decoding_plugin="pydicom",
            rows=storage.rows, columns=storage.columns, samples_per_pixel=1, number_of_frames=1,
            photometric_interpretation="MONOCHROME2", pixel_representation=0, bits_allocated=storage.allocated,
            bits_stored=storage.allocated, pixel_keyword="PixelData",
        )[0]  # fmt: skip
    except read.problems():
        raise frame_damage_error(storage.path, picture.number) from None
    return _plane(np.ascontiguousarray(words).reshape(-1), storage, storage.stored, storage.high)


def _child_planes(pictures, chosen, places):
    """Generator: planes that child processes decode."""
    orders = []
    for i in chosen:
        storage, number = pictures[i].storage, pictures[i].number
        codec = "libjpeg" if storage.syntax in JPEG else "openjpeg"
        orders.append(Order(i, storage.path, number, codec, places[storage.path][number]))
    limit = max((pictures[i].storage.rows * pictures[i].storage.columns * 4 for i in chosen), default=0)
    for answer in decode_frames(orders, limit):
        if answer is None:
            yield None
            continue
        order, data = answer
        yield order.index, _decode_plane(pictures[order.index], data, places)


def _decode_plane(picture: ImageFrame, data: bytes, places) -> np.ndarray:
    """Stored voxels from what a decoder returned: words of one, two or four bytes, low bits used."""
    storage = picture.storage
    size, rest = divmod(len(data), storage.rows * storage.columns)
    if rest or size not in (1, 2, 4):
        raise frame_damage_error(storage.path, picture.number)
    precision = _header(storage, places[storage.path][picture.number]).precision
    bits = min(storage.stored, precision, 8 * size)
    words = np.frombuffer(data, f"u{size}")
    dtype = choose_dtype(storage)
    stored = extract_stored_values(words, bits, bits - 1, storage.signed, np.dtype(f"{dtype.kind}{size}"))
    return stored.astype(dtype, copy=False).reshape(storage.rows, storage.columns)


def _check_compressed(picture: ImageFrame, places) -> None:
    """Compare what a compressed file states with what its frames say, before memory is taken for them."""
    storage = picture.storage
    if storage.syntax == RLE:
        if sum(length for frame in places for _, length in frame) * RLE_RATIO < storage.total_bytes:
            raise damage_error(storage.path)
        return
    for number, fragments in enumerate(places):
        header = _header(storage, fragments)
        if header is None:
            raise frame_damage_error(storage.path, number)
        if header.components != 1:
            raise wrong_frame(storage.path, number, "a color picture", "gray values")
        if (header.rows, header.columns) != (storage.rows, storage.columns):
            raise wrong_frame(
                storage.path, number, f"{header.columns} x {header.rows} pixels",
                f"{storage.columns} x {storage.rows}",
            )  # fmt: skip


def _header(storage: Storage, fragments):
    """What a compressed frame says of itself."""
    return code_header(_frame_data(storage, fragments, CODE_HEAD))


def _frame_data(storage: Storage, fragments, most: int | None = None) -> bytes:
    """Bytes of a compressed frame, of its begin only with ``most``."""
    parts, there = [], 0
    try:
        with read.Bounded(storage.path) as stream:
            for offset, length in fragments:
                stream.seek(offset)
                parts.append(stream.read(length if most is None else min(length, most - there)))
                there += len(parts[-1])
                if most is not None and there >= most:
                    break
    except OSError:
        raise damage_error(storage.path) from None
    return b"".join(parts)


def _fragments(storage: Storage) -> list[tuple]:
    """For each frame of a compressed file, its fragments: ((offset, length), ...) in the file."""
    from pydicom.encaps import parse_basic_offsets, parse_fragments

    try:
        with read.Bounded(storage.path) as stream:
            stream.seek(storage.offset)
            table = parse_basic_offsets(stream)
            start = stream.tell()
            starts = parse_fragments(stream)[1]
            items = []
            for at in starts:
                stream.seek(at + 4)
                items.append((at + 8, struct.unpack("<L", stream.read(4))[0]))
            if storage.tables is not None:
                table = list(struct.unpack(f"<{len(storage.tables[0]) // 8}Q", storage.tables[0]))
            frames = _frames_of(items, [start + offset + 8 for offset in table], storage, stream)
    except read.problems():
        raise damage_error(storage.path) from None
    last = items[-1][0] + items[-1][1] if items else 0
    if last > storage.size:
        raise breaks_off(storage.path, storage.size - storage.offset, last - storage.offset)
    if len(frames) != storage.frames or not all(frames):
        raise damage_error(storage.path)
    return frames


def _frames_of(items, begins, storage: Storage, stream) -> list[tuple]:
    """Fragments (offset, length) of each frame; ``begins``: the table of offsets, empty if the file has none."""
    if storage.frames == 1:
        return [tuple(items)]
    if len(items) == storage.frames:
        return [(item,) for item in items]
    if len(begins) != storage.frames:  # no table: a frame begins where a codestream does
        begins = []
        for offset, _ in items:
            stream.seek(offset)
            if stream.read(2) in STARTS:
                begins.append(offset)
    ends = [*begins[1:], storage.size + 1]
    return [tuple(item for item in items if begin <= item[0] < end) for begin, end in zip(begins, ends)]


def voxel_hash(picture: ImageFrame) -> str:
    """Hash of a picture's voxels as they are stored, and of what they mean; "" if they cannot be read."""
    storage = picture.storage
    digest = hashlib.blake2b(repr((picture.slope, picture.intercept, storage.syntax)).encode(), digest_size=16)
    with suppress(*read.problems()):
        if storage.native:
            (plane,) = (found[1] for found in _native_planes([picture], [0]) if found is not None)
            digest.update(np.ascontiguousarray(plane))
        else:
            digest.update(_frame_data(storage, _fragments(storage)[picture.number]))
        return digest.hexdigest()
    return ""
