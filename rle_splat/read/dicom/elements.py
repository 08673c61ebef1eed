"""Named data elements of one DICOM file, and where its voxels are. Nothing else of a file is kept.

pydicom parses. Its exceptions may quote values, so none of them goes further than this module.
"""

import io
import math
import os
import re
import struct
import warnings
import zlib
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from .refusals import damage_error, unreadable

TAGS = {
    "ImageType": 0x00080008, "SOPClassUID": 0x00080016, "SOPInstanceUID": 0x00080018, "SeriesDate": 0x00080021,
    "AcquisitionDate": 0x00080022, "SeriesTime": 0x00080031, "AcquisitionTime": 0x00080032, "Modality": 0x00080060,
    "SeriesDescription": 0x0008103E, "PatientWeight": 0x00101030, "BodyPartExamined": 0x00180015,
    "EchoTime": 0x00180081, "TriggerTime": 0x00181060, "DiffusionBValue": 0x00189087, "SeriesInstanceUID": 0x0020000E,
    "SeriesNumber": 0x00200011, "AcquisitionNumber": 0x00200012, "InstanceNumber": 0x00200013,
    "ImagePositionPatient": 0x00200032, "ImageOrientationPatient": 0x00200037, "FrameOfReferenceUID": 0x00200052,
    "TemporalPositionIdentifier": 0x00200100, "SamplesPerPixel": 0x00280002, "PhotometricInterpretation": 0x00280004,
    "NumberOfFrames": 0x00280008, "Rows": 0x00280010, "Columns": 0x00280011, "PixelSpacing": 0x00280030,
    "BitsAllocated": 0x00280100, "BitsStored": 0x00280101, "HighBit": 0x00280102, "PixelRepresentation": 0x00280103,
    "PixelPaddingValue": 0x00280120, "PixelPaddingRangeLimit": 0x00280121, "WindowCenter": 0x00281050,
    "WindowWidth": 0x00281051, "RescaleIntercept": 0x00281052, "RescaleSlope": 0x00281053, "RescaleType": 0x00281054,
    "ModalityLUTSequence": 0x00283000, "RadiopharmaceuticalInformationSequence": 0x00540016, "Units": 0x00541001,
    "SUVType": 0x00541006, "DecayCorrection": 0x00541102, "SegmentationType": 0x00620001, "SegmentSequence": 0x00620002,
    "MaximumFractionalValue": 0x0062000E, "DoseUnits": 0x30040002, "GridFrameOffsetVector": 0x3004000C,
    "DoseGridScaling": 0x3004000E, "SharedFunctionalGroupsSequence": 0x52009229, "ExtendedOffsetTable": 0x7FE00001,
    "ExtendedOffsetTableLengths": 0x7FE00002, "StructureSetROISequence": 0x30060020,
}  # fmt: skip
# Sequences that are read item by item: DirectoryRecordSequence and PerFrameFunctionalGroupsSequence.
LONG_SEQUENCES = (0x00041220, 0x52009230)
CONTOURS = 0x30060039  # ROIContourSequence, read item by item where contours are wanted; else reading ends there
DIRECTORY_CLASS = "1.2.840.10008.1.3.10"
VOXEL_TAGS = {0x7FE00008: "float", 0x7FE00009: "double", 0x7FE00010: "integer"}
UNDEFINED = 0xFFFFFFFF
DEFLATED = ("1.2.840.10008.1.2.1.99",)
BIG_ENDIAN = "1.2.840.10008.1.2.2"
HEAD = 1024  # bytes that tell whether a file is DICOM and whether it is deflated
# Of the first element of a file without a preamble: group length, character set, image type, dates, class, instance.
FIRST_ELEMENTS = (0x0000, 0x0001, 0x0005, 0x0008, 0x0012, 0x0013, 0x0016, 0x0018)
FIRST_REPRESENTATIONS = (b"UL", b"CS", b"UI", b"DA", b"TM", b"LO")
LONGEST_FIRST = 128
LARGE_READ = 1 << 16  # reads beyond this are cut to what the file holds: a damaged length must not take memory
INFLATE_PIECE = 1 << 20
INFLATE_LIMIT = 1032  # deflate cannot expand data more than this many times
LARGEST_INFLATED = 1 << 32
LONG_LENGTHS = (b"OB", b"OW", b"OF", b"OD", b"OL", b"OV", b"UN")


@dataclass(frozen=True)
class Elements:
    """One parsed file.

    Attributes
    ----------
    syntax : str
        UID of the transfer syntax; "" if the file does not say.
    is_directory : bool
        Whether the file is a DICOMDIR.
    dataset : pydicom.Dataset
        The named elements.
    frames : tuple of pydicom.Dataset
        Functional groups of each frame of an enhanced object, records of a DICOMDIR, or contours of each region of an
        RTSTRUCT; empty for others.
    kind : str
        "integer", "float" or "double"; "" if the file has no voxels.
    offset, length : int
        Where the voxels' value begins and its bytes; the length is UNDEFINED if they are encapsulated. Offsets of a
        deflated file count in the inflated data.
    words : bool
        Whether the voxels are 16-bit words (value representation OW).
    size : int
        Bytes of the file.
    """

    path: Path
    syntax: str
    is_directory: bool
    little_endian: bool
    dataset: object
    frames: tuple
    kind: str
    offset: int
    length: int
    words: bool
    size: int


@cache
def problems() -> tuple:
    """Classes of what pydicom raises on damaged files, found by damaging files."""
    from pydicom.errors import BytesLengthException, InvalidDicomError

    return (
        ArithmeticError, AssertionError, AttributeError, BytesLengthException, EOFError, InvalidDicomError, LookupError,
        MemoryError, OSError, RuntimeError, TypeError, ValueError, struct.error, zlib.error,
    )  # fmt: skip


class Bounded(io.BufferedReader):
    """A file whose large reads end with the file, without memory for what is not there."""

    def __init__(self, path):
        super().__init__(io.FileIO(path))
        self.size = os.fstat(self.fileno()).st_size

    def read(self, count=-1):
        if count is not None and count > LARGE_READ:
            count = max(min(count, self.size - self.tell()), 0)
        return super().read(count)


def is_dicom(path) -> bool:
    """Whether a file's first bytes are those of DICOM, with or without the preamble. Raises OSError."""
    with open(path, "rb") as stream:
        return is_dicom_head(stream.read(HEAD))


def is_dicom_head(head: bytes) -> bool:
    """As ``is_dicom``, for the first bytes of a file."""
    return head[128:132] == b"DICM" or any(_begins_dataset(head, order) for order in "<>")


def _begins_dataset(head: bytes, order: str) -> bool:
    """Whether bytes begin with an element of group 2 or 8, as files without a preamble do; ``order``: "<" or ">".

    Voxels of a raw file can look like a tag, so the element's length and text are looked at, too.
    """
    if len(head) < 16:
        return False
    group, element = struct.unpack(f"{order}HH", head[:4])
    if group not in (0x0002, 0x0008) or element not in FIRST_ELEMENTS:
        return False
    if head[4:6] in FIRST_REPRESENTATIONS:
        length = struct.unpack(f"{order}H", head[6:8])[0]
    else:
        length = struct.unpack(f"{order}L", head[4:8])[0]
    if element == 0:
        return length == 4  # the group's length
    value = head[8 : 8 + length].rstrip(b"\0")
    return len(value) > 0 and length <= LONGEST_FIRST and length % 2 == 0 and all(32 <= byte < 127 for byte in value)


def inflate(packed):
    """Generator of None now and then: inflate the rest of a stream; returns a stream of it, at its begin."""
    stream, inflater, waiting = io.BytesIO(), zlib.decompressobj(-zlib.MAX_WBITS), b""
    limit = min(LARGEST_INFLATED, INFLATE_LIMIT * packed.size)
    while not inflater.eof and (waiting or (waiting := packed.read(INFLATE_PIECE))):
        stream.write(inflater.decompress(waiting, INFLATE_PIECE))
        waiting = inflater.unconsumed_tail
        if stream.tell() > limit:
            raise ValueError("too large")
        yield
    stream.seek(0)
    return stream


def to_dataset(stream):
    """Read what comes before the dataset; the stream stays at its begin.

    Returns (transfer syntax, whether the file is a DICOMDIR, implicit, little_endian).
    """
    from pydicom.filereader import read_partial

    head = stream.read(HEAD)
    stream.seek(0)
    if any(syntax.encode() in head for syntax in DEFLATED):  # read_partial would inflate the whole file at once
        end = 144 + struct.unpack("<L", head[140:144])[0]  # the group's length is its first element
        syntax = next(syntax for syntax in DEFLATED if syntax.encode() in head)
        if head[128:132] == b"DICM" and head[132:136] == b"\2\0\0\0" and syntax.encode() in head[:end]:
            stream.seek(end)
            return syntax, False, False, True
    dataset = read_partial(stream, stop_when=lambda tag, vr, length: True, force=True)
    implicit, little_endian = dataset.original_encoding
    syntax, kind = (str(dataset.file_meta.get(f"{name}UID", "")) for name in ("TransferSyntax", "MediaStorageSOPClass"))
    return syntax, kind == DIRECTORY_CLASS, bool(implicit), bool(little_endian)


def read_elements(path: str | Path, contours: bool = False):
    """Generator of None now and then: read the named elements of one file; returns None if it is not DICOM.

    Parameters
    ----------
    contours : bool
        Whether to read the contours of an RTSTRUCT.

    Raises
    ------
    Damaged
        If the file cannot be read or is damaged.
    """
    path = Path(path)
    try:
        if not is_dicom(path):
            return None
        with Bounded(path) as stream:
            size = stream.size
            syntax, *facts = quietly(to_dataset, stream)
            if syntax in DEFLATED:
                stream = yield from inflate(stream)
            return (yield from _parse(path, stream, size, syntax, *facts, contours))
    except OSError as problem:
        raise unreadable(path, problem) from None
    except problems():
        raise damage_error(path) from None


def _parse(path, stream, size, syntax, is_directory, implicit, little_endian, contours):
    """Generator, as ``read_elements``, for a stream at its dataset."""
    from pydicom.filereader import read_dataset

    long_sequences = (*LONG_SEQUENCES, *((CONTOURS,) if contours else ()))
    stops = {*LONG_SEQUENCES, CONTOURS, *VOXEL_TAGS}
    options = dict(stop_when=lambda tag, vr, length: tag in stops, specific_tags=list(TAGS.values()))
    dataset = quietly(read_dataset, stream, implicit, little_endian, **options)
    implicit = bool(dataset.original_encoding[0])  # pydicom corrects a wrong transfer syntax
    tag, length, representation = _element_header(stream, implicit, little_endian)
    frames = ()
    if tag in long_sequences:
        frames = yield from _items(stream, implicit, little_endian, length)
        stops.difference_update(long_sequences)
        if not _at_end(stream):
            dataset.update(quietly(read_dataset, stream, implicit, little_endian, **options))
        tag, length, representation = _element_header(stream, implicit, little_endian)
    words = representation in (b"", b"OW")
    kind = VOXEL_TAGS.get(tag, "")
    return Elements(
        path, syntax, is_directory, little_endian, dataset, frames, kind, stream.tell(), length, words, size
    )


def _at_end(stream) -> bool:
    at_end = not stream.read(1)
    if not at_end:
        stream.seek(-1, io.SEEK_CUR)
    return at_end


def _element_header(stream, implicit: bool, little_endian: bool) -> tuple[int, int, bytes]:
    """(tag, length, value representation) of the element at the stream, which stays at its value; 0 at the end."""
    order = "<" if little_endian else ">"
    head = stream.read(8)
    if len(head) < 8:
        return 0, 0, b""
    group, element = struct.unpack(f"{order}HH", head[:4])
    representation = b"" if implicit else head[4:6]
    if implicit:
        length = struct.unpack(f"{order}L", head[4:])[0]
    elif representation in LONG_LENGTHS or representation == b"SQ":
        length = struct.unpack(f"{order}L", stream.read(4))[0]
    else:
        length = struct.unpack(f"{order}H", head[6:])[0]
    return group << 16 | element, length, representation


def _items(stream, implicit: bool, little_endian: bool, length: int):
    """Generator: the items of a sequence, one by one."""
    from pydicom.filereader import read_sequence_item

    end = math.inf if length == UNDEFINED else stream.tell() + length
    found = []
    while stream.tell() < end:
        item = quietly(read_sequence_item, stream, implicit, little_endian, "iso8859")
        if item is None:
            break
        found.append(item)
        yield
    return tuple(found)


@contextmanager
def quiet():
    """Context manager: without the warnings of pydicom, which may quote values."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def quietly(function, *arguments, **options):
    """Call a function within ``quiet``."""
    with quiet():
        return function(*arguments, **options)


# The functions below convert values, about which pydicom may warn: call them within ``quiet``.
def text(dataset, name: str) -> str:
    """A named element as text, stripped; "" if it is absent or unreadable."""
    found = value(dataset, name)
    return "" if found is None else str(found).strip()


def texts(dataset, name: str) -> tuple[str, ...]:
    """The values of a named element as texts."""
    found = value(dataset, name)
    if found is None or isinstance(found, str):
        found = [found] if found else []
    try:
        return tuple(str(part).strip() for part in found)
    except problems():
        return ()


def numbers(dataset, name: str, count: int | None = None) -> tuple[float, ...] | None:
    """The values of a named element as finite numbers; None if they are absent, unreadable or not ``count``."""
    found = value(dataset, name)
    if found is None or isinstance(found, bytes):
        return None
    several = hasattr(found, "__len__") and not isinstance(found, str)
    try:
        values = tuple(float(part) for part in (found if several else [found]))
    except problems():
        return None
    wrong = not values or (count is not None and len(values) != count) or not all(map(math.isfinite, values))
    return None if wrong else values


def decimals(dataset, name: str):
    """The values of a named element of decimal strings, (n,) float64; None if they are absent, unreadable or infinite.

    As ``numbers``, for many values: it takes a thirtieth of the time, since pydicom makes no object of each.
    """
    import numpy as np

    try:
        raw = dataset.get_item(_tag(name)).value
        found = np.array([float(part) for part in raw.rstrip(b"\0 ").split(b"\\")])
    except problems():
        found = np.array(numbers(dataset, name) or ())
    return found if found.size and np.isfinite(found).all() else None


def number(dataset, name: str) -> float | None:
    """The first value of a named element as a finite number."""
    found = numbers(dataset, name)
    return found[0] if found else None


def whole(dataset, name: str, default: int | None = None) -> int | None:
    """A named element as a whole number."""
    found = number(dataset, name)
    return default if found is None else int(found)


def item(dataset, name: str):
    """The first item of a named sequence; None if there is none."""
    found = items(dataset, name)
    return found[0] if found else None


def items(dataset, name: str) -> tuple:
    """The items of a named sequence."""
    found = value(dataset, name)
    return tuple(found) if found is not None and type(found).__name__ == "Sequence" else ()


def value(dataset, name: str):
    """Value of a named element, converted by pydicom; None if it is absent or unreadable."""
    if dataset is None:
        return None
    try:
        found = dataset.get(_tag(name))  # by keyword it takes three times as long
        return None if found is None else found.value
    except problems():
        return None


def seconds(time: str) -> float | None:
    """Seconds of a time of day, HHMMSS.ffffff; None if it is no such text."""
    if not re.fullmatch(r"\d{6}(\.\d{1,6})?", time):
        return None
    seconds = 3600 * int(time[:2]) + 60 * int(time[2:4]) + float(time[4:])
    return seconds if math.isfinite(seconds) else None


@cache
def _tag(name: str):
    """Tag of an element by its keyword."""
    from pydicom.tag import Tag

    return Tag(name)
