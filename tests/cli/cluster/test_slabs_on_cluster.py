"""A folder of tables drawn in slabs on a cluster: the picture of one machine but for rounding, the same bits for any
number of workers."""

import json

import numpy as np
import pytest

from rle_splat.pipeline import encode_folder

VIEWS = {
    "along x": ("--azimuth", "80"), "along y": (), "along z": ("--elevation", "70"),
    "perspective": ("--azimuth", "40", "--elevation", "30", "--perspective"),
}  # fmt: skip


@pytest.fixture
def folder(call, raw, raw_options, tmp_path, monkeypatch):
    """A folder of tables in slabs of three planes."""
    monkeypatch.setattr(encode_folder._Chunks, "planes_at_once", lambda *_: 3)
    assert call("encode", raw, *raw_options, "-o", tmp_path / "a.rle", "--folder").code == 0
    return tmp_path / "a.rle"


@pytest.fixture
def render(call, folder, tmp_path):
    """``render("a.npy", ...)`` -> the report."""

    def run(name, *words):
        path, report = tmp_path / name, tmp_path / "report.json"
        size = "--size", "60x48", "--termination", "0"
        result = call("render", folder, *size, "-o", path, "--json", report, *words)
        assert result.code == 0, result.err
        return json.loads(report.read_text())

    return run


@pytest.mark.parametrize("view", VIEWS)
def test_slabs_are_the_picture_of_one_machine(render, addresses, tmp_path, view):
    render("whole.npy", *VIEWS[view])
    whole = np.load(tmp_path / "whole.npy")
    assert whole[..., 3].max() > 0.3
    pictures = []
    for workers in (1, 2, 4) if view == "perspective" else (2,):
        report = render("a.npy", *VIEWS[view], "--dask", addresses[workers], "--slabs", "3", "--tile", "32")
        assert (report["workers"], report["slabs"], report["tiles"]["count"]) == (workers, 3, 4)
        pictures.append(np.load(tmp_path / "a.npy"))
    assert np.abs(pictures[0] - whole).max() < 1e-6
    for other in pictures[1:]:
        np.testing.assert_array_equal(other, pictures[0])


def test_an_exr_has_no_depths(render, address, tmp_path):
    openexr = pytest.importorskip("OpenEXR")
    report = render("a.exr", "--dask", address, "--slabs", "2")
    with openexr.File(str(tmp_path / "a.exr")) as picture:
        assert set(picture.channels()) == {"RGBA"}
    assert report["volume"]["visible_voxels"] > 0 and report["stages_ms"]["splat"] > 0.0


def test_a_damaged_part_is_told(call, folder, address, tmp_path):
    records = folder / "rows.records"
    records.write_bytes(records.read_bytes()[:-8] + bytes(8))
    words = "--size", "40", "--elevation", "70", "--dask", address, "--slabs", "3"
    refused = call("render", folder, *words, "-o", tmp_path / "a.npy")
    assert refused.code == 2 and "the checksum of rows.records does not fit" in refused.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.rle", "data"]
