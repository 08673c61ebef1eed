"""The options --tile and --memory-limit: pictures in tiles have the pixels of whole ones in every format, read back
with other readers; what cannot be made in tiles is refused; a failure leaves no file."""

import json

import numpy as np
import pytest

from rle_splat.cli.rows import TiffRows
from rle_splat.pipeline import tiles

QUICK = ["--size", "61x50", "--preset", "faint"]


def pixels(path):
    """Pixels of a picture file, by a reader that is not ours; of an EXR also its depths."""
    if path.suffix == ".npy":
        return np.load(path)
    if path.suffix == ".exr":
        OpenEXR = pytest.importorskip("OpenEXR")
        with OpenEXR.File(str(path)) as picture:
            found = picture.channels()
            return np.dstack((found["RGBA"].pixels, found["Depth.Z"].pixels)).copy()
    if path.suffix == ".tif":
        return pytest.importorskip("tifffile").imread(path)
    return np.asarray(pytest.importorskip("PIL.Image").open(path))


@pytest.mark.parametrize("background", [(), ("--background", "0.2", "0.5", "0.9")])
def test_every_format_has_the_pixels_of_the_whole_picture(raw, raw_options, call, tmp_path, background):
    pytest.importorskip("OpenEXR")
    for folder, words in (("whole", ()), ("tiles", ("--tile", "24", "--json", tmp_path / "report.json"))):
        (tmp_path / folder).mkdir()
        outputs = [word for s in ("npy", "exr", "png", "tif") for word in ("-o", tmp_path / folder / f"a.{s}")]
        result = call("render", raw, *raw_options, *QUICK, *outputs, *background, *words)
        assert result.code == 0, result.err
    for path in (tmp_path / "whole").iterdir():
        whole, tiled = pixels(path), pixels(tmp_path / "tiles" / path.name)
        assert whole.dtype == tiled.dtype and whole[..., :3].max() > 0
        np.testing.assert_array_equal(tiled, whole)
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["tiles"] == {"side": 24, "count": 9} and report["image"] == {"width": 61, "height": 50}
    assert not list((tmp_path / "tiles").glob(".*"))


def test_a_memory_limit_chooses_tiles(raw, raw_options, call, tmp_path, monkeypatch):
    words = ("render", raw, *raw_options, "--preset", "faint", "-o", tmp_path / "a.npy", "--json", tmp_path / "r.json")
    assert call(*words, "--size", "32", "--memory-limit", "4GiB").code == 0
    assert "tiles" not in json.loads((tmp_path / "r.json").read_text())
    monkeypatch.setattr(tiles, "choose_tile_side", lambda *_: 16)
    assert call(*words, "--size", "32", "--memory-limit", "4GiB").code == 0
    assert json.loads((tmp_path / "r.json").read_text())["tiles"] == {"side": 16, "count": 4}


@pytest.mark.parametrize("words, sentence", [
    (("--tile", "8"), "--tile is 8; give a whole number of pixels from 16 on"),
    (("--tile", "64", "--tolerance", "4"), "--tolerance measures the whole picture"),
])  # fmt: skip
def test_what_is_no_tile_is_refused_before_anything_is_read(refused, tmp_path, words, sentence):
    assert sentence in refused("render", tmp_path / "missing.raw", *words, "-o", tmp_path / "a.npy")
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_a_sentence_and_leaves_no_file(raw, raw_options, call, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(TiffRows, "_strip", full)
    outputs = "-o", tmp_path / "a.tif", "-o", tmp_path / "b.npy"
    result = call("render", raw, *raw_options, *QUICK, "--tile", "32", *outputs)
    names = f"{outputs[1]}, {outputs[3]}"
    said = f"No space left on device ({names}); make room there, or choose another place."
    assert result.code == 1 and result.err == f"The system reported an error: {said}\n"
    assert [path.name for path in tmp_path.iterdir()] == ["data"]


def test_a_large_tiff_has_offsets_of_64_bits(tmp_path, monkeypatch):
    tifffile = pytest.importorskip("tifffile")
    monkeypatch.setattr("rle_splat.cli.rows.CLASSIC_MOST", 0)
    rgba = np.random.default_rng(3).random((70, 5, 4), np.float32)
    rgba[..., :3] *= rgba[..., 3:]
    for name, background in (("a.tif", None), ("b.tif", (0.1, 0.2, 0.3))):
        with TiffRows(tmp_path / name, 5, 70, background) as rows:
            rows.write(rgba[:33], rgba[:33, :, 0])
            rows.write(rgba[33:], rgba[33:, :, 0])
        with tifffile.TiffFile(tmp_path / name) as file:
            assert file.is_bigtiff
            found = file.asarray()
        assert found.shape == (70, 5, 4 if background is None else 3) and found.dtype == np.uint16
        if background is None:
            np.testing.assert_array_equal(found[..., 3], np.rint(rgba[..., 3] * np.float32(65535)))
