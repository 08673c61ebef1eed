"""Files and folders of earlier versions: version 0.2 encoded one small ball into all that are in ``data``, but for the
one that 0.1.0 encoded."""

import io
import json
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.encode.earlier import UNLIT, lengthen
from rle_splat.encode.store import load_encoded
from rle_splat.pipeline.render import render
from rle_splat.runtime.steps import drain
from rle_splat.scene import Quality, RleSplatError, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

DATA = Path(__file__).with_name("data")
# Name -> bytes of its records, what they become, and the largest difference to 16 bytes in levels of 1/255.
SAVED = {"16.rle": (16, 0.0), "8.rle": (8, 0.1), "6.rle": (8, 0.3), "4.rle": (8, 1.5), "folder_6.rle": (8, 0.3)}
VIEWS = {0: (90.0, 10.0), 1: (5.0, 10.0), 2: (20.0, 80.0)}  # principal axis -> azimuth, elevation


def picture(name, axis, classification="pre"):
    stored = load_encoded(DATA / name)
    camera, matrix = turntable(stored, *VIEWS[axis])
    function = None if classification == "pre" else TransferFunction.from_json(stored.transfer_function)
    scene = Scene(stored, function, camera, 24, 24, matrix, headlight=False)
    return stored, render(scene, Quality(classification=classification, record=stored.record)).rgba


@pytest.mark.parametrize("axis", VIEWS)
@pytest.mark.parametrize("name", SAVED)
def test_what_earlier_versions_saved_opens(name, axis):
    stored, rgba = picture(name, axis)
    record, levels = SAVED[name]
    assert (stored.record, stored.shape_xyz, stored.source) == (record, (9, 8, 10), "ball.raw")
    assert drain(stored.tables_steps(axis))[0].record == record
    _, best = picture("16.rle", axis)
    assert best[..., 3].max() > 0.5 and 255.0 * np.abs(rgba - best).max() <= levels


@pytest.mark.parametrize("axis", VIEWS)
def test_a_file_of_version_0_1_0_makes_the_picture_of_its_volume(axis):
    """A ball without light, which classification and encoding of today turn into the same records."""
    z, y, x = np.mgrid[:10, :8, :9]
    radius = np.sqrt(((z - 4.5) / 4.5) ** 2 + ((y - 3.5) / 3.5) ** 2 + ((x - 4.0) / 4.0) ** 2)
    ball = Volume(np.clip(255.0 * (1.25 - radius), 0.0, 255.0).astype(np.uint8), np.eye(4))
    stored, rgba = picture("0_1_0.rle", axis)
    camera, matrix = turntable(ball, *VIEWS[axis])
    function = TransferFunction.from_json(stored.transfer_function)
    today = render(Scene(ball, function, camera, 24, 24, matrix, headlight=False), Quality(classification="pre"))
    assert rgba[..., 3].max() > 0.9 and 255.0 * np.abs(rgba - today.rgba).max() < 0.01


@pytest.mark.parametrize("axis", VIEWS)
def test_normals_of_earlier_versions_are_lit_anew(axis):
    """They pointed along the gradient; light falls on the side from which the camera looks, as a headlight does."""
    stored, rgba = picture("folder_normals.rle", axis, "post")
    codes = drain(stored.tables_steps(axis))[1]["surface"]
    assert codes.shape == (stored.visible_voxels, 3) and codes.dtype == np.int16 and codes.flags.c_contiguous
    lengths = np.sqrt((codes.astype(np.float64) ** 2).sum(axis=1)) / 32767.0
    assert np.abs(lengths[lengths > 0.0] - 1.0).max() < 1e-4
    middle, shown = rgba[11:13, 11:13, :3].mean(), rgba[rgba[..., 3] > 0.9][:, :3]
    assert shown.mean() < 0.95 * middle  # the ball is darker towards its rim


@pytest.mark.parametrize("axis", VIEWS)
def test_light_of_earlier_versions_is_left_out(axis):
    stored, rgba = picture("folder_light.rle", axis, "post")
    assert stored.remarks == (UNLIT,) and not stored.holds_normals
    assert set(drain(stored.tables_steps(axis))[1]) == {"scalars"}
    assert rgba[..., 3].max() > 0.9 and rgba[..., :3].max() <= 1.0


@pytest.mark.parametrize("dtype, words, size", ((np.uint16, 3, 4), (np.uint32, 1, 2052)))
def test_scales_that_do_not_fit_are_an_error(dtype, words, size):
    stored = np.random.default_rng(1).integers(0, np.iinfo(dtype).max, (9, words), dtype)
    voxel_data, decoding = lengthen(stored, np.full(size, 2.0, np.float32))
    assert voxel_data.dtype == np.uint64 and len(voxel_data) == 9 and decoding.shape == (4,)
    for wrong in (np.ones(size - 1), np.full(size, np.nan), np.full(size, -1.0), np.full(size, 1e38)):
        with pytest.raises(ValueError, match="scales"):
            lengthen(stored, wrong)


def npy(array) -> bytes:
    file = io.BytesIO()
    np.lib.format.write_array(file, array, allow_pickle=True)
    return file.getvalue()


def claim(shape) -> bytes:
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": "<f4", "fortran_order": False, "shape": shape})
    return file.getvalue()


def refused(path, **changes):
    """The file of 16 bytes with members replaced is refused in one sentence."""
    with zipfile.ZipFile(DATA / "16.rle") as archive:
        members = {name: archive.read(name) for name in archive.namelist()} | changes
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            if content is not None:
                archive.writestr(name, content)
    with pytest.raises(RleSplatError) as problem:
        load_encoded(path)
    text = str(problem.value)
    assert text.endswith(".") and "\n" not in text and len(text) < 400


def test_lying_members_are_refused(tmp_path):
    huge, negative, pickled = claim((10**13, 4)), claim((-1, -4)), npy(np.array([{"a": 1}], dtype=object))
    lies = (huge, pickled, negative, None, b"", b"\x93NUMPY\x09\x00garbage", npy(np.zeros((3, 4), np.float32)))
    for number, lie in enumerate(lies):  # a file each: on Windows an error that is looked at keeps its file mapped
        refused(tmp_path / f"{number}.rle", **{"z_voxel_data.npy": lie})
    refused(tmp_path / "v.rle", **{"z_scanline_pointers.npy": npy(np.full((10, 8), 10**6, np.int32))})


@pytest.mark.parametrize(
    "change",
    (
        {"format": "other"},
        {"version": 1},
        {"record": 8},
        {"record": 6},
        {"record": 5},
        {"shape_xyz": [6, 4, 6]},
        {"shape_xyz": "big"},
        {"axes": ["w"]},
        {"remarks": None},
        {"unit_length": -1},
    ),
)
def test_a_lying_header_is_refused(tmp_path, change):
    with zipfile.ZipFile(DATA / "16.rle") as archive, archive.open("header.npy") as member:
        header = json.loads(np.lib.format.read_array(member).tobytes())
    content = np.frombuffer(json.dumps({**header, **change}).encode(), np.uint8)
    refused(tmp_path / "v.rle", **{"header.npy": npy(content)})


def test_a_damaged_folder_is_refused(tmp_path):
    for name in ("rows.records", "across.records"):
        folder = shutil.copytree(DATA / "folder_6.rle", tmp_path / name)
        content = (folder / name).read_bytes()
        for lie in (content[:-6], content + bytes(6), content[::-1], b""):
            (folder / name).write_bytes(lie)
            with pytest.raises(RleSplatError):
                assert load_encoded(folder).axes
        (folder / name).unlink()
        with pytest.raises(RleSplatError, match=f"Cannot read .*{name}: "):
            load_encoded(folder)
