"""NRRD, attached and detached, and Slicer's segmentations (``.seg.nrrd``): headers by pynrrd, voxels streamed."""

import gzip
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..runtime.steps import Progress
from ..scene import RleSplatError
from ..scene.color import linear, to_display
from ..volume.volume import PATIENT, NamedLabel, Volume
from .datafiles import find_data_files, part_of
from .format import Head
from .header import (
    MILLIMETERS,
    MM_ASSUMED,
    check_affine,
    check_frame,
    check_grid,
    check_kind,
    damage_error,
    frame_remark,
    library,
    sensible_spacing,
)
from .layers import layer_steps, merge_layer_steps
from .layout import UNREADABLE, unreadable
from .streaming import Part, plain_name, voxel_steps, write_voxel_steps

MAGIC = b"NRRD"
MOST_HEADER = 1 << 22  # bytes of a header; longer ones are damaged
# Space -> signs that turn it into LPS. Other spaces do not say where the patient's left is.
SIGNS = {
    "left-posterior-superior": (1, 1, 1), "lps": (1, 1, 1), "right-anterior-superior": (-1, -1, 1),
    "ras": (-1, -1, 1), "left-anterior-superior": (1, -1, 1), "las": (1, -1, 1),
}  # fmt: skip
TYPES = {
    name: f"{sign}{size}"
    for sign, size, names in (
        ("i", 1, "signed char,int8,int8_t"), ("u", 1, "uchar,unsigned char,uint8,uint8_t"),
        ("i", 2, "short,short int,signed short,signed short int,int16,int16_t"),
        ("u", 2, "ushort,unsigned short,unsigned short int,uint16,uint16_t"),
        ("i", 4, "int,signed int,int32,int32_t"), ("u", 4, "uint,unsigned int,uint32,uint32_t"),
        ("i", 8, "longlong,long long,long long int,signed long long,signed long long int,int64,int64_t"),
        ("u", 8, "ulonglong,unsigned long long,unsigned long long int,uint64,uint64_t"),
        ("f", 4, "float"), ("f", 8, "double"),
    )
    for name in names.split(",")
}  # fmt: skip
PACKINGS = {"raw": None, "gzip": "gzip", "gz": "gzip", "bzip2": "bzip2", "bz2": "bzip2"}
SPATIAL_KINDS = ("domain", "space")
TIME_KINDS = ("time",)
OWN_KEYS = {"slope": "rle_splat.slope", "intercept": "rle_splat.intercept", "value_unit": "rle_splat.value_unit",
            "modality": "rle_splat.modality"}  # fmt: skip


@dataclass(frozen=True)
class _Axes:
    """The axes of the data: ``shape`` (nx, ny, nz) of the spatial ones, and the axis of the frames, if any."""

    shape: tuple
    spatial: tuple  # numbers of the spatial axes in the file
    frames: int
    frames_first: bool  # whether the frames of a voxel are side by side in the file
    differ_in: str  # "time", or what the frames are


def recognizes_nrrd(head: Head) -> bool:
    """Whether a file begins as a NRRD header."""
    return head.stored.startswith(MAGIC)


def _read_header(path: Path) -> tuple[dict, list[str], int]:
    """The fields of a header, the names of a LIST of data files, and where the header ends."""
    nrrd = library("nrrd", "pynrrd", "NRRD")
    lines, names, is_list = [], [], False
    try:
        with open(path, "rb") as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise RleSplatError(f"{path.name} is not a NRRD file; check how it was written.")
            stream.seek(0)
            while line := stream.readline(MOST_HEADER - stream.tell()):
                text = line.decode("utf-8", "replace").rstrip()
                if not text:
                    break
                (names if is_list else lines).append(text)
                is_list = is_list or bool(re.match(r"data ?file: *LIST", text, re.IGNORECASE))
            end = stream.tell()
    except UNREADABLE as problem:
        raise unreadable(path, problem) from None
    if end >= MOST_HEADER:
        raise damage_error(path, "it has no end")
    try:
        return dict(nrrd.read_header(lines)), names, end
    except (nrrd.NRRDError, ValueError, TypeError, IndexError, OverflowError):
        raise damage_error(path, "a field of it cannot be read") from None


def _axes(path, header: dict) -> _Axes:
    """Find the spatial axes: by kinds and directions, else the first three."""
    sizes = [int(n) for n in np.atleast_1d(header.get("sizes", ()))]
    if not 3 <= len(sizes) <= 4 or header.get("dimension") != len(sizes):
        raise RleSplatError(
            f"{Path(path).name} has {len(sizes)} axes; a volume has three, or four if it holds several volumes."
        )
    kinds = [kind.lower() for kind in header.get("kinds", ())] or [""] * 4
    if any("color" in kind for kind in kinds):
        raise RleSplatError(f"The voxels of {Path(path).name} are colors; export one number for each voxel.")
    if len(sizes) == 3:
        return _Axes(check_grid(path, sizes), (0, 1, 2), 1, False, "time")
    rows = _directions(path, header)
    apart = [i for i in range(4) if rows is not None and not np.isfinite(rows[i]).any()]
    apart = apart or [i for i in range(len(kinds)) if kinds[i] not in SPATIAL_KINDS and kinds[i] not in ("", "???")]
    axis = apart[0] if len(apart) == 1 else 3
    kind = kinds[axis] if axis < len(kinds) else ""
    if axis not in (0, 3):
        raise RleSplatError(f"{Path(path).name} has its spatial axes apart; reorder them so that they are together.")
    spatial = tuple(i for i in range(4) if i != axis)
    names = header.get("labels", ())
    label = names[axis].lower() if axis < len(names) else ""
    in_time = kind in TIME_KINDS or label in ("t", "time", "frame") or (axis == 3 and kind in ("", "???", "domain"))
    shape = check_grid(path, [sizes[i] for i in spatial])
    return _Axes(shape, spatial, sizes[axis], axis == 0, "time" if in_time else kind or "kind")


def _directions(path, header: dict):
    """(axes, dimensions) float64 of the space directions, NaN for an axis without one; None if there are none."""
    rows = header.get("space directions")
    if rows is None:
        return None
    width = max((np.size(row) for row in rows if row is not None), default=3)
    sizes = {np.size(row) for row in rows if row is not None}
    if len(rows) != len(header["sizes"]) or sizes - {width} or width < 3:
        raise damage_error(path, "its space directions do not fit its axes")
    return np.array([[np.nan] * width if row is None else row for row in rows], dtype=np.float64)


def _geometry(path, header: dict, axes: _Axes):
    """The affine, in LPS millimeters if the space is a patient's; returns (affine, unit, space, remarks)."""
    units = [unit.lower() for unit in header.get("space units", header.get("units", ()))]
    unit = next((unit for unit in units if unit in MILLIMETERS), None)
    space = re.sub(r"-time$|(?<=^[lr][ap]s)t$", "", header.get("space", "").lower())
    rows = _directions(path, header)
    remarks = ()
    if rows is None:
        spacings = np.atleast_1d(header.get("spacings", (np.nan,) * len(header["sizes"])))
        if len(spacings) != len(header["sizes"]):
            raise damage_error(path, "its spacings do not fit its axes")
        spacing, remarks = sensible_spacing([spacings[i] for i in axes.spatial])
        affine = np.diag((*spacing, 1.0))
    else:
        affine = np.eye(4)
        affine[:3, :3] = rows[list(axes.spatial), :3].T
        origin = np.atleast_1d(header.get("space origin", np.zeros(3)))[:3]
        if len(origin) != 3:
            raise damage_error(path, "its space origin is not a point")
        affine[:3, 3] = np.where(np.isfinite(origin), origin, 0.0)
        affine = check_affine(path, affine)
    if rows is not None and space in SIGNS:
        scale = MILLIMETERS[unit or "mm"]
        return np.diag((*(scale * s for s in SIGNS[space]), 1.0)) @ affine, "mm", PATIENT, remarks
    if unit is None:
        remarks += (MM_ASSUMED,)
    return affine, unit or "mm", None, (*remarks, "The file does not say where the patient's left and right are.")


def _data_parts(path: Path, header: dict, names: list, end: int, size: int) -> list[Part]:
    """The files that hold the voxels; ``size``: bytes of all voxels, ``end``: where an attached header ends."""
    encoding = header.get("encoding", "raw").lower()
    if encoding not in PACKINGS:
        raise RleSplatError(f"{path.name} is encoded as {encoding}, which cannot be read; save it as raw or gzip.")
    packing = PACKINGS[encoding]
    given = header.get("data file", header.get("datafile"))
    files = [path] if given is None else find_data_files(path, given, names)
    lines = int(header.get("line skip", header.get("lineskip", 0)))
    skip = int(header.get("byte skip", header.get("byteskip", 0)))
    if skip < -1 or not 0 <= lines <= MOST_HEADER:
        raise damage_error(path, "it says to skip an impossible number of bytes")
    each = size // len(files)
    return [part_of(file, _after_lines(file, end if file == path else 0, lines), skip, packing, each) for file in files]


def _after_lines(file: Path, offset: int, lines: int) -> int:
    """Where a file goes on after ``lines`` lines from ``offset`` on."""
    if lines == 0:
        return offset
    with open(file, "rb") as stream:
        stream.seek(offset)
        for _ in range(lines):
            stream.readline(MOST_HEADER)
        return stream.tell()


def read_nrrd_steps(path, frame=None):
    """Generator of Progress: read a NRRD file; return the Volume.

    Parameters
    ----------
    path : str or Path
        Of a detached pair, the header (``.nhdr``).
    frame : int or None
        The volume of a file with a fourth axis, from 1; None for the first.

    Returns
    -------
    Volume
        In patient space if the space is left-posterior-superior, right-anterior-superior or left-anterior-superior.
        A segmentation of Slicer with several layers becomes one label map.

    Raises
    ------
    RleSplatError
        If the file is damaged, cut short, of another kind, or a file that it names is missing.
    """
    path = Path(path)
    yield Progress(0.0, f"reading {path.name}")
    header, names, end = _read_header(path)
    kind = TYPES.get(header.get("type", "").lower())
    if kind is None:
        raise RleSplatError(f"The voxels of {path.name} are of type {header.get('type')}, which cannot be read.")
    order = {"big": ">", "little": "<"}.get(header.get("endian", "little").lower(), "<")
    dtype = check_kind(path, np.dtype(order + kind))
    axes = _axes(path, header)
    affine, unit, space, remarks = _geometry(path, header, axes)
    labels = segments(header)
    size = math.prod(axes.shape) * axes.frames * dtype.itemsize
    parts = _data_parts(path, header, names, end, size)
    if axes.frames_first and len(parts) > 1:
        raise RleSplatError(f"{path.name} has several values for each voxel in several files; save it as one file.")
    if labels and axes.frames > 1 and frame is None:
        voxels, labels, overlaps = yield from merge_layer_steps(path, axes.shape, dtype, parts, axes, labels)
        remarks += overlaps
        frames = 1
    else:
        frames, frame = axes.frames, check_frame(path, frame, axes.frames)
        if axes.frames_first:
            voxels = yield from layer_steps(path, axes.shape, dtype, parts, axes.frames, frame - 1)
        else:
            begin = (frame - 1) * (size // axes.frames)
            voxels = yield from voxel_steps(path, axes.shape, dtype, parts, begin, size // len(parts))
        remarks += frame_remark(frame, frames, axes.differ_in)
        labels = tuple(NamedLabel(s.value, s.name, s.color) for s in labels)
    own = {name: header[key] for name, key in OWN_KEYS.items() if key in header}
    meaning = {name: float(own[name]) for name in ("slope", "intercept") if name in own}
    return Volume(
        voxels=voxels, affine=affine, unit=unit, name=plain_name(path), remarks=remarks, space=space, frames=frames,
        frame_axis=axes.differ_in, named_labels=labels, value_unit=own.get("value_unit"),
        modality=own.get("modality"), data_files=tuple(part.path for part in parts), **meaning,
    )  # fmt: skip


@dataclass(frozen=True)
class Segment:
    """One segment of Slicer: voxels of ``layer`` that hold ``value``."""

    name: str
    color: tuple | None
    layer: int
    value: int


def segments(header: dict) -> tuple[Segment, ...]:
    """The segments that a header names in keys such as ``Segment0_Name``, in their order."""
    numbers = sorted(int(found[1]) for key in header if (found := re.fullmatch(r"Segment(\d{1,6})_ID", key)))
    found = []
    for number in numbers:
        entry = {name: header.get(f"Segment{number}_{name}") for name in ("ID", "Name", "Color", "Layer", "LabelValue")}
        old = entry["LabelValue"] is None  # before Slicer 4.11 each segment was a layer of ones
        try:
            color = tuple(float(c) for c in (entry["Color"] or "").split())
            layer = number if old else int(entry["Layer"] or 0)
            value = 1 if old else int(entry["LabelValue"])
        except ValueError:
            continue
        good = len(color) == 3 and all(0.0 <= c <= 1.0 for c in color)
        found.append(Segment(entry["Name"] or entry["ID"], linear(color) if good else None, layer, value))
    return tuple(found)


def write_nrrd_steps(volume: Volume, path):
    """Generator of Progress: write a NRRD file with the stored values, packed with gzip, and the exact affine.

    Slope, intercept, unit and modality go into keys that only this program reads, names of labels into those of
    Slicer's segmentations.

    Returns
    -------
    dict
        Empty: no options are needed to read the file back.
    """
    kind = volume.voxels.dtype
    name = {"f4": "float", "f8": "double"}.get(kind.str[1:], kind.name)
    lines = ["NRRD0005", f"type: {name}", "dimension: 3"]
    lines.append("space: left-posterior-superior" if volume.space == PATIENT else "space dimension: 3")
    lines.append(f"sizes: {' '.join(map(str, volume.shape_xyz))}")
    lines.append("space directions: " + " ".join(_vector(column) for column in volume.affine[:3, :3].T))
    lines += ["kinds: domain domain domain", "endian: little", "encoding: gzip"]
    lines.append("space units: " + " ".join([f'"{volume.unit}"'] * 3))
    lines.append(f"space origin: {_vector(volume.affine[:3, 3])}")
    for option, key in OWN_KEYS.items():
        value = getattr(volume, option)
        if value not in (None, {"slope": 1.0, "intercept": 0.0}.get(option)):
            lines.append(f"{key}:={value}")
    lines += _segment_lines(volume)
    with open(path, "wb") as stream:
        stream.write(("\n".join(lines) + "\n\n").encode())
        with gzip.GzipFile(filename="", mode="wb", fileobj=stream, mtime=0, compresslevel=6) as packed:
            yield from write_voxel_steps(volume.voxels, packed)
    return {}


def _segment_lines(volume: Volume) -> list[str]:
    """The keys that ``segments`` reads, of labels but the background; none without names."""
    labels = [one for one in volume.named_labels if one.label != 0]
    if not labels:
        return []
    extent = " ".join(f"0 {count - 1}" for count in volume.shape_xyz)
    lines = ["Segmentation_MasterRepresentation:=Binary labelmap", "Segmentation_ReferenceImageExtentOffset:=0 0 0"]
    lines.append("Segmentation_ContainedRepresentationNames:=Binary labelmap|")
    for number, one in enumerate(labels):
        name = " ".join(one.name.split())
        facts = {
            "ID": f"Segment_{one.label}", "Name": name or f"Segment {one.label}", "LabelValue": one.label, "Layer": 0,
            "Extent": extent, "NameAutoGenerated": 0, "ColorAutoGenerated": int(one.color is None),
        }  # fmt: skip
        if one.color is not None:
            facts["Color"] = " ".join(f"{channel:.6g}" for channel in to_display(np.array(one.color, np.float64)))
        lines += [f"Segment{number}_{key}:={value}" for key, value in facts.items()]
    return lines


def _vector(numbers) -> str:
    """A vector as NRRD writes it, with numbers that read back exactly."""
    return "(" + ",".join(repr(float(n)) for n in numbers) + ")"


def lost_in_nrrd(volume: Volume) -> list[str]:
    """Sentences on what a NRRD file does not store."""
    if (volume.slope, volume.intercept) == (1.0, 0.0):
        return []
    return ["NRRD has no slope and intercept; this program reads them back, others see the stored values."]
