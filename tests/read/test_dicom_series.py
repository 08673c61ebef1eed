"""Which pictures belong together: series, frames in time, copies, localizers, and the sentences that refuse."""

import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pydicom")

from pydicom.fileset import FileSet
from pydicom.uid import generate_uid

from rle_splat.read.channels import read_channel_steps
from rle_splat.read.dicom import discovery
from rle_splat.read.dicom.discovery import find_pictures
from rle_splat.read.dicom.reader import groups_in
from rle_splat.read.dicom.titles import series_info, thumbnail
from rle_splat.read.formats import format_of, list_series, read_volume, write_volume
from rle_splat.runtime.steps import drain
from rle_splat.scene import RleSplatError
from rle_splat.volume.volume import PATIENT, Volume

from . import dicom_phantoms as phantoms

GEOMETRIES = phantoms.geometries()
AXIAL = GEOMETRIES["axial"]
SLICES = len(AXIAL.positions)


def error_of(volume, axis: int = 2, more: float = 0.0) -> float:
    return phantoms.worst_error(volume.physical(volume.voxels) - more, volume.affine, axis)


def refusal(path, **options) -> str:
    with pytest.raises(RleSplatError) as caught:
        read_volume(path, **options)
    text = str(caught.value)
    assert phantoms.PERSON not in text
    return text


def frames_of(folder: Path, tag: str, values) -> None:
    """One series in which each slice is there once for each value of a tag; values 100 t higher at time t."""
    series = generate_uid()
    for time, value in enumerate(values):
        raised = phantoms.Encoding(intercepts=(-100.0 * time,))  # stored values are higher, intercepts are set to 0

        def change(dataset, i, value=value):
            setattr(dataset, tag, value)
            dataset.RescaleIntercept = 0

        phantoms.write_classic(folder, AXIAL, encoding=raised, series=series, change=change, first=time * SLICES)


@pytest.mark.parametrize(
    ("tag", "values", "odd"),
    [
        ("TemporalPositionIdentifier", (3, 1, 2), False),
        ("TriggerTime", (0, 350.5, 700), False),
        ("EchoTime", (2.5, 5, 7.5), True),
        ("DiffusionBValue", (0.0, 500.0, 1000.0), True),
        ("AcquisitionNumber", (1, 2, 3), False),
        ("AcquisitionTime", ("095959.5", "100000.25", "100001"), False),
        ("ImageType", (["ORIGINAL", "PRIMARY", "M"], ["ORIGINAL", "PRIMARY", "P"]), True),
    ],
)
def test_frames_are_told_apart(tmp_path: Path, tag: str, values, odd: bool):
    frames_of(tmp_path, tag, values)
    for number, time in enumerate(np.argsort(np.array(values[:3])) if tag != "ImageType" else (0, 1), 1):
        volume = read_volume(tmp_path, frame=number)
        assert volume.frames == len(values) and volume.voxels.shape[0] == SLICES
        assert error_of(volume, more=100.0 * time) <= 0.05 + 1e-6
        assert any("not in time" in remark for remark in volume.remarks) == odd
    assert "1 to" in refusal(tmp_path, frame=len(values) + 1)


def test_frames_of_an_enhanced_object(tmp_path: Path):
    path = phantoms.write_enhanced(tmp_path / "a", GEOMETRIES["oblique"], times=3)
    for number in (1, 2, 3):
        volume = read_volume(path, frame=number)
        assert volume.frames == 3 and error_of(volume, more=100.0 * (number - 1)) <= 0.05 + 1e-6


def test_frames_without_a_slice_are_left_out(tmp_path: Path):
    frames_of(tmp_path, "TemporalPositionIdentifier", (1, 2, 3))
    sorted(tmp_path.iterdir())[-1].unlink()
    volume = read_volume(tmp_path)
    assert volume.frames == 2 and any("lack slices" in remark for remark in volume.remarks)


def test_acquisitions_that_overlap_are_volumes(tmp_path: Path):
    """Two neighboring regions of one series that share two slices."""
    series = generate_uid()
    for number, begin in ((1, 0), (2, 5)):
        steps = (begin + np.arange(7)) * 1.5
        region = phantoms.geometry("region", (1, 0, 0), (0, 1, 0), steps)

        def change(dataset, i, number=number):
            dataset.AcquisitionNumber = number

        phantoms.write_classic(tmp_path, region, series=series, change=change, first=100 * number)
    assert "There are 2 series" in refusal(tmp_path)
    for number in (1, 2):
        volume = read_volume(tmp_path, series=number)
        assert volume.voxels.shape[0] == 7 and error_of(volume) <= 0.05 + 1e-6


def test_headers_are_read_once_until_a_file_changes(tmp_path: Path, monkeypatch):
    """So that the next frame of a long series in time is there at once."""
    frames_of(tmp_path, "TemporalPositionIdentifier", (1, 2))
    parsed = []
    read = discovery.read.read_elements
    monkeypatch.setattr(discovery.read, "read_elements", lambda path: parsed.append(path) or read(path))
    assert error_of(read_volume(tmp_path, frame=1)) <= 0.05 + 1e-6 and len(parsed) == 2 * SLICES
    assert error_of(read_volume(tmp_path, frame=2), more=100.0) <= 0.05 + 1e-6 and len(parsed) == 2 * SLICES
    changed = sorted(tmp_path.iterdir())[3]
    dataset = phantoms.read(changed)
    dataset.RescaleIntercept = 50
    dataset.save_as(changed)
    assert any(
        "different scales" in remark for frame in (1, 2) for remark in read_volume(tmp_path, frame=frame).remarks
    )
    assert parsed[2 * SLICES :] == [changed]


def test_a_file_that_changes_while_its_header_is_read_is_read_again(tmp_path: Path, monkeypatch):
    paths = phantoms.write_classic(tmp_path, AXIAL)
    read = discovery.read.read_elements

    def change_after(path):
        parsed = yield from read(path)
        if path == paths[3]:
            dataset = phantoms.read(path)
            dataset.RescaleIntercept = 50
            dataset.save_as(path)
        return parsed

    monkeypatch.setattr(discovery.read, "read_elements", change_after)
    assert read_volume(tmp_path).remarks == ()
    monkeypatch.undo()
    assert "different scales" in " ".join(read_volume(tmp_path).remarks)


def test_few_headers_are_kept(tmp_path: Path, monkeypatch):
    frames_of(tmp_path, "TemporalPositionIdentifier", (1, 2))
    monkeypatch.setattr(discovery, "MOST_KEPT", 3)
    assert read_volume(tmp_path).frames == 2 and len(discovery._kept) <= 3


def test_slices_that_nothing_tells_apart_are_refused(tmp_path: Path):
    frames_of(tmp_path, "InstanceCreationTime", ("101010", "101011"))
    assert "tells them apart" in refusal(tmp_path)


def test_copies_are_left_out(tmp_path: Path):
    paths = phantoms.write_classic(tmp_path / "a", AXIAL)
    shutil.copy(paths[2], tmp_path / "copy of 3")
    (tmp_path / "b").mkdir()
    shutil.copy(paths[5], tmp_path / "b" / "x.dcm")
    volume = read_volume(tmp_path)
    assert volume.voxels.shape[0] == SLICES and error_of(volume) <= 0.05 + 1e-6
    assert any("2 pictures are copies" in remark for remark in volume.remarks)


def test_a_series_copied_with_new_names_is_one(tmp_path: Path):
    series = generate_uid()
    phantoms.write_classic(tmp_path, AXIAL, series=series)
    phantoms.write_classic(tmp_path, AXIAL, series=series, first=50)
    volume = read_volume(tmp_path)
    assert volume.voxels.shape[0] == SLICES and any("copies" in remark for remark in volume.remarks)


def test_a_localizer_is_left_out(tmp_path: Path):
    series = generate_uid()
    phantoms.write_classic(tmp_path, AXIAL, series=series)

    def change(dataset, i):
        dataset.ImageType = ["ORIGINAL", "PRIMARY", "LOCALIZER"]

    phantoms.write_classic(tmp_path, GEOMETRIES["coronal"], series=series, change=change, first=100)
    assert error_of(read_volume(tmp_path)) <= 0.05 + 1e-6
    assert error_of(read_volume(tmp_path, series=2)) <= 0.05 + 1e-6  # it can be asked for


def test_other_pictures_that_are_left_out_are_told(tmp_path: Path):
    phantoms.write_classic(tmp_path, AXIAL)
    phantoms.write_classic(tmp_path, phantoms.geometry("one", (1, 0, 0), (0, 0, -1), [0.0]), first=90)
    volume = read_volume(tmp_path)
    assert error_of(volume) <= 0.05 + 1e-6
    left_out = "1 other series with fewer than 3 slices was left out; choose one by its number (series)."
    assert volume.remarks == (left_out,)
    assert "single picture" in refusal(tmp_path, series=2)


def two_series(folder: Path) -> None:
    def change(dataset, i):
        dataset.SeriesNumber = 8

    phantoms.write_classic(folder / "a", AXIAL)
    phantoms.write_classic(folder / "b", GEOMETRIES["tilt, even steps"], change=change)


def test_several_series_are_listed(tmp_path: Path):
    two_series(tmp_path)
    text = refusal(tmp_path)
    assert "choose one by its number (series)" in text
    assert "1 is CT HEAD, 36 x 33, 9 slices, 0.6 x 0.6 x 1.5 mm; 2 is CT" in text
    assert read_volume(tmp_path, series=1).affine[1, 2] == 0.0
    assert read_volume(tmp_path, series=2).affine[1, 2] > 0.4
    assert "There is no series 3" in refusal(tmp_path, series=3)


def test_a_series_is_found_again_among_others(tmp_path: Path):
    """By the hash of its identifier, whatever its number is by now; of another place, the only series is read."""
    phantoms.write_classic(tmp_path / "a" / "b", AXIAL, series=(series := generate_uid()))
    key = read_volume(tmp_path / "a").series
    assert key and series not in key
    for at in (1, 2):
        number = -at  # so that it comes before
        phantoms.write_classic(
            tmp_path / "a" / str(at),
            GEOMETRIES["tilt, even steps"],
            change=lambda dataset, i, number=number: setattr(dataset, "SeriesNumber", number),
        )
        found = read_volume(tmp_path / "a", series_key=key, series=1)
        assert found.series == key and found.affine[1, 2] == 0.0
    assert read_volume(tmp_path / "a" / "1", series_key=key, series=7).series not in ("", key)
    assert "There are 3 series" in refusal(tmp_path / "a", series_key="of another")
    path = tmp_path / "a.raw"
    path.write_bytes(bytes(8))
    assert read_volume(path, shape=(2, 2, 2), dtype="uint8", series_key=key).series == ""


def test_one_file_stands_for_its_series(tmp_path: Path):
    series = [generate_uid(), generate_uid()]
    axial = phantoms.write_classic(tmp_path, AXIAL, series=series[0])
    tilted = phantoms.write_classic(tmp_path, GEOMETRIES["tilt, even steps"], series=series[1], first=100)
    assert read_volume(axial[4]).affine[1, 2] == 0.0
    assert read_volume(tilted[4]).affine[1, 2] > 0.4


def test_a_folder_of_orientations(tmp_path: Path):
    series = generate_uid()
    phantoms.write_classic(tmp_path, AXIAL, series=series)
    phantoms.write_classic(tmp_path, GEOMETRIES["sagittal"], series=series, first=100)
    assert "There are 2 series" in refusal(tmp_path)
    for number in (1, 2):
        assert error_of(read_volume(tmp_path, series=number)) <= 0.05 + 1e-6


def test_parallel_stacks_in_one_series(tmp_path: Path):
    """Two slabs side by side, as of two table positions, are two volumes."""
    series = generate_uid()
    phantoms.write_classic(tmp_path, AXIAL, series=series)
    beside = phantoms.geometry("beside", (1, 0, 0), (0, 1, 0), np.arange(7) * 2.0, origin=(40.0, 4.1, 21.7))
    phantoms.write_classic(tmp_path, beside, series=series, first=100)
    shapes = {read_volume(tmp_path, series=number).voxels.shape[0] for number in (1, 2)}
    assert shapes == {SLICES, 7}


@pytest.mark.parametrize("odd", [4, SLICES - 1])
@pytest.mark.parametrize(
    ("tag", "usual", "other"),
    [
        ("ImageOrientationPatient", [0.707149, 0, -0.707064, 0, 1, 0], [0.707151, 0, -0.707062, 0, 1, 0]),
        ("PixelSpacing", [0.488249, 0.488249], [0.488251, 0.488251]),
    ],
)
def test_a_slice_whose_numbers_are_rounded_otherwise_stays(tmp_path: Path, tag: str, usual, other, odd: int):
    oblique = phantoms.geometry("oblique", (0.707149, 0, -0.707064), (0, 1, 0), np.arange(SLICES) * 2.0)
    phantoms.write_classic(
        tmp_path, oblique, change=lambda dataset, i: setattr(dataset, tag, other if i == odd else usual)
    )
    volume = read_volume(tmp_path)
    assert volume.voxels.shape[0] == SLICES and volume.remarks == ()
    np.testing.assert_array_equal(volume.voxels, np.rint([oblique.values(i, 2) for i in range(SLICES)]))


def test_slices_that_jitter_are_not_resampled(tmp_path: Path):
    jitter = np.array([0, 2, -2, 1, 2, -1, -2, 2, 0]) * 0.01
    where = phantoms.geometry("jitter", (1, 0, 0), (0, 1, 0), np.arange(SLICES) * 2.0 + jitter)
    phantoms.write_classic(tmp_path, where)
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.voxels, np.rint([where.values(i, 2) for i in range(SLICES)]))
    assert volume.remarks == ("Slices are up to 0.020 mm off the even, parallel stack that they were put into.",)


@pytest.mark.parametrize("last", [False, True])
def test_slices_of_the_series_that_are_left_out_are_told(tmp_path: Path, last: bool):
    """Also if the series was named: one that is turned, and one that cannot be used."""
    odd = SLICES - 2 if last else 4

    def change(dataset, i):
        if i == odd:
            dataset.ImageOrientationPatient = [1, 0, 0, 0, 0.999, 0.0447]
        if i == SLICES - 1:
            dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 3, "RGB"

    paths = phantoms.write_classic(tmp_path, AXIAL, change=change)
    number = 1 + int(np.argmax([group.slices for group in groups_in(drain(find_pictures(tmp_path)))]))
    key = read_volume(tmp_path).series
    for options in ({}, {"series": number}, {"series_key": key, "series": number}, {"series_key": key}):
        volume = read_volume(tmp_path, **options)
        assert volume.voxels.shape[0] == (SLICES - 2 if last else SLICES - 1)
        assert (
            f"1 file of this series was left out: {paths[-1].name} is a color picture; choose a series with one gray "
            "value in each voxel.",
            "1 slice of this series was left out: size, direction, spacing or place differs. The volume is "
            "interpolated or ends there.",
        ) == volume.remarks[:2]
        assert volume.remarks[2:] == (() if last else ("1 slice is missing and was interpolated: number 5 of 8.",))


def test_a_directory_file(tmp_path: Path):
    phantoms.write_classic(tmp_path / "in", AXIAL)
    files = FileSet()
    for path in (tmp_path / "in").iterdir():
        files.add(path)
    files.write(tmp_path / "disc")
    shutil.rmtree(tmp_path / "in")
    assert error_of(volume := read_volume(tmp_path / "disc" / "DICOMDIR")) <= 0.05 + 1e-6 and not volume.remarks
    next(path for path in sorted((tmp_path / "disc").rglob("*")) if path.is_file() and path.name != "DICOMDIR").unlink()
    remark = "The DICOMDIR lists files that are not there (1), so slices may be missing."
    assert remark in read_volume(tmp_path / "disc" / "DICOMDIR").remarks
    shutil.rmtree(next(path for path in (tmp_path / "disc").iterdir() if path.is_dir()))
    assert "not beside it" in refusal(tmp_path / "disc" / "DICOMDIR")


def test_the_chooser(tmp_path: Path):
    two_series(tmp_path)
    groups = groups_in(drain(find_pictures(tmp_path)))
    first, second = (series_info(group, number) for number, group in enumerate(groups, 1))
    assert (first.modality, first.body_part, first.slices, first.size) == ("CT", "HEAD", SLICES, (36, 33))
    np.testing.assert_allclose(first.spacing, (0.6, 0.6, 1.5), atol=1e-6)
    assert second.spacing[2] > 1.5 and (first.frames, first.problem) == (1, "")
    picture = thumbnail(groups[1])
    assert picture.dtype == np.uint8 and picture.shape == (33, 36)


def test_the_series_of_a_study_are_listed_by_the_numbers_that_read_them(tmp_path: Path):
    two_series(tmp_path)
    listed = list_series(tmp_path)
    assert [one.number for one in listed] == [1, 2]
    for one in listed:
        volume = read_volume(tmp_path, series=one.number)
        assert (*volume.spacing, volume.modality) == pytest.approx((*one.spacing, one.modality))
    assert listed[0].spacing != listed[1].spacing
    write_volume(volume, tmp_path / "other.nrrd")
    assert list_series(tmp_path / "other.nrrd") == ()
    with pytest.raises(RleSplatError, match="There is no file"):
        list_series(tmp_path / "nothing")


@pytest.mark.parametrize(
    ("steps", "slices", "word"),
    [
        ([0.0, 3.0], 2, ""),
        ([0, 1, 2, 3, 7, 8], 9, "3 slices are missing and were interpolated: number 5, 6, 7 of 9"),
        ([0, 2, 5, 7, 9], 10, "5 slices are missing"),  # the step is half of the smallest distance
        ([0, 1.004, 2, 2.998, 4], 5, ""),  # within a hundredth of a step
        ([0, 1, 2.2, 3], 5, "irregular distances and were resampled to 5 slices, 0.7537 mm apart"),
        ([30.0, 31.0, 31.03, 33.0, 48.0], 40, "irregular"),  # at most eight times the files' slices
        ([0.0, 20.0, 39.0, 39.02, 39.05], 40, "irregular"),  # dense at the end: not in place
    ],
)
def test_distances(tmp_path: Path, steps, slices: int, word: str):
    where = phantoms.geometry("steps", (1, 0, 0), (0, 1, 0), steps, shear=(0.1, 0.0))
    phantoms.write_classic(tmp_path, where)
    volume = read_volume(tmp_path)
    assert volume.voxels.shape[0] == slices and word in " ".join(volume.remarks) and bool(word) == bool(volume.remarks)
    assert error_of(volume) <= 0.1 + 1e-6


@pytest.mark.parametrize("name", ["oblique", "axial", "descending", "irregular steps"])
def test_a_dose_whose_frames_lie_at_offsets(tmp_path: Path, name: str):
    """RT dose: one position, and the offset of each frame along the normal, or its z; added to a scan of another grid.

    The values are linear in the place, so that interpolation changes none.
    """
    where = GEOMETRIES[name]
    normal = np.cross(where.row, where.column)
    steps = (where.positions - (0.0 if name == "axial" else where.positions[0])) @ normal
    assert name != "axial" or steps[0] > 1.0

    def change(dataset):
        for name in ("SharedFunctionalGroupsSequence", "PerFrameFunctionalGroupsSequence"):
            delattr(dataset, name)
        dataset.SOPClassUID, dataset.Modality, dataset.DoseUnits = "1.2.840.10008.5.1.4.1.1.481.2", "RTDOSE", "GY"
        dataset.ImagePositionPatient = [f"{value:.6f}" for value in where.positions[0]]
        dataset.ImageOrientationPatient = [f"{value:.10f}" for value in (*where.row, *where.column)]
        dataset.PixelSpacing, dataset.DoseGridScaling = list(where.spacing), 0.5
        dataset.GridFrameOffsetVector = steps.tolist()

    encoding = phantoms.Encoding(slopes=(0.5,))
    path = phantoms.write_enhanced(tmp_path / "a.dcm", where, encoding=encoding, change=change, shuffled=False)
    volume = read_volume(path)
    assert error_of(volume) <= 0.03 and (volume.value_unit, volume.slope) == ("Gy", 0.5)
    scan = Volume(np.zeros((11, 12, 9), np.int16), volume.affine @ np.diag((1.3, 1.9, 0.7, 1.0)), space=PATIENT)
    dose, _ = drain(read_channel_steps(path, scan))
    assert dose.shape_xyz == scan.shape_xyz and dose.value_unit == "Gy"
    assert error_of(dose) <= 0.06


def test_files_without_preamble_and_meta(tmp_path: Path):
    for path in phantoms.write_classic(
        tmp_path, AXIAL, encoding=phantoms.with_syntax(phantoms.PLAIN, "1.2.840.10008.1.2")
    ):
        data = path.read_bytes()
        length = int.from_bytes(data[140:144], "little")
        path.write_bytes(data[144 + length :])
    assert error_of(read_volume(tmp_path)) <= 0.05 + 1e-6


@pytest.mark.parametrize(
    "begin", [[8, 0, 0, 0], [8, 5, 8, 0], [8, 24, 6, 0, 900, 901, 902], [2, 0, 0, 0], [2048, 2048]]
)
@pytest.mark.parametrize("dtype", ["<u2", ">u2", "u1"])
def test_raw_voxels_are_not_taken_for_dicom(tmp_path: Path, begin, dtype: str):
    values = np.zeros(64, np.uint16)
    values[: len(begin)] = begin
    path = tmp_path / "a.raw"
    path.write_bytes(values.astype(dtype).tobytes())
    assert format_of(path).name == "raw"
