"""One plain record for each image frame of a parsed file: where it lies, what its values mean, what tells it apart."""

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

from . import elements as read
from .modality_table import Table, table_of
from .refusals import Refused, breaks_off, contours_alone, damage_error
from .stacking import axes
from .suv import UNIT as SUV
from .suv import Pet, pet_of

NATIVE = ("", "1.2.840.10008.1.2", "1.2.840.10008.1.2.1", read.BIG_ENDIAN, *read.DEFLATED)
RLE = "1.2.840.10008.1.2.5"
JPEG = tuple(f"1.2.840.10008.1.2.4.{number}" for number in (50, 51, 57, 70, 80, 81))  # the last two: JPEG-LS
JPEG_2000 = tuple(f"1.2.840.10008.1.2.4.{number}" for number in (90, 91, 201, 202, 203))  # 201 on: HTJ2K
VIDEO = tuple(f"1.2.840.10008.1.2.4.{number}" for number in range(100, 110))
STRUCTURES = "1.2.840.10008.5.1.4.1.1.481.3"
SEGMENTATIONS = ("1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7")
# Classes of computed radiography, CT, ultrasound, MR, X-ray, nuclear medicine, PET and dose: a file breaks off before
# its voxels if it has none.
IMAGES = re.compile(r"1\.2\.840\.10008\.5\.1\.4\.1\.1\.(1|2|3|4|6|7|12|13|14|20|128|130|481\.2)(\.[0-9.]+)?")
ALLOCATED = {"integer": (1, 8, 16, 32), "float": (32,), "double": (64,)}
LARGEST_SIDE = 1 << 16
YIELD_FRAMES = 16  # frames between two steps; 8 ms
PET_UNITS = {"BQML": "Bq/ml", "GML": "g/ml", "CNTS": "counts"}
# What may tell pictures at one place apart, in this order, and what the choice of a frame is called then.
SEPARATORS = (
    "temporal position", "trigger time", "echo time", "b-value", "acquisition number", "acquisition time", "image type",
)  # fmt: skip
TIMES = ("temporal position", "trigger time", "acquisition number", "acquisition time")
FRAME_TYPES = ("MRImageFrameTypeSequence", "CTImageFrameTypeSequence", "PETFrameTypeSequence")


@dataclass(frozen=True)
class Storage:
    """How the voxels of one file are stored.

    ``kind``, ``offset``, ``length``, ``words`` as in ``elements.Elements``; ``tables``: offsets and lengths of the
    extended offset table, as bytes.
    """

    path: Path
    syntax: str
    little_endian: bool
    kind: str
    offset: int
    length: int
    words: bool
    size: int
    rows: int
    columns: int
    frames: int
    allocated: int
    stored: int
    high: int
    signed: bool
    tables: tuple[bytes, bytes] | None = None

    @property
    def native(self) -> bool:
        """Whether the voxels are not compressed."""
        return self.syntax in NATIVE

    @property
    def frame_bits(self) -> int:
        """Bits of one frame that is not compressed."""
        return self.rows * self.columns * self.allocated

    @property
    def total_bytes(self) -> int:
        """Bytes of all frames that are not compressed."""
        return -(-self.frames * self.frame_bits // 8)


@dataclass(frozen=True)
class Series:
    """What the pictures of one file have in common.

    ``key`` is a hash of the series' UID, ``instance`` of the object's, ``place`` of the frame of reference's; the
    description is for the chooser alone. ``pet``: dose and decay of a PET.
    ``table``: from stored to physical values, in place of slope and intercept; ``odd_values``: whether there is one.
    """

    key: str
    instance: str
    place: str
    number: int
    modality: str
    body_part: str
    description: str
    value_unit: str | None
    inverted: bool
    odd_values: bool
    table: Table | None
    window: tuple[float, float] | None
    pet: Pet | None


@dataclass(frozen=True)
class ImageFrame:
    """One image frame.

    ``position`` (3), ``orientation`` (6) in LPS millimeters and ``spacing`` (between rows, between columns) are None if
    the file does not say. A physical value is slope * stored + intercept. ``padding``: the smallest and the largest
    stored value that mark voxels outside the scan. ``apart``: values that may tell it from others at its place.
    """

    storage: Storage
    series: Series
    number: int
    instance_number: int
    position: tuple | None
    orientation: tuple | None
    spacing: tuple | None
    slope: float
    intercept: float
    padding: tuple | None
    localizer: bool
    stack: str
    apart: dict


def hash_text(uid: str) -> str:
    """Short hash of a UID, which may be kept where the UID may not."""
    return hashlib.blake2b(uid.encode(), digest_size=8).hexdigest() if uid else ""


def series_key(found: read.Elements) -> str:
    """Hash of the series of a file; files that name none are a series of their folder."""
    return hash_text(read.text(found.dataset, "SeriesInstanceUID") or f"folder {found.path.parent}")


def picture_steps(found: read.Elements):
    """Generator: the pictures of one file; yields None now and then.

    Returns
    -------
    tuple of ImageFrame

    Raises
    ------
    Refused
        If the file has no voxels, or voxels that make no volume.
    """
    _refuse_other_objects(found)
    return (yield from frame_steps(found))


def is_segmentation(found: read.Elements) -> bool:
    """Whether a file is a DICOM SEG."""
    return read.text(found.dataset, "SOPClassUID") in SEGMENTATIONS


def is_structures(found: read.Elements) -> bool:
    """Whether a file is an RTSTRUCT."""
    return read.text(found.dataset, "SOPClassUID") == STRUCTURES or read.text(found.dataset, "Modality") == "RTSTRUCT"


def frame_steps(found: read.Elements):
    """Generator, as ``picture_steps``, for a file of any kind. Raises Refused if it is damaged."""
    dataset = found.dataset
    storage = _storage(found)
    shared = read.item(dataset, "SharedFunctionalGroupsSequence")
    if found.frames and len(found.frames) != storage.frames:
        raise damage_error(found.path)
    series = _series(found, (found.frames or (None,))[0], shared)
    offsets = read.numbers(dataset, "GridFrameOffsetVector", storage.frames) if storage.frames > 1 else None
    pictures = []
    for number, frame in enumerate(found.frames or (None,) * storage.frames):
        pictures.append(_picture(storage, series, number, dataset, (frame, shared), offsets))
        if number % YIELD_FRAMES == YIELD_FRAMES - 1:
            yield None
    return tuple(pictures)


def _refuse_other_objects(found: read.Elements) -> None:
    """Refuse objects that are no gray pictures, in one sentence each."""
    dataset, name = found.dataset, found.path.name
    kind = read.text(dataset, "SOPClassUID")
    if is_segmentation(found):
        raise Refused(
            f"{name} is a segmentation, no image; choose the series of its images, and read the file as labels."
        )
    if is_structures(found):
        raise contours_alone(found.path)
    if found.syntax in VIDEO:
        raise Refused(f"{name} is a video; choose a series of slices.")
    if not found.kind and IMAGES.fullmatch(kind):
        raise damage_error(found.path)
    if not found.kind:
        raise Refused(f"{name} is no image but a report, a plan, a waveform or the like; choose a series of slices.")
    color = read.text(dataset, "PhotometricInterpretation")
    if read.whole(dataset, "SamplesPerPixel", 1) != 1 or (color and not color.startswith("MONOCHROME")):
        raise Refused(f"{name} is a color picture; choose a series with one gray value in each voxel.")
    if "MOSAIC" in read.texts(dataset, "ImageType"):
        raise Refused(f"{name} is a mosaic of slices in one picture; convert it with dcm2niix.")


def _storage(found: read.Elements) -> Storage:
    """How the voxels of a file are stored."""
    dataset = found.dataset
    if not (found.syntax in NATIVE or found.syntax == RLE or found.syntax in JPEG + JPEG_2000):
        raise Refused(
            f"{found.path.name} is compressed in a way that cannot be read here; export it uncompressed, as Explicit "
            "VR Little Endian."
        )
    rows, columns = read.whole(dataset, "Rows", 0), read.whole(dataset, "Columns", 0)
    frames = read.whole(dataset, "NumberOfFrames", 1) or 1
    allocated = read.whole(dataset, "BitsAllocated", {"float": 32, "double": 64}.get(found.kind, 0))
    stored = read.whole(dataset, "BitsStored", allocated)
    high = read.whole(dataset, "HighBit", stored - 1)
    sides = all(0 < side < LARGEST_SIDE for side in (rows, columns))
    bits = allocated in ALLOCATED[found.kind] and 0 < stored <= high + 1 <= allocated
    if not sides or frames < 1 or not bits:
        raise damage_error(found.path)
    tables = (_bytes(dataset, "ExtendedOffsetTable"), _bytes(dataset, "ExtendedOffsetTableLengths"))
    storage = Storage(
        found.path, found.syntax, found.little_endian, found.kind, found.offset, found.length, found.words, found.size,
        rows, columns, frames, allocated, stored, high, read.whole(dataset, "PixelRepresentation", 0) == 1,
        tables if all(tables) else None,
    )  # fmt: skip
    if frames > found.size or (storage.native and found.length == read.UNDEFINED):
        raise damage_error(found.path)
    return storage


def check_size(storage: Storage) -> None:
    """Refuse a file that holds fewer voxels than it states. Compressed ones are checked when they are read."""
    if not storage.native:
        return
    there = storage.length
    if storage.syntax not in read.DEFLATED:  # offsets count in the inflated data
        there = max(min(storage.size - storage.offset, there), 0)
    if there < storage.total_bytes:
        raise breaks_off(storage.path, there, storage.total_bytes)


def _bytes(dataset, name: str) -> bytes:
    found = dataset.get(name, b"")
    return found if isinstance(found, bytes) else b""


def _read_code(dataset, name: str) -> str:
    """A coded value; "" for anything that is not a short word in capitals, which might be free text."""
    found = read.text(dataset, name)
    return found if re.fullmatch(r"[A-Z][A-Z0-9 _]{0,15}", found) else ""


def _series(found: read.Elements, frame, shared) -> Series:
    """What the pictures of a file have in common; ``frame``, ``shared``: functional groups of an enhanced object."""
    dataset = found.dataset
    modality = _read_code(dataset, "Modality")
    centers, widths = read.numbers(dataset, "WindowCenter"), read.numbers(dataset, "WindowWidth")
    table, table_unit = table_of(found)
    unit = _value_unit(dataset, modality, frame, shared) if table is None else table_unit or None
    return Series(
        key=series_key(found), instance=hash_text(read.text(dataset, "SOPInstanceUID")),
        place=hash_text(read.text(dataset, "FrameOfReferenceUID")),
        number=read.whole(dataset, "SeriesNumber", 0), modality=modality,
        body_part=_read_code(dataset, "BodyPartExamined"),
        description=read.text(dataset, "SeriesDescription"), value_unit=unit,
        inverted=read.text(dataset, "PhotometricInterpretation") == "MONOCHROME1",
        odd_values=read.item(dataset, "ModalityLUTSequence") is not None, table=table,
        window=(centers[0], widths[0]) if centers and widths else None,
        pet=pet_of(dataset) if modality == "PT" else None,
    )  # fmt: skip


def _value_unit(dataset, modality: str, frame, shared) -> str | None:
    """Unit of physical values, where the file says it."""
    if modality == "CT":
        given = _group(frame, shared, "PixelValueTransformationSequence") or dataset
        kind = read.text(given, "RescaleType")
        original = "ORIGINAL" in read.texts(dataset, "ImageType")[:1]
        return "HU" if kind == "HU" or (not kind and original) else None
    if modality == "PT":
        units = _read_code(dataset, "Units")
        if units == "GML" and read.text(dataset, "SUVType") in ("", "BW"):
            return SUV
        return PET_UNITS.get(units, units or None)
    if modality == "RTDOSE":
        return "Gy" if read.text(dataset, "DoseUnits") == "GY" else None
    return None


def _group(frame, shared, name: str):
    """The item of a functional group, of the frame's own or else of all frames; None if there is none."""
    own = read.item(frame, name)
    return own if own is not None else read.item(shared, name)


def _picture(storage: Storage, series: Series, number: int, dataset, groups, offsets) -> ImageFrame:
    """One frame; ``groups``: its functional groups and those of all frames; ``offsets``: of a radiation dose."""
    frame, shared = groups
    plane, turn = _group(frame, shared, "PlanePositionSequence"), _group(frame, shared, "PlaneOrientationSequence")
    orientation = read.numbers(turn or dataset, "ImageOrientationPatient", 6)
    position = read.numbers(plane or dataset, "ImagePositionPatient", 3)
    if plane is None and storage.frames > 1:
        position = _at_offset(position, orientation, offsets, number)
    spacing = read.numbers(_group(frame, shared, "PixelMeasuresSequence") or dataset, "PixelSpacing", 2)
    values = _group(frame, shared, "PixelValueTransformationSequence") or dataset
    types = _frame_type(dataset, frame, shared)
    content = read.item(frame, "FrameContentSequence")
    return ImageFrame(
        storage, series, number, read.whole(dataset, "InstanceNumber", 0), position, orientation,
        spacing if spacing and min(spacing) > 0.0 else None, *_mapping(values, dataset), _padding(dataset),
        "LOCALIZER" in types, read.text(content, "StackID"), _apart(dataset, groups, content, types),
    )  # fmt: skip


def _at_offset(position, orientation, offsets, number: int):
    """Position of a frame of a radiation dose, by its offset along the normal; None where nothing says it."""
    if offsets is None or position is None or orientation is None:
        return None
    normal = axes(orientation)[2]
    return tuple(p + (offsets[number] - offsets[0]) * n for p, n in zip(position, normal))


def _mapping(values, dataset) -> tuple[float, float]:
    """Slope and intercept."""
    slope = read.number(values, "RescaleSlope")
    if slope is None:
        slope = read.number(dataset, "DoseGridScaling")
    intercept = read.number(values, "RescaleIntercept")
    return 1.0 if slope is None or slope == 0.0 else slope, intercept or 0.0


def _padding(dataset) -> tuple | None:
    """Smallest and largest stored value of voxels outside the scan."""
    value = read.number(dataset, "PixelPaddingValue")
    limit = read.number(dataset, "PixelPaddingRangeLimit")
    if value is None:
        return None
    return tuple(sorted((value, value if limit is None else limit)))


def _frame_type(dataset, frame, shared) -> tuple[str, ...]:
    """ImageType, or FrameType of an enhanced object's frame."""
    for name in FRAME_TYPES:
        found = _group(frame, shared, name)
        if found is not None:
            return read.texts(found, "FrameType")
    return read.texts(dataset, "ImageType")


def _apart(dataset, groups, content, types) -> dict:
    """Values by SEPARATORS' names; names without a value are left out. Further ones: dimensions of enhanced objects."""
    frame, shared = groups
    if frame is None:
        found = [
            read.number(dataset, "TemporalPositionIdentifier"), read.number(dataset, "TriggerTime"),
            read.number(dataset, "EchoTime"), read.number(dataset, "DiffusionBValue"),
            read.number(dataset, "AcquisitionNumber"), read.seconds(read.text(dataset, "AcquisitionTime")),
        ]  # fmt: skip
    else:
        found = [
            read.number(content, "TemporalPositionIndex"),
            read.number(_group(frame, shared, "CardiacSynchronizationSequence"), "NominalCardiacTriggerDelayTime"),
            read.number(_group(frame, shared, "MREchoSequence"), "EffectiveEchoTime"),
            read.number(_group(frame, shared, "MRDiffusionSequence"), "DiffusionBValue"),
            read.number(content, "FrameAcquisitionNumber") or read.number(dataset, "AcquisitionNumber"),
            read.seconds(read.text(dataset, "AcquisitionTime")),  # the frames' own time includes the date
        ]  # fmt: skip
    named = {name: value for name, value in zip(SEPARATORS, (*found, types or None)) if value is not None}
    for i, value in enumerate(read.numbers(content, "DimensionIndexValues") or ()):
        named[f"dimension {i + 1}"] = value
    return named
