"""Files that are no volume, one for each kind of bad input that medical files have, and words of its sentence."""

import gzip
import os
from pathlib import Path

import nibabel
import numpy as np
from pydicom.dataset import Dataset
from pydicom.encaps import encapsulate
from pydicom.uid import MPEG2MPML, JPEG2000Lossless, generate_uid

from . import dicom_phantoms as phantoms
from .test_dicom_segmentation import truth, write_seg

AXIAL = phantoms.geometries()["axial"]


def series(folder: Path, where=AXIAL, encoding=phantoms.PLAIN, **values) -> Path:
    """A DICOM series whose datasets have other values; an element of the value None is left out."""

    def change(dataset, i):
        for name, value in values.items():
            if value is None:
                delattr(dataset, name)
            else:
                setattr(dataset, name, value)

    phantoms.write_classic(folder, where, encoding=encoding, change=change)
    return folder


def compressed(folder: Path) -> Path:
    """One file of a series in JPEG 2000."""
    encoding = phantoms.with_syntax(phantoms.PLAIN, JPEG2000Lossless)
    return phantoms.write_classic(folder, phantoms.geometries()["oblique"], 1, encoding)[2]


def damaged_frame(folder: Path) -> Path:
    path = compressed(folder)
    data = bytearray(path.read_bytes())
    data[-400:-200] = bytes(200)
    path.write_bytes(data)
    return folder


def color_frame(folder: Path) -> Path:
    """A codestream of three components under a header of one."""
    from openjpeg.utils import encode_array

    path = compressed(folder)
    color = encode_array(np.zeros((phantoms.ROWS, phantoms.COLUMNS, 3), np.uint8), photometric_interpretation=1)
    dataset = phantoms.read(path)
    dataset.PixelData = encapsulate([color])
    dataset.save_as(path)
    return folder


def notes(folder: Path) -> Path:
    folder.mkdir()
    (folder / "notes.txt").write_text("no image")
    return folder


def two_series(folder: Path) -> Path:
    for name in "ab":
        series(folder / name)
    return folder


def at_one_place(folder: Path) -> Path:
    """The same slices twice with other values, and nothing that tells them apart."""
    uid = generate_uid()
    phantoms.write_classic(folder, AXIAL, 0, series=uid)
    phantoms.write_classic(folder, AXIAL, 1, series=uid, first=100)
    return folder


def shortened(folder: Path) -> Path:
    path = sorted(series(folder).iterdir())[3]
    path.write_bytes(path.read_bytes()[:-640])
    return folder


def video(folder: Path) -> Path:
    path = phantoms.write_enhanced(folder / "a.dcm", AXIAL)
    dataset = phantoms.read(path)
    dataset.file_meta.TransferSyntaxUID = MPEG2MPML
    dataset.PixelData = encapsulate([b"not decoded"])
    dataset.save_as(path)
    return path


def other_object(folder: Path, modality: str, kind: str) -> Path:
    folder.mkdir()
    dataset = Dataset()
    dataset.SOPClassUID, dataset.SOPInstanceUID, dataset.Modality = kind, generate_uid(), modality
    dataset.PatientName = phantoms.PERSON
    return phantoms.save(dataset, folder / "a.dcm")


def segmentation(folder: Path) -> Path:
    write_seg(folder / "a.dcm", AXIAL, truth(AXIAL, 3))
    return folder


def nifti(folder: Path, dtype=np.int16, suffix=".nii", name="a") -> Path:
    folder.mkdir()
    path = folder / f"{name}{suffix}"
    nibabel.save(nibabel.Nifti1Image(np.zeros((9, 7, 5), dtype), np.eye(4), dtype=dtype), path)
    return path


def cut_nifti(folder: Path) -> Path:
    path = nifti(folder)
    path.write_bytes(path.read_bytes()[:-100])
    return path


def cut_gzip(folder: Path) -> Path:
    path = nifti(folder)
    packed = folder / "b.nii.gz"
    packed.write_bytes(gzip.compress(path.read_bytes(), 0)[:-60])
    return packed


def header(folder: Path, at: int, data: bytes) -> Path:
    """A NIfTI file with other bytes at a place of its header."""
    path = nifti(folder)
    content = bytearray(path.read_bytes())
    content[at : at + len(data)] = data
    path.write_bytes(content)
    return path


def without_partner(folder: Path) -> Path:
    path = folder / "a.hdr"
    folder.mkdir()
    nibabel.save(nibabel.Nifti1Pair(np.zeros((9, 7, 5), np.int16), np.eye(4)), path)
    os.remove(folder / "a.img")
    return path


def without_raw(folder: Path) -> Path:
    folder.mkdir()
    lines = "ObjectType = Image", "NDims = 3", "DimSize = 4 4 4", "ElementType = MET_CHAR", "ElementDataFile = a.raw"
    (folder / "a.mhd").write_text("\n".join(lines) + "\n")
    return folder / "a.mhd"


COLORS = np.dtype([("R", "u1"), ("G", "u1"), ("B", "u1")])
# Each: a function that writes it into a new folder and returns the path to read, and words of the sentence.
BAD = {
    "a folder without images": (notes, "holds no medical images, only 1 other file; choose the folder of the series."),
    "several series": (two_series, "There are 2 series"),
    "one slice": (
        lambda folder: series(folder, phantoms.geometry("one", (1, 0, 0), (0, 1, 0), [0.0])),
        "This series is a single picture; a volume needs at least two slices.",
    ),
    "no positions": (lambda folder: series(folder, ImagePositionPatient=None), "give the spacing"),
    "slices at one place": (at_one_place, "nothing in its files tells them apart"),
    "shorter than stated": (shortened, "bytes of voxels are there; copy it again."),
    "a video": (video, "is a video"),
    "a damaged frame": (damaged_frame, "is damaged and cannot be decoded; copy the file again."),
    "a color picture": (
        lambda folder: series(folder, SamplesPerPixel=3, PhotometricInterpretation="RGB"), "is a color picture",
    ),
    "a palette": (lambda folder: series(folder, PhotometricInterpretation="PALETTE COLOR"), "is a color picture"),
    "a color frame under a gray header": (color_frame, "color"),
    "a mosaic": (
        lambda folder: series(folder, ImageType=["ORIGINAL", "PRIMARY", "M", "MOSAIC"]), "convert it with dcm2niix",
    ),
    "a report": (lambda folder: other_object(folder, "SR", "1.2.840.10008.5.1.4.1.1.88.11"), "a report, a plan"),
    "a plan": (lambda folder: other_object(folder, "RTPLAN", "1.2.840.10008.5.1.4.1.1.481.5"), "a report, a plan"),
    "a waveform": (lambda folder: other_object(folder, "ECG", "1.2.840.10008.5.1.4.1.1.9.1.1"), "a waveform"),
    "contours": (lambda folder: other_object(folder, "RTSTRUCT", "1.2.840.10008.5.1.4.1.1.481.3"), "contours"),
    "a segmentation alone": (segmentation, "is a segmentation, no image"),
    "singular directions": (
        lambda folder: series(folder, ImageOrientationPatient=[0, 1, 0, 0, 1, 0]), "perpendicular",
    ),
    "a singular NIfTI": (lambda folder: header(folder, 280, bytes(48)), "singular"),
    "complex numbers": (lambda folder: nifti(folder, np.complex64), "complex numbers"),
    "a NIfTI of colors": (lambda folder: nifti(folder, COLORS), "are colors"),
    "128-bit numbers": (lambda folder: header(folder, 70, np.array((1536, 128), "<i2").tobytes()), "128"),
    ".hdr without .img": (without_partner, "needs a.img beside it"),
    ".mhd without .raw": (without_raw, "a.raw"),
    "an impossible header": (lambda folder: header(folder, 40, np.array((9, -5), "<i2").tobytes()), "is damaged"),
    "a header too large": (lambda folder: header(folder, 42, np.array((32767,) * 3, "<i2").tobytes()), "breaks off"),
    "a DICOM file too large": (lambda folder: series(folder, Rows=60000, Columns=60000), "breaks off"),
    "a NIfTI cut short": (cut_nifti, "breaks off: 530 of 630 bytes of voxels are there; copy it again"),
    "a gzip cut short": (cut_gzip, "b.nii.gz breaks off"),
}  # fmt: skip
