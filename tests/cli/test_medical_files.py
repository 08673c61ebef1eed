"""Medical files from the command line: converted to the bit, described, encoded, and rejected with a clear error."""

import gzip
import json

import nibabel
import numpy as np
import pytest
import tifffile

from rle_splat.read.formats import read_volume, write_volume
from rle_splat.volume.volume import PATIENT, Volume

AFFINE = np.array([(-2.0, 0.3, 0, 30), (0, 1.5, 0.4, -20), (0, 0, 3.0, 100), (0, 0, 0, 1)])  # to LPS, sheared


@pytest.fixture
def scan(tmp_path, voxels):
    """A NIfTI file of a ball in patient space."""
    path = tmp_path / "scan.nii.gz"
    values = (voxels.astype(np.int16) * 5).transpose(2, 1, 0)
    image = nibabel.Nifti1Image(values, np.diag((-1.0, -1, 1, 1)) @ AFFINE)
    image.header.set_xyzt_units("mm")
    image.header.set_slope_inter(0.5, -10.0)
    nibabel.save(image, path)
    content = bytearray(gzip.decompress(path.read_bytes()))
    content[112:120] = np.array((0.5, -10.0), "<f4").tobytes()  # nibabel rescales values when it writes
    content[352:] = np.asfortranarray(values).tobytes("F")
    path.write_bytes(gzip.compress(content, mtime=0))
    return path


def test_there_and_back_to_the_bit(call, tmp_path, scan):
    """NIfTI to NRRD and back: the same bytes of voxels, type, slope, intercept and affine."""
    assert call("convert", scan, tmp_path / "a.nrrd").code == 0
    result = call("convert", tmp_path / "a.nrrd", tmp_path / "b.nii", "--json", tmp_path / "c.json")
    assert result.code == 0
    first, back = nibabel.load(scan), nibabel.load(tmp_path / "b.nii")
    assert back.get_data_dtype() == first.get_data_dtype() == np.int16
    np.testing.assert_array_equal(back.dataobj.get_unscaled(), first.dataobj.get_unscaled())
    np.testing.assert_array_equal(back.affine, first.affine)
    assert (back.dataobj.slope, back.dataobj.inter) == (0.5, -10.0)
    assert json.loads((tmp_path / "c.json").read_text())["lost"] == []


def test_what_is_lost_is_said(call, tmp_path, scan):
    result = call("convert", scan, tmp_path / "a.nrrd")
    assert "NRRD has no slope and intercept" in result.out
    result = call("convert", scan, tmp_path / "a.nii", "--modality", "MR")
    assert "NIfTI has no field for modality" in result.out and "Read it back with: --modality MR" in result.out
    volume = Volume(np.zeros((3, 4, 5), np.uint8), np.diag((0.1, 0.2, 0.3, 1.0)), space=PATIENT)
    write_volume(volume, tmp_path / "b.nrrd")
    assert "rounded to 7 digits" in call("convert", tmp_path / "b.nrrd", tmp_path / "b.nii").out


def test_info_says_how_the_patient_lies(call, tmp_path, scan):
    result = call("info", scan, "--json", tmp_path / "info.json")
    assert "orientation voxel axes R, P, S; 11.3 degrees oblique" in result.out
    report = json.loads((tmp_path / "info.json").read_text())
    assert report["space"] == "patient" and report["axis_letters"] == ["R", "P", "S"] and report["frames"] == 1
    values = np.zeros((4, 5, 6, 3), np.uint8)
    nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), tmp_path / "time.nii")
    result = call("info", tmp_path / "time.nii", "--frame", "2")
    assert "3; --frame chooses one" in result.out and "time point 2 was read" in result.out


def test_an_encoded_patient_is_seen_from_the_front_too(call, tmp_path, scan, function_file):
    """The space goes into the .rle file, so both pictures show the face."""
    words = ("--transfer-function", function_file, "--size", "32x32", "--classification", "pre")
    assert call("render", scan, *words, "-o", tmp_path / "a.npy").code == 0
    result = call("encode", scan, "-o", tmp_path / "a.rle", "--transfer-function", function_file)
    assert result.code == 0, result.err
    result = call("render", tmp_path / "a.rle", "--size", "32x32", "-o", tmp_path / "b.npy")
    assert result.code == 0, result.err
    one, two = np.load(tmp_path / "a.npy"), np.load(tmp_path / "b.npy")
    assert one[..., 3].max() > 0.2
    np.testing.assert_allclose(one, two, atol=0.01)


def test_what_a_file_says_of_a_person_goes_nowhere(call, tmp_path, scan, function_file):
    """Free text in headers may name the patient; it is neither printed nor written."""
    content = bytearray(gzip.decompress(scan.read_bytes()))
    content[148:156], content[228:236], content[14:22] = b"DOE^JANE", b"DOE^JANE", b"DOE^JANE"
    (tmp_path / "a.nii").write_bytes(content)
    text = "NRRD0004\n# DOE^JANE\ncontent: DOE^JANE\ntype: uchar\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n"
    (tmp_path / "b.nrrd").write_bytes((text + "patient:=DOE^JANE\n\n").encode() + bytes(range(64)))
    text = (
        "ObjectType = Image\nNDims = 3\nName = DOE^JANE\nComment = DOE^JANE\nDimSize = 4 4 4\nElementType = MET_UCHAR\n"
    )
    (tmp_path / "c.mha").write_bytes((text + "ElementDataFile = LOCAL\n").encode() + bytes(range(64)))
    for name in ("a.nii", "b.nrrd", "c.mha"):
        out = tmp_path / "out"
        out.mkdir()
        results = [
            call("info", tmp_path / name, "--json", out / "info.json"),
            call("convert", tmp_path / name, out / "again.nii", "--json", out / "convert.json"),
            call("convert", tmp_path / name, out / "again.nrrd"),
            call("encode", tmp_path / name, "-o", out / "a.rle", "--transfer-function", function_file),
        ]
        assert [result.code for result in results] == [0] * 4, results
        for result in results:
            assert "JANE" not in result.out + result.err
        for path in out.iterdir():
            assert b"JANE" not in path.read_bytes(), path.name
            path.unlink()
        out.rmdir()


def bad_files(folder):
    """Beside those of ``tests.read.bad_files.BAD``."""
    (folder / "noise.nii").write_bytes(bytes(range(256)) * 4)
    (folder / "empty.nrrd").write_bytes(b"")
    (folder / "bad.tif").write_bytes(b"MM\0*" + bytes(40))
    (folder / "short.mgz").write_bytes(gzip.compress(bytes(20)))
    return ("noise.nii", "empty.nrrd", "bad.tif", "short.mgz")


@pytest.mark.parametrize("command", ["info", "convert", "render"])
def test_bad_files_are_refused_in_a_sentence(refused, tmp_path, command):
    """``refused`` checks one line on stderr and exit code 2; nothing is left behind."""
    folder = tmp_path / "bad"
    folder.mkdir()
    names = bad_files(folder)
    for name in names:
        words = {"info": (), "convert": (folder / "out.nii",), "render": ("-o", folder / "out.npy")}[command]
        sentence = refused(command, folder / name, *words)
        assert sentence.rstrip().endswith(".") and "Traceback" not in sentence
    assert sorted(path.name for path in folder.iterdir()) == sorted(names)


@pytest.mark.parametrize("name, module, package", [
    ("a.nii", "nibabel", "nibabel"), ("a.nrrd", "nrrd", "pynrrd"), ("a.tif", "tifffile", "tifffile"),
])  # fmt: skip
def test_a_python_without_the_library_is_told_its_name(refused, tmp_path, monkeypatch, name, module, package):
    if name == "a.tif":
        tifffile.imwrite(tmp_path / name, np.zeros((3, 4, 5), np.uint8), photometric="minisblack")
    else:
        write_volume(Volume(np.zeros((3, 4, 5), np.uint8), np.eye(4)), tmp_path / name)
    assert read_volume(tmp_path / name).voxels.size == 60
    monkeypatch.setitem(__import__("sys").modules, module, None)
    assert f"need the package {package}, which this Python lacks" in refused("info", tmp_path / name)
