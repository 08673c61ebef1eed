"""MetaImage, in one file (``.mha``) or two and more (``.mhd``), as ITK writes and reads it.

The rows of TransformMatrix are the directions of the voxel axes in LPS. AnatomicalOrientation names where the axes come
from and is ignored, since the matrix says the same exactly.
"""

import math
import re
from pathlib import Path

import numpy as np

from ..runtime.steps import Progress
from ..scene import RleSplatError
from ..volume.volume import PATIENT, Volume
from . import header
from .datafiles import find_data_files, part_of
from .format import GZIP_MAGIC, Head
from .layers import layer_steps
from .layout import UNREADABLE, unreadable
from .streaming import plain_name, voxel_steps

MOST_HEADER = 1 << 22  # bytes
TYPES = {
    "MET_CHAR": "i1", "MET_UCHAR": "u1", "MET_SHORT": "i2", "MET_USHORT": "u2", "MET_INT": "i4", "MET_UINT": "u4",
    "MET_LONG": "i4", "MET_ULONG": "u4", "MET_LONG_LONG": "i8", "MET_ULONG_LONG": "u8", "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}  # fmt: skip
MODALITIES = {"MET_MOD_CT": "CT", "MET_MOD_MR": "MR"}
FIRST_LINE = re.compile(rb"\s*(ObjectType|NDims|Comment|ObjectSubType|Name|ID)\s*=", re.IGNORECASE)
COLOR_CHANNELS = (3, 4)


def recognizes_metaimage(head: Head) -> bool:
    """Whether a file begins as the header of a MetaImage."""
    return bool(FIRST_LINE.match(head.stored)) and b"DimSize" in head.stored


def _read_header(path: Path) -> tuple[dict, list[str], int]:
    """The fields by their lower-case names, the lines after the last one, and where the header ends."""
    fields, end = {}, 0
    try:
        with open(path, "rb") as stream:
            while line := stream.readline(MOST_HEADER):
                name, equals, value = _decode(line).partition("=")
                end = stream.tell()
                if not equals or end > MOST_HEADER:
                    raise header.damage_error(path, "it does not end with ElementDataFile")
                fields[name.strip().lower()] = value.strip()
                if name.strip().lower() == "elementdatafile":
                    break
            listed = []
            if fields.get("elementdatafile", "").upper().startswith("LIST"):
                listed = _decode(stream.read(MOST_HEADER)).splitlines()
    except UNREADABLE as problem:
        raise unreadable(path, problem) from None
    if "elementdatafile" not in fields or fields.get("objecttype", "Image").lower() != "image":
        raise RleSplatError(f"{path.name} is not a MetaImage, or its header is cut short; copy or export it again.")
    return fields, listed, end


def _decode(text: bytes) -> str:
    """Text of a header, which says nothing of its encoding."""
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1")


def _numbers(path, fields: dict, names, count: int, default):
    """``count`` numbers of the first field there is; ``default`` if there is none of ``names``."""
    text = next((fields[name] for name in names if name in fields), None)
    if text is None:
        return default
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) < count:
        raise header.damage_error(path, f"its {names[0]} should be {count} numbers")
    return numbers[:count]


def _geometry(path, fields: dict, count: int):
    """The affine to LPS millimeters and the space; returns (affine, unit, space, remarks)."""
    spacing, remarks = header.sensible_spacing(
        _numbers(path, fields, ("elementspacing", "elementsize"), count, [math.nan] * count)[:3]
    )
    matrix = _numbers(path, fields, ("transformmatrix", "orientation", "rotation"), count * count, None)
    offset = _numbers(path, fields, ("offset", "position", "origin"), count, [0.0] * count)
    affine = np.eye(4)
    axes = np.eye(3) if matrix is None else np.array(matrix).reshape(count, count)[:3, :3]
    affine[:3, :3] = axes.T * spacing
    affine[:3, 3] = offset[:3]
    unit = fields.get("distanceunits", "mm").lower()
    scale = header.MILLIMETERS.get(unit, 1.0)
    affine = header.check_affine(path, np.diag((scale, scale, scale, 1.0)) @ affine)
    return affine, "mm", None if matrix is None else PATIENT, remarks


def _parts(path: Path, fields: dict, listed, end: int, size: int) -> list:
    """The files that hold the voxels; ``size``: bytes of all voxels."""
    skip = int(_numbers(path, fields, ("headersize",), 1, (0,))[0])
    is_packed = fields.get("compresseddata", "false").lower() == "true"
    given = fields["elementdatafile"]
    files = [path] if given.upper() == "LOCAL" else find_data_files(path, given, listed)
    parts = []
    for file in files:
        offset = end if file == path else 0
        packing = None
        if is_packed:
            with open(file, "rb") as stream:
                stream.seek(offset)
                packing = "gzip" if stream.read(len(GZIP_MAGIC)) == GZIP_MAGIC else "zlib"
        parts.append(part_of(file, offset, skip if file != path else 0, packing, size // len(files)))
    return parts


def read_metaimage_steps(path, frame=None):
    """Generator of Progress: read a MetaImage; return the Volume.

    Parameters
    ----------
    path : str or Path
        The file, or the header (``.mhd``) of several.
    frame : int or None
        The volume of a 4-D file, or the channel of one with several, from 1; None for the first.

    Returns
    -------
    Volume
        In patient space if the header has a TransformMatrix.

    Raises
    ------
    RleSplatError
        If the file is damaged, cut short, or of another kind, or a file that it names is missing.
    """
    path = Path(path)
    yield Progress(0.0, f"reading {path.name}")
    fields, listed, end = _read_header(path)
    words = fields.get("dimsize", "").split()
    if not 2 <= len(words) <= 4 or not all(re.fullmatch(r"\d{1,9}", word) for word in words):
        raise header.damage_error(path, "its DimSize should be three numbers, or four")
    sizes = [int(word) for word in words]
    shape = header.check_grid(path, (sizes + [1])[:3])
    kind = TYPES.get(re.sub("_ARRAY$", "", fields.get("elementtype", "")))
    if kind is None:
        raise RleSplatError(f"The voxels of {path.name} are {fields.get('elementtype')}, which cannot be read.")
    if fields.get("binarydata", "true").lower() == "false":
        raise RleSplatError(f"The voxels of {path.name} are text; save it with binary data.")
    msb = fields.get("binarydatabyteordermsb", fields.get("elementbyteordermsb", "false")).lower() == "true"
    dtype = header.check_kind(path, np.dtype((">" if msb else "<") + kind))
    channels = int(_numbers(path, fields, ("elementnumberofchannels",), 1, (1,))[0])
    if channels in COLOR_CHANNELS and dtype.itemsize == 1:
        raise RleSplatError(f"The voxels of {path.name} are colors; export one number for each voxel.")
    affine, unit, space, remarks = _geometry(path, fields, len(sizes))
    frames = channels if channels > 1 else (sizes[3] if len(sizes) == 4 else 1)
    frame = header.check_frame(path, frame, frames)
    each = math.prod(shape) * dtype.itemsize
    parts = _parts(path, fields, listed, end, each * frames)
    if channels > 1:
        voxels = yield from layer_steps(path, shape, dtype, parts, channels, frame - 1)
    else:
        voxels = yield from voxel_steps(path, shape, dtype, parts, (frame - 1) * each, each * frames // len(parts))
    return Volume(
        voxels=voxels, affine=affine, unit=unit, name=plain_name(path), space=space, frames=frames,
        modality=MODALITIES.get(fields.get("modality", "")), data_files=tuple(part.path for part in parts),
        remarks=remarks + header.frame_remark(frame, frames, "time" if channels == 1 else "channel"),
    )  # fmt: skip
