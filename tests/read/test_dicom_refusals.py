"""Pictures that make no volume, beside those of ``bad_files.BAD``: each gets one sentence, which names no
patient."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pydicom")

from pydicom.dataset import Dataset
from pydicom.encaps import encapsulate
from pydicom.uid import generate_uid

from rle_splat.read.dicom import discovery
from rle_splat.read.formats import read_volume

from . import dicom_phantoms as phantoms
from .test_dicom_series import AXIAL, GEOMETRIES, SLICES, refusal


class TestBadInput:
    def test_too_many_files(self, tmp_path: Path, monkeypatch):
        phantoms.write_classic(tmp_path, AXIAL)
        monkeypatch.setattr(discovery, "MOST_FILES", 2)
        assert refusal(tmp_path).endswith("holds more than 2 files; choose the folder of one study or series.")
        said = refusal(sorted(tmp_path.iterdir())[0])
        assert said.endswith("holds more than 2 files; copy those of the series into a folder of their own.")

    def test_no_positions(self, tmp_path: Path):
        def change(dataset, i):
            del dataset.ImagePositionPatient

        phantoms.write_classic(tmp_path, AXIAL, change=change)
        assert "give the spacing" in refusal(tmp_path)
        volume = read_volume(tmp_path, spacing=(0.6, 0.6, 1.5))
        assert volume.space is None and volume.voxels.shape == (SLICES, phantoms.ROWS, phantoms.COLUMNS)
        differences = np.diff(volume.voxels.astype(int), axis=0)
        assert np.all(differences == 15)  # in the order of their numbers

    def test_spacing_that_would_be_lost(self, tmp_path: Path):
        phantoms.write_classic(tmp_path, AXIAL)
        assert "leave out the spacing" in refusal(tmp_path, spacing=(1, 1, 1))

    def test_slices_on_a_curve(self, tmp_path: Path):
        bent = phantoms.geometry("bent", (1, 0, 0), (0, 1, 0), np.arange(9) * 1.5)
        bent.positions[:, 1] += 0.2 * (np.arange(9) - 4.0) ** 2
        phantoms.write_classic(tmp_path, bent)
        assert "straight line" in refusal(tmp_path)

    @pytest.mark.parametrize("row", [(0, 0, 0), (1, 1, 0)])
    def test_singular_directions(self, tmp_path: Path, row):
        def change(dataset, i):
            dataset.ImageOrientationPatient = [*row, 0, 1, 0]

        phantoms.write_classic(tmp_path, AXIAL, change=change)
        assert "perpendicular" in refusal(tmp_path)

    def test_slices_in_one_plane(self, tmp_path: Path):
        flat = phantoms.geometry("flat", (1, 0, 0), (0, 1, 0), np.arange(9) * 1.5)
        flat.positions[:, 0] = np.arange(9)
        flat.positions[:, 2] = 5.0
        phantoms.write_classic(tmp_path, flat)
        assert "one plane" in refusal(tmp_path)

    @pytest.mark.parametrize("length", [100, 640])
    @pytest.mark.parametrize("syntax", [phantoms.NATIVE[1], phantoms.RLELossless, phantoms.JPEG2000Lossless])
    def test_a_file_that_breaks_off(self, tmp_path: Path, length: int, syntax: str):
        encoding = phantoms.with_syntax(phantoms.PLAIN, syntax)
        paths = phantoms.write_classic(tmp_path, GEOMETRIES["oblique"], encoding=encoding)
        paths[3].write_bytes(paths[3].read_bytes()[:-length])
        text = refusal(tmp_path)
        assert paths[3].name in text and ("breaks off" in text or "damaged" in text)

    @pytest.mark.parametrize("content", [b"", bytes(5000)])
    @pytest.mark.parametrize("slice_", [3, SLICES - 1])
    def test_a_file_whose_begin_is_lost(self, tmp_path: Path, content: bytes, slice_: int):
        """Its name says that it may be a slice: no gap is filled for it, and it is named."""
        paths = phantoms.write_classic(tmp_path, AXIAL)
        paths[slice_].write_bytes(content)
        (tmp_path / "._0001.dcm").write_bytes(b"of macOS")
        for path in (tmp_path, paths[0]):
            if slice_ == 3:
                assert refusal(path) == f"{paths[3].name} is damaged and cannot be read; copy it again."
            else:
                assert read_volume(path).remarks == (f"1 damaged DICOM file was left out: {paths[-1].name}.",)

    @pytest.mark.parametrize(
        ("changes", "word"),
        [
            ({"BitsAllocated": 12}, "damaged"),
            ({"Rows": 0}, "damaged"),
            ({"BitsStored": 40}, "damaged"),
            ({"NumberOfFrames": 2**31 - 1}, "damaged"),
        ],
    )
    def test_other_pictures(self, tmp_path: Path, changes, word: str):
        def change(dataset, i):
            for name, value in changes.items():
                setattr(dataset, name, value)

        phantoms.write_classic(tmp_path, AXIAL, change=change)
        assert word in refusal(tmp_path)

    def test_a_color_frame_in_gray_clothes(self, tmp_path: Path):
        """A codestream of three components under a header of one is refused before a decoder sees it."""
        from openjpeg.utils import encode_array

        encoding = phantoms.with_syntax(phantoms.PLAIN, phantoms.JPEG2000Lossless)
        paths = phantoms.write_classic(tmp_path, AXIAL, encoding=encoding)
        color = encode_array(np.zeros((phantoms.ROWS, phantoms.COLUMNS, 3), np.uint8), photometric_interpretation=1)
        small = encode_array(np.zeros((32, 32), np.uint16))
        for data, word in ((color, "color"), (small, "32 x 32")):
            dataset = phantoms.read(paths[2])
            dataset.PixelData = encapsulate([data])
            dataset.save_as(paths[2])
            assert word in refusal(tmp_path)

    @pytest.mark.parametrize(
        ("modality", "kind", "word"),
        [
            ("RTSTRUCT", "1.2.840.10008.5.1.4.1.1.481.3", "contours"),
            ("SR", "1.2.840.10008.5.1.4.1.1.88.11", "report"),
            ("ECG", "1.2.840.10008.5.1.4.1.1.9.1.1", "waveform"),
        ],
    )
    def test_other_objects(self, tmp_path: Path, modality: str, kind: str, word: str):
        dataset = Dataset()
        dataset.SOPClassUID, dataset.SOPInstanceUID, dataset.Modality = kind, generate_uid(), modality
        dataset.PatientName = phantoms.PERSON
        phantoms.save(dataset, tmp_path / "a.dcm")
        assert word in refusal(tmp_path) and word in refusal(tmp_path / "a.dcm")
