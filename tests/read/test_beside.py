"""Segmentations beside a scan: which files are taken as those of which scan."""

import numpy as np
import pytest

from rle_splat.read.beside import find_segmentations_steps
from rle_splat.runtime.steps import drain

nibabel = pytest.importorskip("nibabel")


def names_beside(path, series: str = "") -> list[str]:
    return [one.name for one in drain(find_segmentations_steps(path, series))]


def add_nifti(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        if name.endswith(".txt"):
            (folder / name).write_text("")
            continue
        nibabel.save(nibabel.Nifti1Image(np.zeros((3, 3, 3), np.uint8), np.eye(4)), folder / name)


@pytest.mark.parametrize("scan, others, found", [
    ("ct.nii.gz", ("ct_seg.nii.gz",), ["ct_seg.nii.gz"]),
    ("ct.nii.gz", ("ct.seg.nii.gz", "other.nii.gz"), ["ct.seg.nii.gz"]),  # as 3D Slicer names it
    ("ct.nii.gz", ("segmentations/liver.nii.gz", "segmentations/spleen.nii.gz"), ["segmentations"]),
    ("ct.nii.gz", ("segmentations/notes.nii.gz",), []),  # one file is no folder of masks
    ("heart.nii.gz", ("labels_of_lumen.nii.gz", "mask_trunk.nii.gz"), ["labels_of_lumen.nii.gz"]),
    ("case1.nii.gz", ("case1_seg.nii.gz", "case2.nii.gz"), ["case1_seg.nii.gz"]),
    ("case2.nii.gz", ("case1_seg.nii.gz", "case1.nii.gz"), []),
    ("case2.nii.gz", ("labels.nii.gz", "case1.nii.gz"), []),  # of which of both is not known
    ("ct_seg.nii.gz", ("ct.nii.gz", "ct_label.nii.gz"), []),  # a map of labels has none
    ("ct.nii.gz", ("segway.nii.gz", "seg.txt", ".ct_seg.nii.gz"), []),
    ("sub-01_T1w.nii.gz", ("sub-01_T2w.nii.gz", "sub-01_dseg.nii.gz", "sub-01_T1w_dseg.nii.gz"),
     ["sub-01_T1w_dseg.nii.gz"]),
])  # fmt: skip
def test_names(scan, others, found, tmp_path):
    add_nifti(tmp_path, scan, *others)
    assert names_beside(tmp_path / scan) == found


def test_dicom_segments_and_contours_are_found_by_their_content(tmp_path):
    """In the folder of the series, in folders below it, and in the one above, if they refer to the series."""
    pytest.importorskip("pydicom")
    from pydicom.dataset import Dataset

    from rle_splat.read.dicom.pictures import hash_text

    from . import dicom_phantoms as phantoms

    series = {"ct": "1.2.840.99.1", "pet": "1.2.840.99.2"}

    def save(name, kind, of):
        dataset = Dataset()
        dataset.SOPClassUID, dataset.SOPInstanceUID = kind, "1.2.840.99.7"
        dataset.ReferencedSeriesSequence = phantoms.one(SeriesInstanceUID=series[of])
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        phantoms.save(dataset, tmp_path / name)

    def found(path, of):
        return names_beside(tmp_path / path, hash_text(series[of]))

    images, segments = "1.2.840.10008.5.1.4.1.1.2", "1.2.840.10008.5.1.4.1.1.66.4"
    for name in ("study/ct/1", "study/ct/2.dcm", "study/pet/1.dcm"):
        save(name, images, "ct")
    assert found("study", "ct") == []
    save("study/ct/segments", segments, "ct")
    save("study/contours.dcm", "1.2.840.10008.5.1.4.1.1.481.3", "ct")
    save("study/tumors.dcm", segments, "pet")
    save("dose.dcm", "1.2.840.10008.5.1.4.1.1.481.2", "ct")
    assert found("study", "ct") == ["contours.dcm", "segments"]
    assert found("study/ct/2.dcm", "ct") == ["contours.dcm", "segments"]
    assert found("study/pet", "pet") == found("study", "pet") == ["tumors.dcm"]
