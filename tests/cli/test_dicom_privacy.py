"""Nothing that names a patient gets from a DICOM file into what we write or print."""

import re
import zipfile
from pathlib import Path

import pytest

pytest.importorskip("pydicom")

from rle_splat.cli.main import main
from rle_splat.read.dicom.discovery import find_pictures
from rle_splat.read.dicom.reader import groups_in
from rle_splat.read.dicom.titles import group_title, series_info
from rle_splat.read.formats import list_series, read_volume
from rle_splat.runtime.steps import drain
from tests.read import dicom_phantoms as phantoms
from tests.read.test_dicom_segmentation import truth, write_seg

WORDS = (
    "DOE",
    "JANE",
    "ROE",
    "RICHARD",
    "General Hospital",
    "S-0815",
    "ACC-77120",
    phantoms.NUMBER,
    phantoms.BIRTH,
    "20210304",
)
AXIAL = phantoms.geometries()["axial"]


def secrets(folder: Path) -> list[bytes]:
    """Words and UIDs of the files of a folder that must not appear anywhere."""
    found = {word.encode() for word in WORDS}
    for path in folder.rglob("*.dcm"):
        dataset = phantoms.read(path)
        for name in ("SOPInstanceUID", "StudyInstanceUID", "SeriesInstanceUID", "FrameOfReferenceUID"):
            if name in dataset:
                found.add(str(dataset[name].value).encode())
    return sorted(found)


def said(data: bytes, words) -> list[bytes]:
    """The words that some bytes hold, as text of one byte or of two a letter."""
    whole = {word: re.compile(rb"(?<![a-z])" + re.escape(word) + rb"(?![a-z])", re.IGNORECASE) for word in words}
    return [word for word in words if whole[word].search(data) or word.decode().encode("utf-16-le") in data]


def unpacked(path: Path) -> bytes:
    """A file's bytes, with the members of a zip unpacked."""
    if not zipfile.is_zipfile(path):
        return path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        return path.read_bytes() + b"".join(archive.read(name) for name in archive.namelist())


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    phantoms.write_classic(tmp_path / "scan" / "a", AXIAL)
    return tmp_path / "scan"


def commands(scan: Path, out: Path):
    """Command lines that read a scan, some of which are refused."""
    yield ["info", scan, "--json", out / "info.json"]
    yield ["render", scan, "-o", out / "a.npy", "-o", out / "a.png", "--size", "32", "--json", out / "render.json"]
    yield ["figure", scan, "-o", out / "a.svg", "--width-cm", "2", "--dpi", "50", "--json", out / "figure.json"]
    yield ["encode", scan, "-o", out / "a.rle", "--axes", "z", "--json", out / "encode.json"]
    yield ["convert", scan, out / "a.nii", "--json", out / "convert.json"]
    yield ["convert", scan, out / "a.nrrd"]
    yield ["convert", scan, out / "a.raw"]
    yield ["info", scan, "--series", "9"]
    yield ["info", scan, "--frame", "9"]


def test_outputs_of_the_command_line(scan: Path, tmp_path: Path, capfd):
    out = tmp_path / "out"
    out.mkdir()
    words = secrets(scan)
    assert len(words) > len(WORDS) + 9
    codes = [main([str(word) for word in command]) for command in commands(scan, out)]
    assert codes[:7] == [0] * 7 and codes[7:] == [2, 2]
    phantoms.write_classic(scan / "b", phantoms.geometries()["coronal"])
    assert main(["info", str(scan), "--json", str(out / "series.json")]) == 0  # lists two series
    assert main(["render", str(scan), "-o", str(out / "b.png")]) == 2
    captured = capfd.readouterr()
    assert "CT HEAD" in captured.err and "series 2    CT HEAD" in captured.out
    words = secrets(scan)
    assert not said((captured.out + captured.err).encode(), words)
    written = sorted(out.iterdir())
    assert len(written) >= 10
    for path in written:
        assert not said(path.name.encode() + unpacked(path), words), path.name


def test_volume_and_chooser(scan: Path):
    words = secrets(scan)
    volume = read_volume(scan)
    assert volume.name == "CT HEAD"
    facts = {name: value for name, value in vars(volume).items() if name != "voxels"}
    assert not said(repr(facts).encode(), words)
    group = groups_in(drain(find_pictures(scan)))[0]
    info = series_info(group, 1)
    assert not said(group_title(group).encode(), words)
    assert list_series(scan)[0] == info and not said(repr(info).encode(), words)
    description = group.first.series.description
    assert phantoms.PERSON in description  # shown in the chooser, and nowhere else
    assert not said(repr(group.frames).replace(repr(description), "").encode(), words)


@pytest.mark.filterwarnings("ignore:Invalid value for VR CS")
def test_free_text_in_coded_elements_is_not_taken(tmp_path: Path):
    def change(dataset, i):
        dataset.Modality, dataset.BodyPartExamined = phantoms.PERSON, "Jane's head"

    phantoms.write_classic(tmp_path, AXIAL, change=change)
    volume = read_volume(tmp_path)
    assert volume.name == "DICOM" and volume.modality is None


@pytest.mark.parametrize("cut", [200, 700, 1500])
def test_damaged_files(tmp_path: Path, cut: int, capfd):
    """Neither an error nor a library's warning quotes a file."""
    phantoms.write_classic(tmp_path / "a", AXIAL)
    words = secrets(tmp_path)
    for path in (tmp_path / "a").iterdir():
        data = bytearray(path.read_bytes())
        data[cut : cut + 3] = b"\xff\xfe\xfd"
        path.write_bytes(data)
    main(["info", str(tmp_path), "--debug"])
    captured = capfd.readouterr()
    assert not said((captured.out + captured.err).encode(), words)


def test_segmentation(tmp_path: Path):
    path = write_seg(tmp_path / "seg.dcm", AXIAL, truth(AXIAL, 3))
    volume = read_volume(path)
    facts = {name: value for name, value in vars(volume).items() if name != "voxels"}
    assert not said(repr(facts).encode(), secrets(tmp_path))
