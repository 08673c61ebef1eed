"""DICOM SEG: names, colors and voxels of segments, each where its frames say."""

import random
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pydicom")

from pydicom.dataset import Dataset
from pydicom.sequence import Sequence
from pydicom.uid import generate_uid

from rle_splat.read.dicom import segmentation
from rle_splat.read.formats import read_volume
from rle_splat.scene import RleSplatError
from rle_splat.volume.volume import PATIENT

from . import dicom_phantoms as phantoms

SEG, LABEL_MAP = "1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7"
GEOMETRIES = phantoms.geometries()
RED, GREEN = (54.2917, 80.8125, 69.8851), (87.8181, -79.2873, 80.9902)  # L*a*b* under D50 (Lindbloom's tables)


def truth(where, count: int) -> np.ndarray:
    """(count, slices, rows, columns) bool: boxes that each leave some slices empty; the last two overlap."""
    found = np.zeros((count, len(where.positions), phantoms.ROWS, phantoms.COLUMNS), dtype=bool)
    found[0, 1:3, 3:11, 2:9] = True
    found[1, 4:, 10:20, 5:13] = True
    found[2, 5:7, 15:25, 9:30] = True
    return found


def write_seg(path: Path, where, masks: np.ndarray, kind: str = "BINARY") -> Path:
    """Write a segmentation whose empty frames are left out."""
    dataset = Dataset()
    dataset.SOPClassUID, dataset.SOPInstanceUID = LABEL_MAP if kind == "LABELMAP" else SEG, generate_uid()
    dataset.PatientName, dataset.PatientID = phantoms.PERSON, phantoms.NUMBER
    dataset.SeriesInstanceUID, dataset.Modality, dataset.SegmentationType = generate_uid(), "SEG", kind
    dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 1, "MONOCHROME2"
    dataset.Rows, dataset.Columns = phantoms.ROWS, phantoms.COLUMNS
    bits = 1 if kind == "BINARY" else 8
    dataset.BitsAllocated, dataset.BitsStored, dataset.HighBit, dataset.PixelRepresentation = bits, bits, bits - 1, 0
    dataset.MaximumFractionalValue = 200
    shared = Dataset()
    shared.PlaneOrientationSequence = phantoms.one(ImageOrientationPatient=[*where.row, *where.column])
    shared.PixelMeasuresSequence = phantoms.one(PixelSpacing=list(where.spacing), SliceThickness=2.5)
    dataset.SharedFunctionalGroupsSequence = Sequence([shared])
    dataset.SegmentSequence = Sequence([segment(number) for number in range(1, len(masks) + 1)])
    frames, planes = [], []
    for number, mask in enumerate(masks, 1):
        for i, plane in enumerate(mask):
            if plane.any() and kind != "LABELMAP":
                frames.append(frame_of(where, i, number))
                planes.append(plane.astype(np.uint8))
    if kind == "LABELMAP":
        numbers = np.arange(1, len(masks) + 1, dtype=np.uint8)[:, None, None, None]
        planes = list(np.max(masks * numbers, axis=0))
        frames = [frame_of(where, i, None) for i in range(len(planes))]
    dataset.PerFrameFunctionalGroupsSequence, dataset.NumberOfFrames = Sequence(frames), len(frames)
    stored = np.stack(planes)
    if kind == "BINARY":
        data = np.packbits(stored.reshape(-1), bitorder="little").tobytes()
    else:
        data = (stored * (150 if kind == "FRACTIONAL" else 1)).astype(np.uint8).tobytes()
    dataset.PixelData = data + b"\0" * (len(data) % 2)
    dataset["PixelData"].VR = "OB"
    path.parent.mkdir(parents=True, exist_ok=True)
    return phantoms.save(dataset, path)


def segment(number: int) -> Dataset:
    found = Dataset()
    found.SegmentNumber, found.SegmentLabel = number, f"organ {number}"
    lightness, a, b = RED if number == 1 else GREEN
    scaled = (lightness / 100.0, (a + 128.0) / 255.0, (b + 128.0) / 255.0)
    found.RecommendedDisplayCIELabValue = [round(65535 * part) for part in scaled]
    return found


def frame_of(where, i: int, number) -> Dataset:
    found = Dataset()
    found.PlanePositionSequence = phantoms.one(ImagePositionPatient=where.positions[i].round(6).tolist())
    if number is not None:
        found.SegmentIdentificationSequence = phantoms.one(ReferencedSegmentNumber=number)
    return found


def indices(volume, where) -> np.ndarray:
    """Slice of the label map at the position of each slice of a geometry; -1 where it has none."""
    inverse = np.linalg.inv(volume.affine)
    found = [(inverse @ (*position, 1.0))[:3] for position in where.positions]
    for x, y, _ in found:
        assert abs(x) < 1e-3 and abs(y) < 1e-3
    near = np.array([round(z) if abs(z - round(z)) < 0.01 else -1 for _, _, z in found])
    return np.where((near >= 0) & (near < volume.voxels.shape[0]), near, -1)


@pytest.mark.parametrize("kind", ["BINARY", "FRACTIONAL", "LABELMAP"])
@pytest.mark.parametrize("name", ["axial", "oblique", "descending", "tilt, even steps"])
def test_segments_lie_where_they_were_drawn(tmp_path: Path, kind: str, name: str):
    where = GEOMETRIES[name]
    masks = truth(where, 3)
    volume = read_volume(write_seg(tmp_path / "seg.dcm", where, masks, kind))
    assert volume.space == PATIENT and volume.voxels.dtype == np.uint8
    wanted = np.zeros(masks.shape[1:], np.uint8)
    for number, mask in enumerate(masks, 1):
        wanted[mask] = number
    at = indices(volume, where)
    for i, k in enumerate(at):
        assert k >= 0 or not wanted[i].any()
        if k >= 0:
            np.testing.assert_array_equal(volume.voxels[k], wanted[i])
    used = set(at.tolist())
    assert not any(volume.voxels[k].any() for k in range(len(volume.voxels)) if k not in used)
    overlap = int(np.count_nonzero(masks.sum(axis=0) > 1))
    assert any(f"overlap in {overlap} voxels" in remark for remark in volume.remarks) == (kind != "LABELMAP")


@pytest.mark.parametrize("kind", ["BINARY", "FRACTIONAL"])
def test_overlaps_do_not_depend_on_the_order_of_decoding(tmp_path: Path, kind: str, monkeypatch):
    """Child processes decode compressed frames, which come in any order."""
    path = write_seg(tmp_path / "seg.dcm", GEOMETRIES["axial"], truth(GEOMETRIES["axial"], 3), kind)
    volumes = [read_volume(path)]
    planes = segmentation.decode_planes
    for seed in range(3):
        monkeypatch.setattr(segmentation, "decode_planes", lambda pictures, seed=seed: shuffled(planes(pictures), seed))
        volumes.append(read_volume(path))
        np.testing.assert_array_equal(volumes[-1].voxels, volumes[0].voxels)
        assert volumes[-1].remarks == volumes[0].remarks
    assert "which show the segment with the highest number" in volumes[0].remarks[0]


def shuffled(answers, seed: int) -> list:
    found = list(answers)
    random.Random(seed).shuffle(found)
    return found


def test_frames_whose_numbers_jitter_lie_in_one_direction(tmp_path: Path):
    path = write_seg(tmp_path / "seg.dcm", GEOMETRIES["axial"], truth(GEOMETRIES["axial"], 3))
    before = read_volume(path)
    dataset = phantoms.read(path)
    for i, frame in enumerate(dataset.PerFrameFunctionalGroupsSequence):
        frame.PlaneOrientationSequence = phantoms.one(ImageOrientationPatient=[1, 2e-6 * (i % 2), 0, 0, 1, 0])
        frame.PlanePositionSequence[0].ImagePositionPatient[2] += 1e-3 * (i % 2)
    after = read_volume(phantoms.save(dataset, path))
    np.testing.assert_array_equal(after.voxels, before.voxels)
    np.testing.assert_allclose(after.affine, before.affine, atol=2e-3)


def test_segments_at_irregular_distances_are_told(tmp_path: Path):
    where = GEOMETRIES["irregular steps"]
    masks = np.ones((1, len(where.positions), phantoms.ROWS, phantoms.COLUMNS), dtype=bool)
    volume = read_volume(write_seg(tmp_path / "seg.dcm", where, masks))
    assert volume.voxels.all() and volume.remarks == (
        "The segments' slices lie at irregular distances; each slice of the label map shows the nearest one.",
    )


def test_names_and_colors(tmp_path: Path):
    volume = read_volume(write_seg(tmp_path / "seg.dcm", GEOMETRIES["axial"], truth(GEOMETRIES["axial"], 3)))
    assert [(one.label, one.name) for one in volume.named_labels] == [(1, "organ 1"), (2, "organ 2"), (3, "organ 3")]
    np.testing.assert_allclose(volume.named_labels[0].color, (1.0, 0.0, 0.0), atol=2e-3)
    np.testing.assert_allclose(volume.named_labels[1].color, (0.0, 1.0, 0.0), atol=2e-3)


def test_options_that_would_be_lost(tmp_path: Path):
    path = write_seg(tmp_path / "seg.dcm", GEOMETRIES["axial"], truth(GEOMETRIES["axial"], 3))
    with pytest.raises(RleSplatError, match="leave out"):
        read_volume(path, frame=2)


def test_a_segment_on_one_slice(tmp_path: Path):
    masks = np.zeros((1, len(GEOMETRIES["axial"].positions), phantoms.ROWS, phantoms.COLUMNS), dtype=bool)
    masks[0, 4, 2:5, 2:5] = True
    volume = read_volume(write_seg(tmp_path / "seg.dcm", GEOMETRIES["axial"], masks))
    assert np.count_nonzero(volume.voxels) == 9 and volume.spacing[2] == pytest.approx(2.5)


def test_beside_its_series_it_is_no_image(tmp_path: Path):
    where = GEOMETRIES["axial"]
    path = write_seg(tmp_path / "alone" / "seg.dcm", where, truth(where, 3))
    with pytest.raises(RleSplatError, match="is a segmentation"):
        read_volume(path.parent)
    phantoms.write_classic(tmp_path / "both", where)
    path.rename(tmp_path / "both" / "seg.dcm")
    volume = read_volume(tmp_path / "both")
    assert phantoms.worst_error(volume.voxels, volume.affine, 2) <= 0.05 + 1e-6
    labels = read_volume(tmp_path / "both" / "seg.dcm")
    np.testing.assert_allclose(labels.affine[:3, :3], volume.affine[:3, :3], atol=1e-9)


@pytest.mark.extras
@pytest.mark.parametrize("kind", ["BINARY", "FRACTIONAL", "LABELMAP"])
def test_a_segmentation_of_another_writer(tmp_path: Path, kind: str):
    """highdicom writes it, with its own order of frames and of the source's slices."""
    highdicom = pytest.importorskip("highdicom")
    from pydicom.sr.codedict import codes

    where = GEOMETRIES["oblique"]
    paths = phantoms.write_classic(tmp_path / "ct", where)
    masks = truth(where, 3)
    masks[2] &= ~masks[1]  # neither a label map nor highdicom's own map of numbers has overlaps
    algorithm = highdicom.AlgorithmIdentificationSequence("test", codes.DCM.ArtificialIntelligence, "1")
    described = [
        highdicom.seg.SegmentDescription(
            number, f"organ {number}", codes.SCT.Organ, codes.SCT.Liver, "AUTOMATIC", algorithm
        )
        for number in (1, 2, 3)
    ]
    numbers = np.max(masks * np.arange(1, 4, dtype=np.uint8)[:, None, None, None], axis=0)
    array = numbers if kind == "LABELMAP" else np.moveaxis(masks, 0, -1).astype(np.uint8)
    written = highdicom.seg.Segmentation(
        [phantoms.read(path) for path in paths], array if kind != "FRACTIONAL" else array.astype(np.float32), kind,
        described, generate_uid(), 1, generate_uid(), 1, "maker", "model", "1", "serial",
    )  # fmt: skip
    written.save_as(tmp_path / "seg.dcm")
    volume = read_volume(tmp_path / "seg.dcm")
    assert [(one.label, one.name) for one in volume.named_labels][-3:] == [(n, f"organ {n}") for n in (1, 2, 3)]
    at = indices(volume, where)
    for i, k in enumerate(at):
        if k >= 0:
            np.testing.assert_array_equal(volume.voxels[k], numbers[i])
        else:
            assert not numbers[i].any()
    assert np.count_nonzero(volume.voxels) == np.count_nonzero(numbers)
