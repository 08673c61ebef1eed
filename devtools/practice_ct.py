"""dev.py practice: a CT head as a DICOM folder, for the tutorial; generated, so that there is no patient in it.

Runs in an environment with numpy and pydicom.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from pydicom import Dataset
from pydicom.dataset import FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian

from .phantom import EXTENT_MM, SPACING_MM, head_phantom

ROOT_UID = "2.25.4711"  # a root that anybody may use
INTERCEPT = -1024  # stored values are unsigned, as of most scanners


def write_series(folder: Path, spacing_mm: float = SPACING_MM) -> int:
    """Write the phantom as a DICOM series; returns the number of slices.

    DICOM's axes are the patient's left, back and head, and the phantom's are right, front and head.
    """
    voxels = head_phantom(spacing_mm)[:, ::-1, ::-1]
    ends = [-(low + spacing_mm * (count - 1)) for (low, _), count in zip(EXTENT_MM[:2], voxels.shape[:0:-1])]
    folder.mkdir(parents=True, exist_ok=True)
    for number, plane in enumerate(voxels):
        place = (*ends, EXTENT_MM[2][0] + number * spacing_mm)
        file = folder / f"slice_{number + 1:03d}.dcm"
        _slice(plane, number, place, spacing_mm).save_as(file, enforce_file_format=True)
    return len(voxels)


def _slice(plane: np.ndarray, number: int, place, spacing_mm: float) -> Dataset:
    one = Dataset()
    one.file_meta = FileMetaDataset()
    one.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    one.SOPClassUID, one.SOPInstanceUID = CTImageStorage, f"{ROOT_UID}.3.{number + 1}"
    one.StudyInstanceUID, one.SeriesInstanceUID = f"{ROOT_UID}.1", f"{ROOT_UID}.2"
    one.FrameOfReferenceUID = f"{ROOT_UID}.4"
    one.PatientName, one.PatientID = "Phantom^Head", "PHANTOM"
    one.Modality, one.SeriesDescription, one.BodyPartExamined = "CT", "Head phantom", "HEAD"
    one.SeriesNumber, one.InstanceNumber = 1, number + 1
    one.ImagePositionPatient = [f"{value:.4f}" for value in place]
    one.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
    one.PixelSpacing, one.SliceThickness = [spacing_mm, spacing_mm], spacing_mm
    one.RescaleSlope, one.RescaleIntercept, one.RescaleType = 1, INTERCEPT, "HU"
    one.WindowCenter, one.WindowWidth = 500, 2000
    one.Rows, one.Columns = plane.shape
    one.SamplesPerPixel, one.PhotometricInterpretation = 1, "MONOCHROME2"
    one.BitsAllocated, one.BitsStored, one.HighBit, one.PixelRepresentation = 16, 16, 15, 0
    one.PixelData = (plane.astype(np.int32) - INTERCEPT).astype("<u2").tobytes()
    return one


if __name__ == "__main__":
    print(write_series(Path(sys.argv[1])))
