"""Guess the layout of a raw file from its name, its size and the smoothness of its bytes.

A guess that is not certain is marked as such.
"""

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..runtime.steps import Progress, drain
from ..scene import RleSplatError
from ..volume.volume import STORED_TYPES
from .layout import (
    BYTE_ORDERS,
    CHUNK_BYTES,
    DEFAULT_COUNT_LIMIT,
    SMALL_HEADER,
    TYPE_OF_EACH_SIZE,
    UNREADABLE,
    RawLayout,
    is_gzip,
    open_bytes,
    unreadable,
)

COMMON_EDGES = (512, 256, 128, 64, 192, 320, 384, 1024, 768, 640, 160, 96, 2048, 100, 200, 300, 400, 500)
CANDIDATE_LIMIT = 8  # more than a person would read
CLEARLY_SMOOTHER = 0.7  # an interpretation counts as right if its mean step is below this share of the next best one
SAMPLE_BYTES = 1 << 20
SEARCHED_BYTES = 1 << 28  # bytes of a packed file of known layout searched for a sample: about a second

# Words in file names -> voxel type. A bare "8bit" and the like mean unsigned, as scanners use them.
TYPE_WORDS = {
    "uint8": "uint8", "u8": "uint8", "uchar": "uint8", "byte": "uint8", "8bit": "uint8", "8b": "uint8",
    "int8": "int8", "i8": "int8", "schar": "int8",
    "uint16": "uint16", "u16": "uint16", "ushort": "uint16", "16bit": "uint16", "16b": "uint16",
    "int16": "int16", "i16": "int16", "short": "int16", "sshort": "int16",
    "uint32": "uint32", "u32": "uint32", "uint": "uint32", "int32": "int32", "i32": "int32",
    "float32": "float32", "f32": "float32", "float": "float32",
    "float64": "float64", "f64": "float64", "double": "float64",
}  # fmt: skip
ORDER_WORDS = {"le": "little", "lsb": "little", "little": "little", "be": "big", "msb": "big", "big": "big"}
_TYPE = re.compile(
    r"(?<![a-z0-9])(" + "|".join(sorted(TYPE_WORDS, key=len, reverse=True)) + r")(?=(?:le|be|lsb|msb)?(?![a-z0-9]))"
)
# What can only mean a byte order: "little" and "big" with "endian", or after a type without a further word; the short
# words after a type, or after a separator without a further word. "big_head" and "le_crane" name heads.
_AFTER_TYPE = re.compile(r"[ .-]?(?:(le|be|lsb|msb)(?![a-z0-9])|(little|big)(?![a-z0-9])(?![ -]*[a-z]))")
_ORDER = re.compile(
    r"(?<![a-z0-9])(little|big)[ .-]?endian(?![a-z0-9])|(?<=[ .-])(le|be|lsb|msb)(?![a-z0-9])(?![ -]*[a-z])"
)
_SHAPE = re.compile(r"(?<!\d)(?<!\d\.)(\d{1,5})[x×](\d{1,5})[x×](\d{1,5})(?![\d.]\d|\d)")
_SHAPE_SPACED = re.compile(r"(?<!\d)(?<!\d\.)(\d{2,5})[_-](\d{2,5})[_-](\d{2,5})(?![\d])")
_CUBE = re.compile(r"(?<!\d)(?<!\d\.)(\d{2,4})(?:\^3|cubed|cube)(?![a-z0-9])")
_LENGTH = r"(\d*\.\d+|\d+)"
_SPACING = re.compile(rf"(?<![\d.]){_LENGTH}[x×]{_LENGTH}[x×]{_LENGTH}(?=mm)|"
                      rf"(?<![\d.])(\d*\.\d+)[x×](\d*\.\d+)[x×](\d*\.\d+)(?!\d)")  # fmt: skip
_HEADER = re.compile(r"(?:header|hdr|skip|offset)[_-]?(\d{1,6})(?!\d)")


@dataclass(frozen=True)
class RawGuess:
    """A proposed layout of a raw file.

    Attributes
    ----------
    shape : (nx, ny, nz) or None
        None if nothing indicates a shape.
    dtype : str or None
        One of STORED_TYPES; None if nothing indicates a type.
    byte_order : {"little", "big"}
    spacing : (sx, sy, sz) or None
        Spacing in the file's name.
    certain : bool
        Whether name, size and bytes agree on everything.
    reasons : tuple of str
        Sentences that explain the guess.
    candidates : tuple of RawLayout
        Layouts that fit the size, the most likely first.
    size : int or None
        Unpacked size in bytes; None if it was too large to count.
    """

    shape: tuple | None
    dtype: str | None
    byte_order: str
    header_bytes: int
    spacing: tuple | None
    certain: bool
    reasons: tuple
    candidates: tuple
    size: int | None


def guess_raw(
    path: str | Path, shape=None, dtype=None, byte_order=None, header_bytes=None, limit: int = DEFAULT_COUNT_LIMIT
) -> RawGuess:
    """Guess the layout of a raw file; RleSplatError if a known part is out of range or the file cannot be read.

    Parameters
    ----------
    shape, dtype, byte_order, header_bytes
        Known parts of the layout, as in RawLayout; None for unknown parts, which are guessed.
    limit : int
        Bytes after which counting the size of a packed file stops.
    """
    return drain(guess_raw_steps(path, shape, dtype, byte_order, header_bytes, limit))


def guess_raw_steps(path, shape=None, dtype=None, byte_order=None, header_bytes=None, limit: int = DEFAULT_COUNT_LIMIT):
    """Generator of Progress: guess as ``guess_raw`` does; return the RawGuess."""
    given = dict(shape=shape, dtype=dtype, byte_order=byte_order, header_bytes=header_bytes)
    # Constructed only to check the given values.
    RawLayout(**{"shape": (1, 1, 1), "dtype": "uint8", **{what: v for what, v in given.items() if v is not None}})
    size, sample = yield from _size_and_sample_steps(path, limit)
    name = _name_clues(Path(path).name)
    reasons = []
    known = dict(given)
    for what, value in known.items():
        if value is None and name.get(what) is not None and what != "byte_order":
            known[what] = name[what]
            text = " × ".join(map(str, name[what])) if what == "shape" else name[what]
            reasons.append(f"The file name gives {what.replace('dtype', 'type').replace('_', ' ')} {text}.")
    if name.get("spacing"):
        reasons.append("The file name gives spacing " + " × ".join(f"{s:g}" for s in name["spacing"]) + ".")
    if size is None:
        reasons.append(f"The file holds more than {limit} bytes, so its exact size is unknown.")
        candidates = ()
    else:
        candidates = _candidates(size, known)
        reasons.append(f"The file holds {size:,} bytes" + (" when unpacked." if is_gzip(path) else "."))
    named = name.get("byte_order")
    candidates, decided = _narrow_by_bytes(candidates, known, named, sample, reasons)
    if not candidates:
        if size is not None:
            reasons.append("No known layout fits this size.")
        header, order = known["header_bytes"] or 0, known["byte_order"]
        if order is None and known["dtype"] is not None:
            _, order, _ = _read_as(sample, header, (known["dtype"],), None, named, reasons)
        return RawGuess(
            known["shape"], known["dtype"], order or "little", header, name.get("spacing"), False, tuple(reasons), (),
            size,
        )  # fmt: skip
    best = candidates[0]
    certain = known["shape"] is not None and decided and (known["header_bytes"] is not None or not best.header_bytes)
    if not certain:
        reasons.append("This is a guess; compare it with what you know about the file.")
    return RawGuess(
        best.shape, best.dtype, best.byte_order, best.header_bytes, name.get("spacing"), certain,
        tuple(reasons), candidates[:CANDIDATE_LIMIT], size,
    )  # fmt: skip


def _size_and_sample_steps(path, limit: int):
    """Generator of Progress: the unpacked size (None beyond ``limit``) and up to 1 MiB of bytes.

    The bytes of a packed file are from where they vary most.
    """
    count, sample, best = 0, b"", -1.0
    doing = f"counting the bytes of {Path(path).name}"
    try:
        packed = is_gzip(path)
        with open_bytes(path) as stream:
            if not packed:
                count = stream.seek(0, 2)
                middle = max(0, (count - SAMPLE_BYTES) // 2)
                stream.seek(middle - middle % 8)
                return count, stream.read(SAMPLE_BYTES)
            while count <= limit:
                chunk = stream.read(CHUNK_BYTES)
                if not chunk:
                    return count, sample
                variety = float(np.var(np.frombuffer(chunk, dtype=np.uint8)[::61]))
                if variety > best and (len(chunk) == CHUNK_BYTES or not sample):
                    best, sample = variety, chunk
                count += len(chunk)
                yield Progress(0.0, doing)
            return None, sample
    except UNREADABLE as problem:
        raise unreadable(path, problem) from None


def _name_clues(name: str) -> dict:
    """Parts of the layout that the words and numbers of a file name state, by name of the part."""
    text, clues = name.lower(), {}
    spacing = _SPACING.search(text)
    if spacing:
        lengths = tuple(float(s) for s in spacing.groups() if s is not None)
        text = text[: spacing.start()] + " " + text[spacing.end() :]
        if min(lengths) > 0.0:
            clues["spacing"] = lengths
    header = _HEADER.search(text)
    if header:
        clues["header_bytes"] = int(header.group(1))
        text = text[: header.start()] + " " + text[header.end() :]
    shape = _SHAPE.search(text) or _SHAPE_SPACED.search(text)
    cube = _CUBE.search(text)
    if shape and all(int(n) > 0 for n in shape.groups()):
        clues["shape"] = tuple(int(n) for n in shape.groups())
        text = text[: shape.start()] + "." + text[shape.end() :]
    elif cube:
        clues["shape"] = (int(cube.group(1)),) * 3
        text = text[: cube.start()] + "." + text[cube.end() :]
    text = text.replace("_", " ")
    word = _TYPE.search(text)
    behind = _AFTER_TYPE.match(text, word.end()) if word else None
    if word:
        clues["dtype"] = TYPE_WORDS[word.group(1)]
    orders = {ORDER_WORDS[one or other] for one, other in ([behind.groups()] if behind else _ORDER.findall(text))}
    if len(orders) == 1:
        clues["byte_order"] = orders.pop()
    return clues


def _candidates(size: int, known: dict) -> tuple:
    """Layouts of exactly ``size`` bytes that agree with the known parts, the most likely first."""
    dtypes = [known["dtype"]] if known["dtype"] else list(TYPE_OF_EACH_SIZE)
    order = known["byte_order"] or "little"
    found = []
    for dtype in dtypes:
        itemsize = np.dtype(dtype).itemsize
        if known["shape"] is not None:
            header = size - math.prod(known["shape"]) * itemsize
            if (known["header_bytes"] is None and 0 <= header <= SMALL_HEADER) or header == known["header_bytes"]:
                found.append((header > 0, RawLayout(known["shape"], dtype, order, header)))
            continue
        voxels, rest = divmod(size - (known["header_bytes"] or 0), itemsize)
        if rest == 0 and voxels > 0:
            for shape, oddity in _shapes_of(voxels):
                found.append((oddity, RawLayout(shape, dtype, order, known["header_bytes"] or 0)))
    if known["shape"] is not None and any(not layout.header_bytes for _, layout in found):
        found = [pair for pair in found if not pair[1].header_bytes]  # an exact fit needs no header
    found.sort(key=lambda pair: pair[0])  # stable: among equals, the smaller type stays first
    return tuple(layout for _, layout in found)


def _shapes_of(voxels: int):
    """Yield plausible shapes of ``voxels`` voxels and their penalty: cubes, then common square slices."""
    edge = round(voxels ** (1.0 / 3.0))
    if edge**3 == voxels and edge > 1:
        yield (edge,) * 3, 0.0 if edge in COMMON_EDGES else 0.5
    for rank, n in enumerate(COMMON_EDGES):
        slices, rest = divmod(voxels, n * n)
        if rest == 0 and n // 32 <= slices <= 4 * n and slices > 1 and slices != n:
            yield (n, n, slices), 1.0 + 0.3 * rank + 0.5 * abs(math.log2(slices / n))
    for n in range(16, min(4096, math.isqrt(voxels)) + 1):
        slices, rest = divmod(voxels, n * n)
        if rest == 0 and n not in COMMON_EDGES and n // 8 <= slices <= 2 * n and slices != n:
            yield (n, n, slices), 7.0 + abs(math.log2(slices / n))


def _narrow_by_bytes(candidates, known: dict, named, sample: bytes, reasons: list):
    """Choose type and byte order by the bytes; return the candidates and whether the choice is certain.

    Neighboring voxels differ little, so the right interpretation of the bytes has the smallest steps. ``named``: the
    byte order in the file's name, which decides where the bytes do not.
    """
    if not candidates:
        return candidates, False
    if known["dtype"] is None:
        itemsizes = list(dict.fromkeys(np.dtype(c.dtype).itemsize for c in candidates))
        alike = len(itemsizes) == 1
        if not alike:
            wide = _looks_wide(sample)
            chosen = _likely_itemsize(sample, itemsizes, wide, known["byte_order"])
            reasons.append(
                "Its even and odd bytes vary differently, as in types of more than one byte."
                if wide
                else "Its even and odd bytes vary alike, as in types of one byte."
            )
            order = sorted(candidates, key=lambda c: np.dtype(c.dtype).itemsize != chosen)
            candidates, itemsizes = tuple(order), [chosen]
        itemsize = itemsizes[0]
        if itemsize == 1:
            return _with(candidates, 1, "uint8", known["byte_order"] or "little"), alike
        dtypes = {2: ("uint16", "int16"), 4: ("float32", "uint32", "int32"), 8: ("float64",)}[itemsize]
    else:
        itemsize, dtypes, alike = np.dtype(known["dtype"]).itemsize, (known["dtype"],), True
        if itemsize == 1:
            return candidates, True
    header = candidates[0].header_bytes
    dtype, order, clear = _read_as(sample, header, dtypes, known["byte_order"], named, reasons)
    return _with(candidates, itemsize, dtype, order), alike and clear


def _read_as(sample: bytes, skip: int, dtypes, given, named, reasons: list):
    """Choose type and byte order of the bytes after ``skip``; return (dtype, byte order, certain), extend ``reasons``.

    ``given``: the byte order if known. ``named``: the byte order in the file's name, which decides where the bytes do
    not.
    """
    orders = (given,) if given else BYTE_ORDERS
    dtype, order, clear_type, clear_order, is_clear = _smoothest(sample, skip, dtypes, orders)
    if given is None and named is not None and not is_clear:
        dtype, order, clear_type, clear_order, _ = _smoothest(sample, skip, dtypes, (named,))
        reasons.append(f"The file name gives {named}-endian; the bytes are ambiguous.")
    elif len(dtypes) * len(orders) > 1:
        smoothly = f"which gives {'far' if clear_type and clear_order else 'slightly'} smoother values than other types"
        is_other = given is None and named not in (None, order)
        but = f"The file name gives {named}-endian, but read" if is_other else "Read"
        reasons.append(f"{but} as {dtype}, {order}-endian, {smoothly}.")
    return dtype, order, clear_type and clear_order


def _with(candidates, itemsize: int, dtype: str, order: str) -> tuple:
    """Candidates with type and byte order set for those of ``itemsize``; the others unchanged."""
    return tuple(
        RawLayout(c.shape, dtype, order, c.header_bytes) if np.dtype(c.dtype).itemsize == itemsize else c
        for c in candidates
    )


def _looks_wide(sample: bytes) -> bool:
    """Whether even and odd bytes vary differently, as the high and low bytes of wider types do."""
    values = np.frombuffer(sample[: len(sample) // 2 * 2], dtype=np.uint8).astype(np.int16).reshape(-1, 2)
    if len(values) < 16:
        return False
    steps = np.abs(np.diff(values, axis=0)).mean(axis=0) + 1e-9
    return bool(max(steps) > 1.5 * min(steps))


def _likely_itemsize(sample: bytes, itemsizes, wide: bool, order) -> int:
    """The most likely of ``itemsizes``. Float sizes are chosen only if the bytes are plausible floats."""
    orders = (order,) if order else ("little", "big")
    for size in (8, 4) if wide else ():
        if size in itemsizes and _readings(sample, 0, (f"float{8 * size}",), orders):
            return size
    for size in (2, 4, 1) if wide else (1, 2, 4):
        if size in itemsizes:
            return size
    return itemsizes[0]


def _smoothest(sample: bytes, skip: int, dtypes, orders):
    """The interpretation with the smallest steps between neighboring values.

    Returns (dtype, order, type is clear, order is clear, bytes decide the order). Integers that fit into one byte do
    not decide the order: in the other order they are the same times 256.
    """
    found = _readings(sample, skip, dtypes, orders)
    if not found:
        return dtypes[0], orders[0], len(dtypes) == 1, len(orders) == 1, False
    if any(np.dtype(d).kind == "f" for d, _ in found):  # integers are seldom plausible floats
        found = {key: reading for key, reading in found.items() if np.dtype(key[0]).kind == "f"}
    (dtype, order), (step, is_narrow) = min(found.items(), key=lambda item: item[1][0])
    types = [found[key][0] for key in found if key[1] == order and key[0] != dtype]
    others = [found[key][0] for key in found if key[1] != order]
    clear_type = all(other == step for other in types) or step < CLEARLY_SMOOTHER * min(types)
    clear_order = not others or step < CLEARLY_SMOOTHER * min(others)
    return dtype, order, clear_type, clear_order, clear_order and not is_narrow


def _readings(sample: bytes, skip: int, dtypes, orders) -> dict:
    """Plausible interpretations: (dtype, order) -> (mean step between values, whether all fit into one byte)."""
    found = {}
    for dtype in dtypes:
        for order in orders:
            kind = np.dtype(dtype).newbyteorder("<" if order == "little" else ">")
            start = skip % kind.itemsize
            usable = (len(sample) - start) // kind.itemsize * kind.itemsize
            with np.errstate(all="ignore"):  # wrong interpretations as floats hold NaN and overflow
                values = np.frombuffer(sample[start : start + usable], dtype=kind).astype(np.float64)
                if values.size < 16 or not np.isfinite(values).all() or np.abs(values).max() > 1e30:
                    continue
                if kind.kind == "f" and (np.abs(values[values != 0.0]) < 1e-30).any():
                    continue  # denormal floats are misread integers
                low, high = values.min(), values.max()
                is_narrow = kind.kind != "f" and any(least <= low and high < least + 256.0 for least in (0.0, -128.0))
                found[dtype, order] = float(np.abs(np.diff(values)).mean()), is_narrow
    return found


def layout_steps(path: str | Path, shape=None, dtype=None, byte_order=None, header_bytes=None):
    """Generator of Progress: complete the layout of a raw file by a guess.

    Parameters
    ----------
    shape, dtype, byte_order, header_bytes
        Known parts of the layout, as in RawLayout; None for unknown parts.

    Returns
    -------
    layout : RawLayout
    remarks : tuple of str
        Sentences about what was guessed.
    spacing : (sx, sy, sz) or None
        Spacing in the file's name.

    Raises
    ------
    RleSplatError
        If shape or type is neither given nor certain. The message lists layouts that fit the size.
    """
    if shape is not None and dtype is not None:
        clues = _name_clues(Path(path).name)
        layout, remarks = RawLayout(shape, dtype, byte_order or "little", header_bytes or 0), ()
        if layout.file_dtype.itemsize > 1 and byte_order is None:
            _, sample = yield from _size_and_sample_steps(path, min(layout.total_bytes, SEARCHED_BYTES))
            reasons = []
            named = clues.get("byte_order")
            _, order, clear = _read_as(sample, layout.header_bytes, (layout.dtype,), None, named, reasons)
            if clear:
                layout = replace(layout, byte_order=order)
            else:
                reasons = ["None was given, and neither the file's name nor its bytes decide it."]
            remarks = (" ".join((f"The byte order is assumed to be {layout.byte_order}.", *reasons)),)
        return layout, remarks, clues.get("spacing")
    guess = yield from guess_raw_steps(path, shape, dtype, byte_order, header_bytes)
    if not guess.certain:
        fits = "; or ".join(str(candidate) for candidate in guess.candidates[:4])
        raise RleSplatError(
            f"The shape and type of {Path(path).name} are not certain; give its shape, the voxels along x, y and z, "
            f"and its type, one of {', '.join(STORED_TYPES)}" + (f"; its size would fit {fits}." if fits else ".")
        )
    layout = RawLayout(guess.shape, guess.dtype, guess.byte_order, guess.header_bytes)
    remarks = (f"Shape and type were guessed: {layout}, {layout.byte_order}-endian. " + " ".join(guess.reasons),)
    return layout, remarks, guess.spacing
