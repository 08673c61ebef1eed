"""DICOM files whose stored values say where they lie: value = 10 x patient coordinate in mm + 2000.

So any reader's array and affine can be judged in millimeters without knowing how it found them. Written with pydicom.
"""

from __future__ import annotations

import io
import random
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydicom import dcmread
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.encaps import encapsulate
from pydicom.sequence import Sequence
from pydicom.uid import (
    HTJ2K,
    JPEG2000,
    DeflatedExplicitVRLittleEndian,
    ExplicitVRBigEndian,
    ExplicitVRLittleEndian,
    HTJ2KLossless,
    HTJ2KLosslessRPCL,
    ImplicitVRLittleEndian,
    JPEG2000Lossless,
    JPEGBaseline8Bit,
    JPEGExtended12Bit,
    JPEGLossless,
    JPEGLosslessSV1,
    JPEGLSLossless,
    JPEGLSNearLossless,
    RLELossless,
    generate_uid,
)

from . import lossless_jpeg

SCALE, OFFSET = 10.0, 2000.0
CT, ENHANCED_CT, MR = "1.2.840.10008.5.1.4.1.1.2", "1.2.840.10008.5.1.4.1.1.2.1", "1.2.840.10008.5.1.4.1.1.4"
NATIVE = (
    ImplicitVRLittleEndian, ExplicitVRLittleEndian, ExplicitVRBigEndian, DeflatedExplicitVRLittleEndian,
)  # fmt: skip
# With what tests are installed with. A lossless JPEG of process 14 may have any predictor.
WRITABLE = (*NATIVE, RLELossless, JPEG2000Lossless, JPEG2000, JPEGLosslessSV1, JPEGLossless)
BY_IMAGECODECS = (  # with a package that the tests marked "extras" have
    JPEGExtended12Bit, JPEGLSLossless, JPEGLSNearLossless, JPEG2000Lossless, HTJ2KLossless, HTJ2KLosslessRPCL, HTJ2K,
)  # fmt: skip
BY_PILLOW = (JPEGBaseline8Bit,)
PERSON, NUMBER, BIRTH = "DOE^JANE", "ID-4711-X", "19510203"
COLUMNS, ROWS = 36, 33  # JPEG 2000 needs 32


@dataclass(frozen=True)
class Geometry:
    """Where slices lie, in LPS millimeters.

    ``row``, ``column``: directions; ``spacing``: between rows, between columns; ``positions`` (n, 3): of the first
    pixel of each slice, in the order of the files.
    """

    name: str
    row: tuple
    column: tuple
    spacing: tuple
    positions: np.ndarray

    def coordinates(self, i: int) -> np.ndarray:
        """(rows, columns, 3): patient coordinates of the pixels of slice ``i``."""
        y, x = np.mgrid[:ROWS, :COLUMNS].astype(np.float64)
        row, column = np.asarray(self.row), np.asarray(self.column)
        return (
            self.positions[i]
            + x[..., None] * row * self.spacing[1]
            + y[..., None] * column * self.spacing[0]
        )  # fmt: skip

    def values(self, i: int, axis: int) -> np.ndarray:
        """(rows, columns) float64: 10 x coordinate + 2000 of slice ``i``."""
        return SCALE * self.coordinates(i)[..., axis] + OFFSET


def geometry(name: str, row, column, steps, spacing=(0.6, 0.6), shear=(0.0, 0.0), origin=(-9.3, 4.1, 21.7)) -> Geometry:
    """Slices at ``steps`` (mm along the normal), moved by ``shear`` (mm along row and column) for each mm."""
    row, column = np.asarray(row, dtype=np.float64), np.asarray(column, dtype=np.float64)
    direction = np.cross(row, column) + shear[0] * row + shear[1] * column
    positions = np.asarray(origin) + np.asarray(steps, dtype=np.float64)[:, None] * direction
    return Geometry(name, tuple(row), tuple(column), spacing, np.round(positions, 6))


def _turned(degrees) -> tuple[np.ndarray, np.ndarray]:
    """Directions of rows and columns after turns about x, y and z."""
    matrix = np.eye(3)
    for axis, angle in enumerate(np.radians(degrees)):
        turn, (a, b) = np.eye(3), ((1, 2), (2, 0), (0, 1))[axis]
        turn[a, a] = turn[b, b] = np.cos(angle)
        turn[a, b], turn[b, a] = -np.sin(angle), np.sin(angle)
        matrix = turn @ matrix
    return matrix[:, 0], matrix[:, 1]


def geometries() -> dict[str, Geometry]:
    """The phantoms of the table, by name."""
    even = np.arange(9) * 1.5
    axial = ((1, 0, 0), (0, 1, 0))
    jitter = np.array([0, 3, -4, 2, 4, -3, 1, -2, 0]) * 1e-3
    irregular = np.array([0.0, 1.0, 2.5, 4.4, 5.7, 8.0, 9.3, 12.9, 14.0])
    tilt = (0.0, np.tan(np.radians(18.0)))
    found = [
        geometry("axial", *axial, even),
        geometry("coronal", (1, 0, 0), (0, 0, -1), even),
        geometry("sagittal", (0, 1, 0), (0, 0, -1), even),
        geometry("oblique", *_turned((20.0, -15.0, 30.0)), even),
        geometry("descending", *axial, even[::-1]),
        geometry("non-square", *axial, even, spacing=(0.5, 1.1)),
        geometry("jittered", *axial, even + jitter),
        geometry("tilt, even steps", *axial, even, shear=tilt),
        geometry("two slices missing", *axial, np.delete(np.arange(11) * 1.5, [3, 7])),
        geometry("irregular steps", *axial, irregular),
        geometry("irregular and tilt", *axial, irregular, shear=tilt),
    ]
    return {one.name: one for one in found}


@dataclass(frozen=True)
class Encoding:
    """How values are stored. ``slopes``, ``intercepts``: of each slice, repeated; ``low_bits``: HighBit + 1 -
    BitsStored; ``junk``: set the bits that are not used."""

    syntax: str = ExplicitVRLittleEndian
    allocated: int = 16
    stored: int = 16
    signed: bool = False
    slopes: tuple = (1.0,)
    intercepts: tuple = (0.0,)
    low_bits: int = 0
    junk: bool = False
    photometric: str = "MONOCHROME2"
    float_voxels: bool = False

    def words(self, values: np.ndarray, i: int) -> np.ndarray:
        """Allocated words of physical values."""
        if self.float_voxels:
            return values.astype(np.float32)
        stored = np.rint((values - self.intercepts[i % len(self.intercepts)]) / self.slopes[i % len(self.slopes)])
        low = -(1 << (self.stored - 1)) if self.signed else 0
        assert low <= stored.min() and stored.max() < low + (1 << self.stored), "the encoding cannot hold the phantom"
        words = (stored.astype(np.int64) & ((1 << self.stored) - 1)) << self.low_bits
        if self.junk:
            used = ((1 << self.stored) - 1) << self.low_bits
            noise = np.random.default_rng(i).integers(0, 1 << self.allocated, words.shape)
            words |= noise & ~used
        return words.astype(f"u{self.allocated // 8}")


PLAIN = Encoding()


def _common(encoding: Encoding, series: str, kind: str) -> Dataset:
    """A dataset with everything but position and voxels."""
    dataset = Dataset()
    dataset.SOPClassUID, dataset.SOPInstanceUID = kind, generate_uid()
    dataset.PatientName, dataset.PatientID, dataset.PatientBirthDate = PERSON, NUMBER, BIRTH
    dataset.StudyDate, dataset.AcquisitionDate, dataset.StudyTime = "20210304", "20210304", "101112"
    dataset.StudyID, dataset.PatientSex, dataset.AccessionNumber = "S-0815", "F", "ACC-77120"
    dataset.StudyInstanceUID, dataset.SeriesInstanceUID = f"{series[:60]}.1", series
    dataset.FrameOfReferenceUID = f"{series[:60]}.2"
    dataset.ReferringPhysicianName, dataset.InstitutionName = "ROE^RICHARD", "General Hospital"
    dataset.Modality, dataset.BodyPartExamined, dataset.SeriesNumber = "CT", "HEAD", 3
    dataset.SeriesDescription = f"{PERSON} thin"
    dataset.ImageType = ["ORIGINAL", "PRIMARY", "AXIAL"]
    dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 1, encoding.photometric
    dataset.Rows, dataset.Columns = ROWS, COLUMNS
    dataset.BitsAllocated = 32 if encoding.float_voxels else encoding.allocated
    if not encoding.float_voxels:
        dataset.BitsStored, dataset.HighBit = encoding.stored, encoding.stored - 1 + encoding.low_bits
        dataset.PixelRepresentation = int(encoding.signed)
    return dataset


def _fill(dataset: Dataset, words: np.ndarray, encoding: Encoding) -> None:
    """Set the voxels in the byte order of the transfer syntax, compressed if it is a compressed one."""
    data = words.astype(words.dtype.newbyteorder(">" if encoding.syntax == ExplicitVRBigEndian else "<")).tobytes()
    data += b"\0" * (len(data) % 2)
    dataset.file_meta = FileMetaDataset()
    native = encoding.syntax if encoding.syntax in NATIVE else ExplicitVRLittleEndian
    dataset.file_meta.TransferSyntaxUID = native
    if encoding.float_voxels:
        dataset.FloatPixelData = data
    else:
        if native == ExplicitVRBigEndian and words.dtype.itemsize == 1:
            data = np.frombuffer(data, np.uint16).byteswap().tobytes()  # words of two pixels
        dataset.PixelData = data
        dataset["PixelData"].VR = "OB" if words.dtype.itemsize == 1 and native != ExplicitVRBigEndian else "OW"
    if encoding.syntax in (RLELossless, JPEG2000Lossless):
        dataset.compress(encoding.syntax, generate_instance_uid=False)
    elif native != encoding.syntax:
        frames = words.reshape(-1, ROWS, COLUMNS)
        dataset.PixelData = encapsulate([_compressed(frame, encoding) for frame in frames])
        dataset["PixelData"].VR = "OB"
        dataset.file_meta.TransferSyntaxUID = encoding.syntax


def _compressed(frame: np.ndarray, encoding: Encoding) -> bytes:
    """Codestream of one frame."""
    syntax, bits = encoding.syntax, encoding.stored
    if syntax in (JPEGLosslessSV1, JPEGLossless):
        return lossless_jpeg.encode(frame, bits)
    if syntax == JPEG2000:
        import openjpeg

        return openjpeg.utils.encode_array(frame, bits_stored=bits, photometric_interpretation=2)
    if syntax == JPEGBaseline8Bit:
        from PIL import Image

        stream = io.BytesIO()
        Image.fromarray(frame).save(stream, "JPEG", quality=100)
        return stream.getvalue()
    import imagecodecs

    if syntax == JPEGExtended12Bit:
        return imagecodecs.jpeg8_encode(frame, level=100, bitspersample=bits)
    if syntax in (JPEGLSLossless, JPEGLSNearLossless):
        return imagecodecs.jpegls_encode(frame, level=0 if syntax == JPEGLSLossless else 1)
    if syntax == JPEG2000Lossless:
        return imagecodecs.jpeg2k_encode(frame, codecformat="J2K", bitspersample=bits, reversible=True, level=0)
    return imagecodecs.htj2k_encode(frame)


def save(dataset: Dataset, path: Path) -> Path:
    """Write a dataset, as Explicit VR Little Endian if it does not say."""
    if not hasattr(dataset, "file_meta"):
        dataset.file_meta = FileMetaDataset()
        dataset.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    dataset.save_as(path, enforce_file_format=True)
    return path


def read(path) -> Dataset:
    """A whole file, to be altered and saved."""
    return dcmread(path)


def write_classic(
    folder, where: Geometry, axis: int = 2, encoding: Encoding = PLAIN, series: str | None = None, change=None,
    first: int = 0,
) -> list[Path]:  # fmt: skip
    """Write one file a slice.

    Names are in no order. ``change(dataset, i)`` may alter each dataset before its voxels are set; ``first``: the
    number of the first file.
    """
    folder, series = Path(folder), series or generate_uid()
    folder.mkdir(parents=True, exist_ok=True)
    names = list(range(first, first + len(where.positions)))
    random.Random(7).shuffle(names)
    paths = []
    for i, position in enumerate(where.positions):
        dataset = _common(encoding, series, CT)
        dataset.InstanceNumber = i + 1
        dataset.ImagePositionPatient = [f"{value:.6f}" for value in position]
        dataset.ImageOrientationPatient = [f"{value:.10f}" for value in (*where.row, *where.column)]
        dataset.PixelSpacing = list(where.spacing)
        dataset.SliceThickness = 77.0  # nominal values that no reader may trust
        dataset.RescaleSlope = encoding.slopes[i % len(encoding.slopes)]
        dataset.RescaleIntercept = encoding.intercepts[i % len(encoding.intercepts)]
        if change is not None:
            change(dataset, i)
        _fill(dataset, encoding.words(where.values(i, axis), i), encoding)
        paths.append(save(dataset, folder / f"{names[i]:04}.dcm"))
    return paths


def write_enhanced(
    path, where: Geometry, axis: int = 2, encoding: Encoding = PLAIN, times: int = 1, change=None, shuffled: bool = True
) -> Path:
    """Write one multi-frame object whose frames are in no order, unless not ``shuffled``.

    With several ``times`` the values of time t are 100 t higher; ``change(dataset)`` may alter the dataset before its
    voxels are set.
    """
    dataset = _common(encoding, generate_uid(), ENHANCED_CT)
    order = [(i, time) for time in range(times) for i in range(len(where.positions))]
    if shuffled:
        random.Random(5).shuffle(order)
    shared = Dataset()
    shared.PlaneOrientationSequence = one(ImageOrientationPatient=[*where.row, *where.column])
    shared.PixelMeasuresSequence = one(PixelSpacing=list(where.spacing), SliceThickness=77.0)
    frames = []
    for i, time in order:
        frame = Dataset()
        frame.PlanePositionSequence = one(ImagePositionPatient=where.positions[i].round(6).tolist())
        frame.PixelValueTransformationSequence = one(
            RescaleSlope=encoding.slopes[i % len(encoding.slopes)],
            RescaleIntercept=encoding.intercepts[i % len(encoding.intercepts)], RescaleType="HU",
        )  # fmt: skip
        frame.FrameContentSequence = one(
            TemporalPositionIndex=time + 1, InStackPositionNumber=i + 1, StackID="1",
            FrameAcquisitionDateTime="20210304101112",
        )  # fmt: skip
        frames.append(frame)
    dataset.SharedFunctionalGroupsSequence = Sequence([shared])
    dataset.PerFrameFunctionalGroupsSequence = Sequence(frames)
    dataset.NumberOfFrames = len(frames)
    if change is not None:
        change(dataset)
    words = [encoding.words(where.values(i, axis) + 100.0 * time, i) for i, time in order]
    _fill(dataset, np.stack(words), encoding)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    return save(dataset, Path(path))


def one(**values) -> Sequence:
    """A sequence of one item."""
    item = Dataset()
    for name, value in values.items():
        setattr(item, name, value)
    return Sequence([item])


def worst_error(values: np.ndarray, affine, axis: int) -> float:
    """Largest error in mm of physical values (nz, ny, nx) against the coordinates that an affine to LPS gives them."""
    z, y, x = np.indices(values.shape)
    coordinate = np.tensordot(np.asarray(affine)[axis, :3], np.stack([x, y, z]), 1) + np.asarray(affine)[axis, 3]
    return float(np.abs((values - OFFSET) / SCALE - coordinate).max())


ENCODINGS = {
    "per-slice rescale": Encoding(slopes=(0.5, 0.25, 0.4), intercepts=(0.0, 100.0, -50.0)),
    "signed 12 in 16 with junk": Encoding(stored=12, signed=True, intercepts=(2000.0,), junk=True),
    "overlay bits": Encoding(stored=12, junk=True, intercepts=(200.0,)),
    "high bit 15": Encoding(stored=12, low_bits=4, junk=True, intercepts=(200.0,)),
    "32 bit": Encoding(allocated=32, stored=32, slopes=(0.001,)),
    "32 bit signed": Encoding(allocated=32, stored=32, signed=True, slopes=(0.001,), intercepts=(5000.0,)),
    "MONOCHROME1": Encoding(photometric="MONOCHROME1"),
    "float": Encoding(float_voxels=True),
    # for the y coordinate of axial slices
    "8 bit": Encoding(allocated=8, stored=8, slopes=(1.0,), intercepts=(2020.0,)),
    "8 bit signed": Encoding(allocated=8, stored=8, signed=True, slopes=(1.0,), intercepts=(2148.0,)),
}


# JPEG keeps 8 and 12 bits, and a level of error; steps are as small as its range allows, 0.065 and 0.01 mm.
LOSSY = {
    JPEGBaseline8Bit: Encoding(allocated=8, stored=8, slopes=(0.65,), intercepts=(2040.0,)),
    JPEGExtended12Bit: Encoding(stored=12, slopes=(0.1,), intercepts=(2000.0,)),
}


def with_syntax(encoding: Encoding, syntax: str) -> Encoding:
    """The same encoding in another transfer syntax."""
    return replace(encoding, syntax=syntax)
