"""The option --crop: a part of the picture, written as it is in the whole; what is no crop gives a clear error."""

import json

import numpy as np
import pytest


@pytest.mark.parametrize("suffix", ["raw", "rle"])
def test_a_crop_is_a_part_of_the_picture(call, raw, raw_options, tmp_path, suffix):
    words = [raw, *raw_options]
    if suffix == "rle":
        words = [tmp_path / "ball.rle"]
        assert call("encode", raw, *raw_options, "-o", words[0]).code == 0
    whole, part, report = (tmp_path / name for name in ("whole.npy", "part.npy", "part.json"))
    render = ("render", *words, "--size", "60x50")
    assert call(*render, "-o", whole).code == 0
    result = call(*render, "--crop", "11", "7", "41", "30", "-o", part, "--json", report)
    assert result.code == 0 and "30 x 23" in result.out
    np.testing.assert_array_equal(np.load(part), np.load(whole)[7:30, 11:41])
    assert np.load(part)[..., 3].max() > 0.3
    assert json.loads(report.read_text())["image"] == {
        "width": 30, "height": 23, "full_width": 60, "full_height": 50, "crop": [11, 7, 41, 30],
    }  # fmt: skip


@pytest.mark.parametrize("crop", ["0 0 0 5", "5 0 4 9", "-1 0 5 5", "0 0 61 5", "0 0 5 51"])
def test_what_is_no_crop_is_refused_before_anything_is_read(refused, tmp_path, crop):
    sentence = refused(
        "render", tmp_path / "missing.raw", "--size", "60x50", "--crop", *crop.split(), "-o", tmp_path / "x.npy"
    )
    assert "right <= 60" in sentence and "bottom <= 50" in sentence


def test_a_crop_is_four_whole_numbers(refused, tmp_path):
    for crop in ("1 2 3", "1 2 3 x", "0.5 0 3 3"):
        refused("render", tmp_path / "missing.raw", "--crop", *crop.split(), "-o", tmp_path / "x.npy")


def test_midpoint_m_takes_any_m_from_1_to_64(call, refused, raw, raw_options, tmp_path):
    words = ("render", raw, *raw_options, "--size", "12", "-o", tmp_path / "x.npy", "--depth-rule")
    assert call(*words, "midpoint-3").code == 0
    for rule in ("midpoint-0", "midpoint-x", "midpoint-65"):
        assert "from 1 to 64" in refused(*words, rule)
