"""A folder of tables from the command line: written, rendered, replaced, refused; and the limit of memory."""

import json
import sys

import numpy as np
import pytest

from rle_splat.cli.options import memory_size
from rle_splat.encode import folder as folder_form
from rle_splat.encode.store import read_encoded
from rle_splat.pipeline import encode_folder
from rle_splat.runtime import memory

VIEW = ("--azimuth", "80", "--size", "32")
PLAN = {"pre": (), "post": ("--depth-rule", "preintegrated", "--rays", "0")}


@pytest.fixture(autouse=True)
def few_planes(monkeypatch):
    monkeypatch.setattr(encode_folder._Chunks, "planes_at_once", lambda *_: 5)


@pytest.fixture
def encode(call, raw, raw_options, tmp_path):
    def run(*words, output="a.rle"):
        return call("encode", raw, *raw_options, "-o", tmp_path / output, "--folder", *words)

    return run


@pytest.mark.parametrize("classification", PLAN)
def test_the_picture_is_that_of_the_volume(call, encode, raw, raw_options, tmp_path, classification):
    assert encode("--classification", classification, *VIEW[:2], "--json", tmp_path / "a.json").code == 0
    plan = ("--classification", classification, *PLAN[classification], *VIEW)
    assert call("render", tmp_path / "a.rle", *plan, "-o", tmp_path / "folder.npy").code == 0
    assert call("render", raw, *raw_options, *plan, "-o", tmp_path / "memory.npy").code == 0
    there, here = np.load(tmp_path / "folder.npy"), np.load(tmp_path / "memory.npy")
    assert here[..., 3].max() > 0.5
    np.testing.assert_array_equal(there, here)
    report = json.loads((tmp_path / "a.json").read_text())
    files = [file for file in (tmp_path / "a.rle").iterdir()]
    assert report["folder"]["bytes"] == sum(file.stat().st_size for file in files) and report["folder"]["slabs"] == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.json", "a.rle", "data", "folder.npy", "memory.npy"]


def test_a_folder_says_by_itself_how_it_is_classified(call, encode, tmp_path):
    assert encode("--classification", "post").code == 0
    report = tmp_path / "r.json"
    assert call("render", tmp_path / "a.rle", *VIEW, "-o", tmp_path / "a.npy", "--json", report).code == 0
    assert json.loads(report.read_text())["plan"]["classification"] == "post"
    removed = call("render", tmp_path / "a.rle", *VIEW, "-o", tmp_path / "a.npy", "--classification", "refined")
    assert removed.code == 0 and removed.out.count("The classification 'refined' was removed; 'post' is used") == 1
    refused = call("render", tmp_path / "a.rle", *VIEW, "-o", tmp_path / "b.npy", "--classification", "pre")
    assert refused.code == 2 and "holds post-classified tables" in refused.err


def test_a_folder_is_replaced_and_other_things_are_not(call, encode, tmp_path):
    assert encode().code == 0 and encode("--record", "8").code == 0
    assert read_encoded(tmp_path / "a.rle").record == 8
    (tmp_path / "mine.rle").mkdir()
    refused = encode(output="mine.rle")
    assert refused.code == 2 and "something else has this name" in refused.err
    refused = encode(output="a.tables")
    assert refused.code == 2 and "does not have the suffix .rle" in refused.err


def test_a_full_disk(encode, tmp_path, monkeypatch):
    before = sorted(tmp_path.rglob("*"))

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(folder_form.FolderWriter, "_append", full)
    refused = encode()
    assert refused.code == 2 and "No space left on device" in refused.err and refused.err.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_an_axis_that_motion_needs_and_the_folder_does_not_hold(refused, call, encode, write_json, tmp_path):
    assert encode("--axes", "z").code == 0
    straight = np.eye(4)
    straight[:3, 3] = 9.5, 7.5, 100.0
    turned = np.array([[0, 0, 1, 100], [0, 1, 0, 7.5], [-1, 0, 0, 5.5], [0, 0, 0, 1]], float)
    camera = write_json({"matrix_world": straight.tolist(), "type": "ORTHO", "ortho_scale": 30.0}, "camera.json")
    motion = write_json([{"camera_matrix": one.tolist()} for one in (straight, turned)], "motion.json")
    words = "render", tmp_path / "a.rle", "--camera", camera, "--size", 16, "-o", tmp_path / "a.npy"
    assert "needs principal axis x" in refused(*words, "--motion", motion)
    assert not (tmp_path / "a.npy").exists()
    assert call(*words).code == 0


def test_ctrl_c_keeps_the_planes_that_are_done(encode, tmp_path, monkeypatch):
    assert encode(output="whole.rle").code == 0
    append, chunks = folder_form.FolderWriter.append, []

    def stopped(writer, planes, *more):
        if len(chunks) == 1:
            raise KeyboardInterrupt
        chunks.append(planes)
        append(writer, planes, *more)

    with monkeypatch.context() as patch:
        patch.setattr(folder_form.FolderWriter, "append", stopped)
        result = encode()
        assert result.code == 130 and "the same command goes on" in result.err and result.err.count("\n") == 1
        chunks[:] = [0]
        result = encode(output="b.rle")  # before its first chunk
        assert result.code == 130 and result.err == "Stopped; nothing was written.\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == [".a.rle.unfinished", "data", "whole.rle"]
    result = encode()
    assert "Planes up to 5 were there" in result.out
    whole, again = (
        {file.name: file.read_bytes() for file in (tmp_path / name).iterdir()} for name in ("whole.rle", "a.rle")
    )
    assert whole == again


def test_a_checksum_that_does_not_fit(call, encode, tmp_path):
    assert encode().code == 0
    records = tmp_path / "a.rle" / "across.records"
    content = bytearray(records.read_bytes())
    content[len(content) // 2] ^= 1
    records.write_bytes(content)
    refused = call("render", tmp_path / "a.rle", *VIEW, "-o", tmp_path / "a.npy")
    assert refused.code == 2 and "the checksum of across.records does not fit" in refused.err
    assert not (tmp_path / "a.npy").exists()


def test_post_needs_a_folder(call, raw, raw_options, tmp_path):
    refused = call("encode", raw, *raw_options, "-o", tmp_path / "a.rle", "--classification", "post")
    assert refused.code == 2 and "add --folder" in refused.err


def test_a_memory_limit_is_held(call, raw, raw_options, tmp_path):
    refused = call("render", raw, *raw_options, "-o", tmp_path / "a.npy", "--memory-limit", "1K")
    free = "0 bytes" if sys.platform == "linux" else "1.0 KiB"  # what the process has taken counts on Linux alone
    assert refused.code == 2 and f" {free} are free" in refused.err
    assert memory.available_bytes() > 1 << 20  # of that command alone
    refused = call("info", raw, *raw_options, "--memory-limit", "much")
    assert refused.code == 2 and "'much' is not a size such as 2GiB" in refused.err


def test_sizes():
    assert [memory_size(text) for text in ("2GiB", "1.5g", "800 MB", "3K")] == [2 << 30, 3 << 29, 800 << 20, 3072]


@pytest.fixture
def image(tmp_path):
    """An OME-Zarr image of two levels."""
    zarr = pytest.importorskip("zarr")
    values = np.full((2, 8, 9, 10), 200, np.uint8)
    group = zarr.open_group(str(tmp_path / "a.zarr"), mode="w")
    for level, data in enumerate((values[0], values[1, ::2, ::2, ::2])):
        group.create_array(str(level), data=data)
    scales = ([1.0] * 3, [2.0] * 3)
    group.attrs["ome"] = {"multiscales": [{
        "axes": [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"],
        "datasets": [{"path": str(n), "coordinateTransformations": [{"type": "scale", "scale": s}]}
                     for n, s in enumerate(scales)]}]}  # fmt: skip
    return tmp_path / "a.zarr"


def test_the_finest_level_of_a_zarr(call, image, tmp_path):
    assert call("encode", image, "-o", tmp_path / "a.rle", "--folder").code == 0
    assert read_encoded(tmp_path / "a.rle").shape_xyz == (10, 9, 8)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.rle", "a.zarr"]
    assert call("encode", image, "--level", "1", "-o", tmp_path / "b.rle", "--folder").code == 0
    assert read_encoded(tmp_path / "b.rle").shape_xyz == (5, 5, 4)


def test_voxels_that_are_cut_short_leave_nothing(refused, image, raw, raw_options, tmp_path):
    (chunk,) = (image / "0" / "c").rglob("0/0/0")
    for path, words, said in ((chunk, (image,), "damaged or cut short"), (raw, (raw, *raw_options), "bytes")):
        path.write_bytes(path.read_bytes()[:-7])
        assert said in refused("encode", *words, "-o", tmp_path / "a.rle", "--folder")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.zarr", "data"]
