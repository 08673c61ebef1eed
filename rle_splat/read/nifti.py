"""NIfTI-1 and -2 (one file or two) and Analyze 7.5: headers by nibabel, voxels streamed.

Where the header codes a place in the patient, the sform counts before the qform, as in nibabel and SPM. Its space is
RAS and becomes LPS; voxels are never flipped.
"""

import math
import re
import struct
from dataclasses import dataclass
from html import escape, unescape
from pathlib import Path

import numpy as np

from ..runtime.steps import Progress
from ..scene import RleSplatError
from ..scene.color import linear, to_display
from ..volume.orientation import lps_from_ras
from ..volume.volume import PATIENT, NamedLabel, Volume
from .format import Head, head_of
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
from .library_import import library_steps
from .streaming import EndsEarly, Part, bytes_steps, open_to_write, plain_name, voxel_steps, write_voxel_steps

MAGICS = {b"n+1\0": 1, b"ni1\0": 1, b"n+2\0": 2, b"ni2\0": 2}  # at byte 344 of version 1, at byte 4 of version 2
SINGLE = (b"n+1\0", b"n+2\0")  # voxels in the same file
SIZES = {1: 348, 2: 540}  # bytes of a header
LENGTH_UNITS = {1: "m", 2: "mm", 3: "um"}
MOST_EXTENSION = 1 << 24  # bytes between header and voxels that are searched for names of labels
LABEL = re.compile(rb"<Label\b([^>]*)>(?:\s*<!\[CDATA\[(.*?)\]\]>\s*|([^<]*))</Label>", re.DOTALL)
ATTRIBUTE = re.compile(rb'(\w+)\s*=\s*"([^"]*)"')
CARET = 0  # code of an extension of TotalSegmentator's label tables; 30 is the registered one, which it does not write
LARGEST_SHORT = 32767  # voxels along an axis in a NIfTI-1 header


@dataclass(frozen=True)
class _NiftiFacts:
    """What a header says: ``offset`` is where the voxels begin in the data, ``data`` the file they are in."""

    shape: tuple
    dtype: np.dtype
    frames: int
    frame_axis: str
    affine: np.ndarray
    unit: str
    space: str | None
    slope: float
    intercept: float
    offset: int
    data: Path
    header_bytes: int
    remarks: tuple


def _version(content: bytes) -> int | None:
    """The version of the NIfTI header that bytes begin with; 0 for Analyze, None for neither."""
    if len(content) < SIZES[1]:
        return None
    sizes = {struct.unpack(order + "i", content[:4])[0] for order in "<>"}
    if SIZES[2] in sizes and len(content) >= SIZES[2]:
        return 2 if MAGICS.get(content[4:8]) == 2 else None
    if SIZES[1] not in sizes:
        return None
    return 1 if MAGICS.get(content[344:348]) == 1 else 0


def recognizes_nifti(head: Head) -> bool:
    """Whether a file begins with a NIfTI header, or with one of Analyze and its name says so."""
    version = _version(head.content)
    return bool(version) or (version == 0 and head.path.name.lower().endswith((".hdr", ".hdr.gz")))


def _partner(path: Path, suffix: str) -> Path:
    """The other file of a pair, with the same stem; RleSplatError if it is missing."""
    stem = re.sub(r"\.(hdr|img)(\.gz)?$", "", path.name, flags=re.IGNORECASE)
    for name in (stem + suffix, stem + suffix.upper(), stem + suffix + ".gz"):
        if path.with_name(name).is_file():
            return path.with_name(name)
    raise RleSplatError(f"{path.name} needs {stem}{suffix} beside it, which is not there; copy both files.")


def _facts(path: Path) -> _NiftiFacts:
    """Read and check the header of a file."""
    nibabel = library("nibabel", "nibabel", "NIfTI")
    is_image = bool(re.search(r"\.img(\.gz)?$", path.name, flags=re.IGNORECASE)) and not recognizes_nifti(head_of(path))
    source = _partner(path, ".hdr") if is_image else path
    content = head_of(source).content
    version = _version(content)
    if version is None:
        raise RleSplatError(f"{source.name} is not a NIfTI or Analyze file, or its header is cut short; copy it again.")
    kind = (nibabel.AnalyzeHeader, nibabel.Nifti1Header, nibabel.Nifti2Header)[version]
    header = kind(content[: SIZES[version or 1]], check=False)
    is_single = content[344:348] in SINGLE or content[4:8] in SINGLE
    count = int(header["dim"][0])
    if not 1 <= count <= 7 or (header["dim"][1 : count + 1] < 0).any():
        raise damage_error(source, f"it says {count} dimensions of {' x '.join(map(str, header['dim'][1:]))}")
    lengths = [max(1, int(n)) for n in header["dim"][1 : count + 1]] + [1] * (7 - count)
    shape = check_grid(source, lengths[:3])
    try:
        dtype = header.get_data_dtype()
    except (KeyError, nibabel.spatialimages.HeaderDataError):
        raise damage_error(source, f"its number type {int(header['datatype'])} does not exist") from None
    offset = float(header["vox_offset"])
    if not (math.isfinite(offset) and 0.0 <= offset < 2.0**40):
        raise damage_error(source, f"its voxels begin at byte {offset:g}")
    slope, intercept = _scale(header, version)
    affine, unit, space, remarks = _geometry(source, header, version)
    return _NiftiFacts(
        shape, check_kind(source, dtype), math.prod(lengths[3:]), "time" if max(lengths[4:]) == 1 else "kind",
        affine, unit, space, slope, intercept, max(int(offset), SIZES[version] + 4) if is_single else int(offset),
        source if is_single else _partner(source, ".img"), SIZES[version or 1], remarks,
    )  # fmt: skip


def _scale(header, version: int) -> tuple[float, float]:
    """Slope and intercept; a slope of zero or NaN means none, as the standard says."""
    if version == 0:
        return 1.0, 0.0
    slope, intercept = float(header["scl_slope"]), float(header["scl_inter"])
    if slope == 0.0 or not math.isfinite(slope):
        return 1.0, 0.0
    return slope, intercept if math.isfinite(intercept) else 0.0


def _geometry(path, header, version: int):
    """The affine to LPS millimeters, or the spacing alone; returns (affine, unit, space, remarks)."""
    nibabel = library("nibabel", "nibabel", "NIfTI")
    spacing, remarks = sensible_spacing(header["pixdim"][1:4])
    if version == 0:
        return np.diag((*spacing, 1.0)), "mm", None, (*remarks, "Analyze files do not say where left and right are.")
    code = int(header["xyzt_units"]) & 7
    unit = LENGTH_UNITS.get(code, "mm")
    if code not in LENGTH_UNITS:
        remarks += (MM_ASSUMED,)
    try:
        with np.errstate(invalid="ignore"):  # damaged numbers; checked_affine refuses them
            affine = header.get_sform(coded=True)[0]
            if affine is None:
                affine = header.get_qform(coded=True)[0]
    except (ValueError, nibabel.spatialimages.HeaderDataError):
        raise damage_error(path, "its rotation is not one") from None
    if affine is None:
        remarks += ("The file does not say how it lies in the patient, so left and right are not known.",)
        return np.diag((*spacing, 1.0)), unit, None, remarks
    scale = np.diag((*[MILLIMETERS[unit]] * 3, 1.0))
    return lps_from_ras(scale @ check_affine(path, affine)), "mm", PATIENT, remarks


def read_nifti_steps(path, frame=None):
    """Generator of Progress: read a NIfTI or Analyze file; return the Volume.

    Parameters
    ----------
    path : str or Path
        Of a pair of files, either.
    frame : int or None
        The volume of a 4-D file, from 1; None for the first.

    Returns
    -------
    Volume
        In patient space if the header codes one. Its stored values are those of the file, with scl_slope and scl_inter
        as slope and intercept. Names of labels come from a label table (as of TotalSegmentator) in the header.

    Raises
    ------
    RleSplatError
        If the file is damaged, cut short, of another kind, or its voxels are not single numbers.
    """
    path = Path(path)
    yield Progress(0.0, f"reading {path.name}")
    yield from library_steps("nibabel", "nibabel", "NIfTI")
    facts = _facts(path)
    frame = check_frame(path, frame, facts.frames)
    packing = "gzip" if head_of(facts.data).is_gzip else None
    labels = ()
    if facts.data == path and facts.header_bytes + 4 < facts.offset <= MOST_EXTENSION:
        try:
            labels = named_labels((yield from bytes_steps(path, facts.offset, packing))[facts.header_bytes + 4 :])
        except EndsEarly:
            labels = ()  # reading the voxels says so
    begin = (frame - 1) * math.prod(facts.shape) * facts.dtype.itemsize
    part = Part(facts.data, packing=packing, skip=facts.offset)
    voxels = yield from voxel_steps(facts.data, facts.shape, facts.dtype, [part], begin)
    return Volume(
        voxels=voxels, affine=facts.affine, unit=facts.unit, slope=facts.slope, intercept=facts.intercept,
        name=plain_name(path), space=facts.space, frames=facts.frames, frame_axis=facts.frame_axis,
        named_labels=labels, remarks=facts.remarks + frame_remark(frame, facts.frames, facts.frame_axis),
    )  # fmt: skip


def named_labels(extension: bytes) -> tuple[NamedLabel, ...]:
    """Labels of a label table in XML, ``<Label Key="1" Red="0.5" ...>name</Label>``, in bytes after a header."""
    found = {}
    for attributes, quoted, plain in LABEL.findall(extension):
        facts = dict(ATTRIBUTE.findall(attributes))
        try:
            label = int(facts[b"Key"])
            color = tuple(float(facts[name]) for name in (b"Red", b"Green", b"Blue"))
        except (KeyError, ValueError):
            if b"Key" not in facts or not facts[b"Key"].strip().isdigit():
                continue
            label, color = int(facts[b"Key"]), None
        if color is not None and not all(0.0 <= c <= 1.0 for c in color):
            color = None
        name = (quoted or plain).decode("utf-8", "replace")
        found[label] = NamedLabel(label, (name if quoted else unescape(name)).strip(), linear(color))
    return tuple(found.values())


def write_nifti_steps(volume: Volume, path):
    """Generator of Progress: write a NIfTI file with the stored values, the affine, slope and intercept.

    NIfTI-1, or NIfTI-2 where an axis is longer than 32767 voxels. The affine goes into the sform, and into the qform
    too if it has no shear, since some programs read that alone. Names of labels go into an extension of the header, as
    those of TotalSegmentator and the Connectome Workbench do.

    Returns
    -------
    dict
        Options of ``read_volume`` for what the format does not store.
    """
    header, extension = _header_of(volume), _label_table(volume.named_labels)
    header["vox_offset"] += len(extension)
    with open_to_write(path) as stream:
        stream.write(header.binaryblock + bytes((bool(extension), 0, 0, 0)) + extension)
        yield from write_voxel_steps(volume.voxels, stream)
    options = {"value_unit": volume.value_unit, "modality": volume.modality}
    return {name: value for name, value in options.items() if value is not None}


def _label_table(labels) -> bytes:
    """The header extension that ``named_labels`` reads; empty without labels. Its length is a multiple of 16."""
    if not labels:
        return b""
    rows = []
    for one in labels:
        red, green, blue = to_display(np.array(one.color or (1.0, 1.0, 1.0), np.float64))
        colors = f' Red="{red:.6g}" Green="{green:.6g}" Blue="{blue:.6g}" Alpha="1"' if one.color else ""
        rows.append(f'<Label Key="{one.label}"{colors}>{escape(" ".join(one.name.split()), quote=False)}</Label>')
    table = f"<LabelTable>{''.join(rows)}</LabelTable>"
    text = f'<CaretExtension><VolumeInformation Index="0">{table}</VolumeInformation></CaretExtension>'
    content = b'<?xml version="1.0" encoding="UTF-8"?>' + text.encode()
    size = -(-(len(content) + 8) // 16) * 16
    return struct.pack("<2i", size, CARET) + content.ljust(size - 8, b"\0")


def _header_of(volume: Volume):
    """The nibabel header of a volume, little-endian."""
    nibabel = library("nibabel", "nibabel", "NIfTI")
    kind = nibabel.Nifti2Header if max(volume.shape_xyz) > LARGEST_SHORT else nibabel.Nifti1Header
    header = kind(endianness="<")
    header.set_data_dtype(volume.voxels.dtype)
    header.set_data_shape(volume.shape_xyz)
    header["vox_offset"] = SIZES[2 if kind is nibabel.Nifti2Header else 1] + 4
    header["scl_slope"], header["scl_inter"] = volume.slope, volume.intercept
    code = {"mm": 2, "m": 1, "um": 3}.get(volume.unit, 0)
    header["xyzt_units"] = code
    if volume.space == PATIENT:
        affine = lps_from_ras(volume.affine)  # its own inverse
        header.set_qform(affine, code=1, strip_shears=True)
        if not np.allclose(header.get_qform(), affine, rtol=0.0, atol=1e-4 * volume.spacing.min()):
            header["qform_code"] = 0
        header.set_sform(affine, code=1)
    header.set_zooms(volume.spacing)
    return header


def lost_in_nifti(volume: Volume) -> list[str]:
    """Sentences on what a NIfTI file does not store."""
    lost = []
    header = _header_of(volume)
    if volume.space == PATIENT and (header.get_sform() != lps_from_ras(volume.affine)).any():
        lost.append("The affine was rounded to 7 digits, as NIfTI stores it.")
    if volume.space is None and not np.allclose(volume.affine, np.diag((*volume.spacing, 1.0))):
        lost.append("The affine is not that of a patient, so only its spacing was stored.")
    if (float(header["scl_slope"]), float(header["scl_inter"])) != (volume.slope, volume.intercept):
        lost.append("Slope and intercept were rounded to 7 digits, as NIfTI stores them.")
    if volume.value_unit or volume.modality:
        lost.append("NIfTI has no field for modality and unit of values; give them again when you read the file.")
    return lost
