"""What a raw file may hold, judged by its name, its size and how smoothly its bytes vary; honest when unsure."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..scene import RleSplatError
from ..volume.volume import STORED_TYPES
from .layout import (
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
CANDIDATE_LIMIT = 8  # more than a person reads
CLEARLY_SMOOTHER = 0.7  # a reading of the bytes counts as right when its steps are this much smaller than the next
SAMPLE_BYTES = 1 << 20

# Words in file names and what they say; sizes of bare "8bit" and the like mean unsigned, as scanners write them.
TYPE_WORDS = {
    "uint8": "uint8", "u8": "uint8", "uchar": "uint8", "byte": "uint8", "8bit": "uint8", "8b": "uint8",
    "int8": "int8", "i8": "int8", "schar": "int8",
    "uint16": "uint16", "u16": "uint16", "ushort": "uint16", "16bit": "uint16", "16b": "uint16",
    "int16": "int16", "i16": "int16", "short": "int16", "sshort": "int16",
    "uint32": "uint32", "u32": "uint32", "uint": "uint32", "int32": "int32", "i32": "int32",
    "float32": "float32", "f32": "float32", "float": "float32",
    "float64": "float64", "f64": "float64", "double": "float64",
}  # fmt: skip
ORDER_WORDS = {
    "le": "little", "little": "little", "littleendian": "little", "lsb": "little",
    "be": "big", "big": "big", "bigendian": "big", "msb": "big",
}  # fmt: skip
_WORD = re.compile(
    r"(?<![a-z0-9])(" + "|".join(sorted(TYPE_WORDS, key=len, reverse=True)) + r")(le|be|lsb|msb)?(?![a-z0-9])"
)
_SHAPE = re.compile(r"(?<!\d)(?<!\d\.)(\d{1,5})[x×](\d{1,5})[x×](\d{1,5})(?![\d.]\d|\d)")
_SHAPE_SPACED = re.compile(r"(?<!\d)(?<!\d\.)(\d{2,5})[_-](\d{2,5})[_-](\d{2,5})(?![\d])")
_CUBE = re.compile(r"(?<!\d)(?<!\d\.)(\d{2,4})(?:\^3|cubed|cube)(?![a-z0-9])")
_LENGTH = r"(\d*\.\d+|\d+)"
_SPACING = re.compile(rf"(?<![\d.]){_LENGTH}[x×]{_LENGTH}[x×]{_LENGTH}(?=mm)|"
                      rf"(?<![\d.])(\d*\.\d+)[x×](\d*\.\d+)[x×](\d*\.\d+)(?!\d)")
_HEADER = re.compile(r"(?:header|hdr|skip|offset)[_-]?(\d{1,6})(?!\d)")


@dataclass(frozen=True)
class RawGuess:
    """A proposal for reading a raw file; a field is None when nothing speaks for any value.

    ``certain`` is True when name and size (or clear bytes) agree on everything.  ``reasons`` are sentences;
    ``candidates`` are RawLayouts that fit the size, the likeliest first.  ``size`` is the unpacked size in bytes.
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
    path, shape=None, dtype=None, byte_order=None, header_bytes=None, limit: int = DEFAULT_COUNT_LIMIT
) -> RawGuess:
    """Guess the layout of the raw file at ``path``; what is given is taken as known and not guessed."""
    given = dict(shape=shape, dtype=dtype, byte_order=byte_order, header_bytes=header_bytes)
    # Made for its checks alone.
    RawLayout(**{"shape": (1, 1, 1), "dtype": "uint8", **{what: v for what, v in given.items() if v is not None}})
    size, sample = _size_and_sample(path, limit)
    name = _name_clues(Path(path).name)
    reasons = []
    known = dict(given)
    for what, value in known.items():
        if value is None and name.get(what) is not None:
            known[what] = name[what]
            text = " x ".join(map(str, name[what])) if what == "shape" else name[what]
            reasons.append(f"The name says {what.replace('_', ' ')} {text}.")
    if name.get("spacing"):
        reasons.append("The name says spacing " + " x ".join(f"{s:g}" for s in name["spacing"]) + ".")
    if size is None:
        reasons.append(f"The file holds more than {limit} bytes, so its size was not counted.")
        candidates = ()
    else:
        candidates = _candidates(size, known)
        reasons.append(f"It holds {size} bytes" + (" unpacked." if is_gzip(path) else "."))
    candidates, decided = _judge_by_bytes(candidates, known, sample, reasons)
    if not candidates:
        if size is not None:
            reasons.append("Nothing that is known fits this size.")
        kept = {what: known[what] for what in ("shape", "dtype")}
        return RawGuess(
            kept["shape"], kept["dtype"], known["byte_order"] or "little", known["header_bytes"] or 0,
            name.get("spacing"), False, tuple(reasons), (), size,
        )
    best = candidates[0]
    certain = known["shape"] is not None and decided and (known["header_bytes"] is not None or not best.header_bytes)
    if not certain:
        reasons.append("This is a guess: compare it with what you know of the file.")
    return RawGuess(
        best.shape, best.dtype, best.byte_order, best.header_bytes, name.get("spacing"), certain,
        tuple(reasons), candidates[:CANDIDATE_LIMIT], size,
    )


def _size_and_sample(path, limit: int):
    """The unpacked size (None beyond ``limit``) and up to a MiB of bytes, from where they vary most."""
    count, sample, best = 0, b"", -1.0
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
            return None, sample
    except UNREADABLE as problem:
        raise unreadable(path, problem) from None


def _name_clues(name: str) -> dict:
    """What the words and numbers of a file name say."""
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
        text = text[: shape.start()] + " " + text[shape.end() :]
    elif cube:
        clues["shape"] = (int(cube.group(1)),) * 3
        text = text[: cube.start()] + " " + text[cube.end() :]
    text = text.replace("_", " ")
    word = _WORD.search(text)
    if word:
        clues["dtype"] = TYPE_WORDS[word.group(1)]
        if word.group(2):
            clues["byte_order"] = ORDER_WORDS[word.group(2)]
    if "byte_order" not in clues:
        orders = {ORDER_WORDS[w] for w in re.split(r"[^a-z]+", text) if w in ORDER_WORDS}
        if len(orders) == 1:
            clues["byte_order"] = orders.pop()
    return clues


def _candidates(size: int, known: dict) -> tuple:
    """Layouts of exactly ``size`` bytes that agree with what is known, the likeliest first."""
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
        found = [pair for pair in found if not pair[1].header_bytes]  # an exact fit needs no header to explain it
    found.sort(key=lambda pair: pair[0])  # stable: among equals the smaller type stays first
    return tuple(layout for _, layout in found)


def _shapes_of(voxels: int):
    """Plausible shapes of that many voxels with a measure of how odd each is: cubes, then common square slices."""
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


def _judge_by_bytes(candidates, known: dict, sample: bytes, reasons: list):
    """Settle type and byte order by the bytes where the name is silent; also whether they are now certain.

    Neighbouring voxels differ little, so of all readings of the same bytes the right one has the smallest steps.
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
                "Its bytes vary differently at even and odd places, as in types of more than one byte."
                if wide else "Its bytes vary alike at even and odd places, as in types of one byte."
            )
            order = sorted(candidates, key=lambda c: np.dtype(c.dtype).itemsize != chosen)
            candidates, itemsizes = tuple(order), [chosen]
        itemsize = itemsizes[0]
        if itemsize == 1:
            return _with(candidates, 1, "uint8", known["byte_order"] or "little"), alike
        readings = {2: ("uint16", "int16"), 4: ("float32", "uint32", "int32"), 8: ("float64",)}[itemsize]
    else:
        itemsize, readings, alike = np.dtype(known["dtype"]).itemsize, (known["dtype"],), True
        if itemsize == 1 or known["byte_order"] is not None:
            return candidates, True
    orders = (known["byte_order"],) if known["byte_order"] else ("little", "big")
    dtype, order, clear = _smoothest(sample, candidates[0].header_bytes, readings, orders)
    if len(readings) * len(orders) > 1:
        reasons.append(
            f"Read as {dtype}, {order}-endian, its values vary {'by far the' if clear else 'a little'} "
            f"more smoothly than otherwise.".replace("by far the more", "far more")
        )
    return _with(candidates, itemsize, dtype, order), alike and clear


def _with(candidates, itemsize: int, dtype: str, order: str) -> tuple:
    """Candidates of that item size with the type and byte order settled, then the others as they are."""
    return tuple(
        RawLayout(c.shape, dtype, order, c.header_bytes) if np.dtype(c.dtype).itemsize == itemsize else c
        for c in candidates
    )


def _looks_wide(sample: bytes) -> bool:
    """Whether even and odd bytes behave differently, as high and low bytes of wider values do."""
    values = np.frombuffer(sample[: len(sample) // 2 * 2], dtype=np.uint8).astype(np.int16).reshape(-1, 2)
    if len(values) < 16:
        return False
    steps = np.abs(np.diff(values, axis=0)).mean(axis=0) + 1e-9
    return bool(max(steps) > 1.5 * min(steps))


def _likely_itemsize(sample: bytes, itemsizes, wide: bool, order) -> int:
    """The item size among ``itemsizes`` that the bytes speak for: floats only where they make sense as floats."""
    orders = (order,) if order else ("little", "big")
    for size in (8, 4) if wide else ():
        if size in itemsizes and _roughness(sample, 0, (f"float{8 * size}",), orders):
            return size
    for size in (2, 4, 1) if wide else (1, 2, 4):
        if size in itemsizes:
            return size
    return itemsizes[0]


def _smoothest(sample: bytes, skip: int, readings, orders):
    """(dtype, order, clear): the reading whose neighbouring values differ least."""
    roughness = _roughness(sample, skip, readings, orders)
    if not roughness:
        return readings[0], orders[0], len(readings) * len(orders) == 1
    if any(np.dtype(d).kind == "f" for d, _ in roughness):  # passes as float: integers seldom do
        roughness = {key: r for key, r in roughness.items() if np.dtype(key[0]).kind == "f"}
    ranked = sorted(roughness, key=roughness.get)
    best = ranked[0]
    rival = min((roughness[key] for key in ranked[1:]), default=math.inf)
    same_values = rival == roughness[best] and all(key[1] == best[1] for key in ranked if roughness[key] == rival)
    return best[0], best[1], same_values or roughness[best] < CLEARLY_SMOOTHER * rival


def _roughness(sample: bytes, skip: int, readings, orders) -> dict:
    """Mean step between neighbouring values for each (dtype, order) that the bytes can be."""
    roughness = {}
    for dtype in readings:
        for order in orders:
            kind = np.dtype(dtype).newbyteorder("<" if order == "little" else ">")
            start = skip % kind.itemsize
            usable = (len(sample) - start) // kind.itemsize * kind.itemsize
            with np.errstate(all="ignore"):  # wrong readings of floats hold NaN and overflow
                values = np.frombuffer(sample[start : start + usable], dtype=kind).astype(np.float64)
                if values.size < 16 or not np.isfinite(values).all() or np.abs(values).max() > 1e30:
                    continue
                if kind.kind == "f" and (np.abs(values[values != 0.0]) < 1e-30).any():
                    continue  # denormal floats are integers misread
                roughness[dtype, order] = float(np.abs(np.diff(values)).mean())
    return roughness


def layout_for(path, shape=None, dtype=None, byte_order=None, header_bytes=None):
    """(RawLayout, remarks, spacing or None): as given, completed by a guess where it is certain.

    Raises RleSplatError with what would fit when something needed is neither given nor certain.
    """
    if shape is not None and dtype is not None:
        clues = _name_clues(Path(path).name)
        order = byte_order or clues.get("byte_order")
        layout = RawLayout(shape, dtype, order or "little", header_bytes or 0)
        remarks = ()
        if layout.file_dtype.itemsize > 1 and byte_order is None:
            source = "as the file's name says" if order else "as none was given"
            remarks = (f"The byte order was taken as {layout.byte_order}, {source}.",)
        return layout, remarks, clues.get("spacing")
    guess = guess_raw(path, shape, dtype, byte_order, header_bytes)
    if not guess.certain:
        fits = "; or ".join(str(candidate) for candidate in guess.candidates[:4])
        raise RleSplatError(
            f"{Path(path).name} is raw, and its shape and type are not certain; give --shape NX NY NZ and --dtype "
            f"(one of {', '.join(STORED_TYPES)})" + (f"; its size would fit {fits}." if fits else ".")
        )
    layout = RawLayout(guess.shape, guess.dtype, guess.byte_order, guess.header_bytes)
    remarks = (f"Shape and type were guessed: {layout}, {layout.byte_order}-endian. " + " ".join(guess.reasons),)
    return layout, remarks, guess.spacing
