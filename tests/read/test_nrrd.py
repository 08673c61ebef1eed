"""NRRD, written by pynrrd and judged by SimpleITK; segmentations as Slicer writes them."""

import gzip

import nrrd
import numpy as np
import pytest

from rle_splat.read.formats import format_of, read_volume, write_volume
from rle_splat.scene import RleSplatError
from rle_splat.volume.orientation import oblique_degrees
from rle_splat.volume.volume import PATIENT, STORED_TYPES, Volume

from .judges import affine_by_itk
from .phantoms import AFFINES, LEAST_ERROR, SHAPE, coordinates, ras, worst_error

SimpleITK = pytest.importorskip("SimpleITK")  # not in the benchmarks' environment

SPACES = {
    "left-posterior-superior": np.eye(4), "RAS": ras(np.eye(4)),
    "left-anterior-superior": np.diag((1.0, -1.0, 1.0, 1.0)),
}  # fmt: skip


def header_of(affine, space="left-posterior-superior", **fields):
    """A header for pynrrd: directions as rows, in the coordinates of the space."""
    there = SPACES[space] @ affine
    return {"space": space, "space directions": there[:3, :3].T, "space origin": there[:3, 3],
            "kinds": ["domain"] * 3, **fields}  # fmt: skip


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("encoding", ["raw", "gzip", "bzip2"])
@pytest.mark.parametrize("name", AFFINES)
def test_every_voxel_lies_where_its_value_says(tmp_path, name, encoding, space):
    volumes = []
    for i, values in enumerate(coordinates(AFFINES[name])):
        nrrd.write(str(tmp_path / f"{i}.nrrd"), values, header_of(AFFINES[name], space, encoding=encoding))
        volumes.append(read_volume(tmp_path / f"{i}.nrrd"))
    assert worst_error(volumes) <= LEAST_ERROR
    assert all(volume.space == PATIENT and volume.unit == "mm" for volume in volumes)


@pytest.mark.parametrize(
    "name, short",
    [("left-posterior-superior", "LPS"), ("right-anterior-superior", "RAS"), ("left-anterior-superior", "LAS")],
)
def test_a_space_and_its_abbreviation_are_one(tmp_path, name, short):
    """Of each space one of both was compared with SimpleITK above."""
    assert {name, short} & SPACES.keys()
    found = []
    for space in (name, short, short.lower()):
        header = {**header_of(AFFINES["oblique"]), "space": space}
        nrrd.write(str(tmp_path / "a.nrrd"), coordinates(AFFINES["oblique"])[0], header)
        found.append(read_volume(tmp_path / "a.nrrd"))
    assert all(one.space == PATIENT and np.array_equal(one.affine, found[0].affine) for one in found)


@pytest.mark.parametrize("dtype", [">i2", "<f8", ">u4", "<i8"])
def test_types_and_byte_orders(tmp_path, dtype):
    values = np.arange(-30, 30).reshape(3, 4, 5).astype(dtype) if "u" not in dtype else np.ones((3, 4, 5), dtype)
    nrrd.write(str(tmp_path / "a.nrrd"), values, {"encoding": "raw"})
    np.testing.assert_array_equal(read_volume(tmp_path / "a.nrrd").voxels.transpose(2, 1, 0), values)


def test_a_detached_header_names_no_file_elsewhere(tmp_path):
    (tmp_path / "scan").mkdir()
    nrrd.write(str(tmp_path / "scan" / "a.nhdr"), coordinates(AFFINES["oblique"])[0], {"encoding": "raw"})
    header = (tmp_path / "scan" / "a.nhdr").read_text()
    (tmp_path / "scan" / "a.nhdr").write_text(header.replace("a.raw", str(tmp_path / "scan" / "a.raw")))
    assert read_volume(tmp_path / "scan" / "a.nhdr").shape_xyz == coordinates(AFFINES["oblique"])[0].shape
    (tmp_path / "scan" / "a.raw").rename(tmp_path / "a.raw")
    (tmp_path / "scan" / "a.nhdr").write_text(header.replace("a.raw", "../a.raw"))
    with pytest.raises(RleSplatError, match=r"a\.nhdr names \.\..a\.raw, which is outside its folder"):
        read_volume(tmp_path / "scan" / "a.nhdr")


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
def test_a_detached_header(tmp_path, encoding):
    values = coordinates(AFFINES["oblique"])[0]
    nrrd.write(str(tmp_path / "a.nhdr"), values, header_of(AFFINES["oblique"], encoding=encoding))
    volume = read_volume(tmp_path / "a.nhdr")
    np.testing.assert_array_equal(volume.voxels.transpose(2, 1, 0), values)
    next(path for path in tmp_path.iterdir() if path.suffix != ".nhdr").unlink()
    with pytest.raises(RleSplatError, match=r"a\.nhdr needs a\..* beside it, which is not there"):
        read_volume(tmp_path / "a.nhdr")


@pytest.mark.parametrize("field", ["data file: s%02d.raw 3 7 1", "data file: s%d.raw 7 3 -1", "data file: LIST"])
@pytest.mark.parametrize("packed", [False, True])
def test_slices_in_files_of_their_own(tmp_path, field, packed):
    values = coordinates(AFFINES["axial"])[2]
    numbers = range(3, 8) if "-1" not in field else range(7, 2, -1)
    names = [f"s{n:02d}.raw" if "%d" not in field else f"s{n}.raw" for n in numbers]
    for k, name in enumerate(names):
        content = b"x\n" + values[:, :, k].T.tobytes() if not packed else values[:, :, k].T.tobytes()
        (tmp_path / name).write_bytes(gzip.compress(content) if packed else content)
    lines = ["NRRD0004", "type: short", "dimension: 3", "sizes: 9 7 5", "endian: little",
             f"encoding: {'gzip' if packed else 'raw'}", f"line skip: {0 if packed else 1}"]  # fmt: skip
    listed = names if "LIST" in field else []
    (tmp_path / "a.nhdr").write_text("\n".join([*lines, field, *listed]) + "\n")
    np.testing.assert_array_equal(read_volume(tmp_path / "a.nhdr").voxels.transpose(2, 1, 0), values)
    (tmp_path / names[2]).unlink()
    with pytest.raises(RleSplatError, match=names[2]):
        read_volume(tmp_path / "a.nhdr")


def test_voxels_at_the_end_of_a_foreign_file(tmp_path):
    values = coordinates(AFFINES["axial"])[0]
    (tmp_path / "b.dat").write_bytes(b"some header" + values.T.tobytes())
    text = "NRRD0004\ntype: short\ndimension: 3\nsizes: 9 7 5\nendian: little\nencoding: raw\n"
    (tmp_path / "a.nhdr").write_text(text + "byte skip: -1\ndata file: b.dat\n")
    np.testing.assert_array_equal(read_volume(tmp_path / "a.nhdr").voxels.transpose(2, 1, 0), values)
    (tmp_path / "a.nhdr").write_text(text + "byte skip: 11\ndata file: b.dat\n")
    np.testing.assert_array_equal(read_volume(tmp_path / "a.nhdr").voxels.transpose(2, 1, 0), values)


@pytest.mark.parametrize("first", [True, False])
def test_a_fourth_axis_is_frames(tmp_path, first):
    values = np.arange(3 * 4 * 5 * 6, dtype=np.int16).reshape(3, 4, 5, 6)
    rows = [*AFFINES["oblique"][:3, :3].T]
    empty = np.full(3, np.nan)
    header = header_of(AFFINES["oblique"], kinds=["list", *["domain"] * 3] if first else [*["domain"] * 3, "time"])
    header["space directions"] = np.array([empty, *rows] if first else [*rows, empty])
    stored = np.moveaxis(values, 3, 0) if first else values
    nrrd.write(str(tmp_path / "a.nrrd"), stored, header)
    for frame in (1, 4, 6):
        volume = read_volume(tmp_path / "a.nrrd", frame=frame)
        assert volume.frames == 6
        np.testing.assert_array_equal(volume.voxels.transpose(2, 1, 0), values[..., frame - 1])
        np.testing.assert_allclose(volume.affine, AFFINES["oblique"], rtol=1e-14)
    words = "differ in list" if first else "6 time points"
    assert words in read_volume(tmp_path / "a.nrrd").remarks[-1]


def test_a_file_that_says_no_space(tmp_path):
    nrrd.write(str(tmp_path / "a.nrrd"), np.zeros((3, 4, 5), np.uint8), {"spacings": [0.5, 2.0, 3.0]})
    volume = read_volume(tmp_path / "a.nrrd")
    assert volume.space is None and volume.spacing.tolist() == [0.5, 2.0, 3.0]
    assert any("no unit" in remark for remark in volume.remarks)


def segment(number, name, color, value=None, layer=None):
    """The keys of one segment in Slicer's header."""
    keys = {"ID": f"Segment_{number}", "Name": name, "Color": " ".join(map(str, color)), "LabelValue": value,
            "Layer": layer}  # fmt: skip
    return {f"Segment{number}_{key}": str(text) for key, text in keys.items() if text is not None}


def test_a_segmentation_of_one_layer_has_names_and_colors(tmp_path):
    values = np.zeros((3, 4, 5), np.uint8)
    values[1], values[2] = 1, 5
    names = {**segment(0, "liver", (1, 0.5, 0), 5, 0), **segment(1, "tumor core", (0, 0, 1), 1, 0)}
    nrrd.write(str(tmp_path / "a.seg.nrrd"), values, {**header_of(AFFINES["axial"]), **names})
    volume = read_volume(tmp_path / "a.seg.nrrd")
    np.testing.assert_array_equal(volume.voxels.transpose(2, 1, 0), values)
    assert [(one.label, one.name) for one in volume.named_labels] == [(5, "liver"), (1, "tumor core")]
    np.testing.assert_allclose(volume.named_labels[0].color, (1.0, 0.21404114, 0.0), rtol=1e-6)


@pytest.mark.parametrize("first", [True, False])
def test_layers_of_a_segmentation_become_one_label_map(tmp_path, first):
    layers = np.zeros((2, 3, 4, 5), np.uint8)
    layers[0, 0], layers[0, 1], layers[1, 1:] = 1, 2, 1  # the second layer overlaps all of plane 1 of the first
    names = {**segment(0, "a", (1, 0, 0), 1, 0), **segment(1, "b", (0, 1, 0), 2, 0), **segment(2, "c", (0, 0, 1), 1, 1)}
    rows, empty = [*AFFINES["axial"][:3, :3].T], np.full(3, np.nan)
    header = {**header_of(AFFINES["axial"]), **names}
    header["kinds"] = ["list", *["domain"] * 3] if first else [*["domain"] * 3, "list"]
    header["space directions"] = np.array([empty, *rows] if first else [*rows, empty])
    nrrd.write(str(tmp_path / "a.seg.nrrd"), layers if first else np.moveaxis(layers, 0, 3), header)
    volume = read_volume(tmp_path / "a.seg.nrrd")
    expected = np.zeros((3, 4, 5))
    expected[0], expected[1:] = 1, 3
    np.testing.assert_array_equal(volume.voxels.transpose(2, 1, 0), expected)
    assert [one.name for one in volume.named_labels] == ["a", "b", "c"]
    assert "overlap in 20 voxels" in volume.remarks[-1] and volume.frames == 1


HEADER = ("NRRD0004\ntype: short\ndimension: 3\nsizes: 9 7 5\nendian: little\nencoding: raw\nspace: lps\n"
          "space directions: (1,0,0) (0,1,0) (0,0,2)\nspace origin: (0,0,0)\n")  # fmt: skip
BAD = {
    r"breaks off: 600 of 630 bytes": HEADER,
    "breaks off": HEADER.replace("9 7 5", "60000 60000 60000"),
    r"says 9 x -7 x 5 voxels": HEADER.replace("9 7 5", "9 -7 5"),
    "a field of it cannot be read": HEADER.replace("9 7 5", "9 seven 5"),
    "cannot be read; ": HEADER + "a line that is no field\n",
    "is encoded as hex": HEADER.replace("raw", "hex"),
    "are of type block": HEADER.replace("short", "block"),
    "singular": HEADER.replace("(0,0,2)", "(1,1,0)"),
    "not sensible numbers": HEADER.replace("(0,0,2)", "(0,0,inf)"),
    "has 2 axes": HEADER.replace("dimension: 3", "dimension: 2").replace("9 7 5", "9 7"),
    "are colors": HEADER + "kinds: RGB-color domain domain\n",
    "single picture": HEADER.replace("9 7 5", "9 7 1"),
    "breaks off: ": HEADER.replace("raw", "gzip"),
}


@pytest.mark.parametrize("words", BAD)
def test_each_bad_file_gets_its_sentence(tmp_path, words):
    data = gzip.compress(bytes(630), 0)[:300] if "gzip" in BAD[words] else bytes(600)
    (tmp_path / "a.nrrd").write_bytes(BAD[words].encode() + b"\n" + data)
    with pytest.raises(RleSplatError, match=words.replace("cannot be read; ", "a field of it cannot")) as refusal:
        read_volume(tmp_path / "a.nrrd")
    assert "\n" not in str(refusal.value)


def test_content_decides(tmp_path):
    nrrd.write(str(tmp_path / "a.nrrd"), np.zeros((3, 4, 5), np.uint8))
    assert format_of((tmp_path / "a.nrrd").rename(tmp_path / "a.raw")).name == "NRRD"


@pytest.mark.parametrize("dtype", STORED_TYPES)
def test_what_is_written_others_read_to_the_bit(tmp_path, dtype):
    voxels = (np.arange(5 * 4 * 3) * 3 % 127).reshape(5, 4, 3).astype(dtype)
    volume = Volume(
        voxels, AFFINES["oblique"], slope=0.1, intercept=-1024.0, value_unit="HU", modality="CT", space=PATIENT
    )
    assert write_volume(volume, tmp_path / "a.nrrd") == {}
    image = SimpleITK.ReadImage(str(tmp_path / "a.nrrd"))
    np.testing.assert_allclose(affine_by_itk(image), volume.affine, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(SimpleITK.GetArrayFromImage(image), voxels)
    judged, header = nrrd.read(str(tmp_path / "a.nrrd"))
    assert judged.dtype == dtype and header["space"] == "left-posterior-superior"
    again = read_volume(tmp_path / "a.nrrd")
    np.testing.assert_array_equal(again.physical(again.voxels), volume.physical(voxels))
    np.testing.assert_array_equal(again.affine, volume.affine)
    assert (again.value_unit, again.modality) == ("HU", "CT")


def test_a_volume_without_a_place_keeps_its_affine(tmp_path):
    volume = Volume(np.zeros((3, 4, 5), np.uint8), AFFINES["sheared"], unit="m")
    write_volume(volume, tmp_path / "a.nrrd")
    again = read_volume(tmp_path / "a.nrrd")
    assert again.space is None and again.unit == "m" and again.key == volume.key


def test_the_real_brain(data):
    path = data / "flair_brain_124x160x140_uint8.nrrd"
    volume, image = read_volume(path), SimpleITK.ReadImage(str(path))
    np.testing.assert_array_equal(volume.voxels, SimpleITK.GetArrayFromImage(image))
    np.testing.assert_allclose(volume.affine, affine_by_itk(image), atol=1e-6)
    assert volume.space == PATIENT and 15.0 < oblique_degrees(volume.affine) < 25.0
    assert volume.shape_xyz != SHAPE
