"""``rle-splat accuracy``: its errors are those of the pictures that ``render`` makes, its front is one, and what it
cannot measure or draw it says in a sentence."""

from __future__ import annotations

import json

import numpy as np
import pytest

import rle_splat
from rle_splat.accuracy.lighting import shading_of
from rle_splat.accuracy.metrics import difference
from rle_splat.accuracy.planner.table import TRUTH_TEXTS
from rle_splat.accuracy.truths import truth

SIZE = ("--size", "40", "30")
VIEW = ("--azimuth", "35", "--elevation", "-20")


@pytest.fixture
def words(raw, raw_options, function_file):
    function = ("--transfer-function", function_file, *SIZE, *VIEW)
    return ("accuracy", raw, *raw_options, *function, "--repeats", "1")


@pytest.fixture
def measured(call, words, tmp_path):
    def run(*extra):
        result = call(*words, "--json", tmp_path / "a.json", *extra)
        assert result.code == 0 and result.err == "", result
        return json.loads((tmp_path / "a.json").read_text()), result.out

    return run


@pytest.mark.slow
def test_errors_are_those_of_the_picture(measured, raw, shape_xyz, function_file, tmp_path):
    """All pixels probed: the table's numbers are the whole picture's, in light, against the truth that is named."""
    report, out = measured("--probes", str(4 * 40 * 30), "-o", tmp_path / "p.npy")
    entry = next(plan for plan in report["plans"] if plan["chosen"])
    assert entry["name"] == report["chosen"] == "standard" and f">{entry['name']}" in out
    volume = rle_splat.read_volume(raw, shape=shape_xyz, dtype="uint8")
    camera, matrix = rle_splat.turntable(volume, 35.0, -20.0)
    function = rle_splat.TransferFunction.from_json(function_file)
    scene = rle_splat.Scene(volume, function, camera, 40, 30, volume_matrix=matrix)
    rendering = rle_splat.render(scene, rle_splat.Quality.preset("standard"))
    assert np.array_equal(np.load(tmp_path / "p.npy"), rendering.rgba)
    name = rendering.report["error"]["truth"]
    true = truth(scene, name, **shading_of(scene, name))[0].reshape(30, 40, 4)
    expected = difference(rendering.rgba, true)
    assert entry["truth"] == name and f"Against {TRUTH_TEXTS[name]}:" in out and expected.rmse > 0.01
    for key in ("rmse", "largest", "p999", "bias", "psnr"):
        assert entry["error"][key] == pytest.approx(getattr(expected, key), rel=1e-3, abs=1e-4), key
    left, top, right, bottom = report["crop"]
    crop = difference(rendering.rgba[top:bottom, left:right], true[top:bottom, left:right])
    assert entry["error"]["crop"]["rmse"] == pytest.approx(crop.rmse, rel=1e-3)
    assert 0.9 < entry["error"]["crop"]["ssim"] <= 1.0


def test_the_front_is_one_and_truths_are_not_mixed(measured):
    report, out = measured("--probes", "300", "--front", "largest")
    assert {plan["truth"] for plan in report["plans"]} == set(report["fronts"]) == set(report["truths"])
    assert len({plan["name"] for plan in report["plans"]}) == len(report["plans"]) >= 6
    for plan in report["plans"]:
        assert 0.0 < plan["error"]["rmse"] <= plan["error"]["largest"] and plan["frame_ms"] > 0.0
        rivals = [other for other in report["plans"] if other["truth"] == plan["truth"] and other is not plan]
        beaten = any(
            other["frame_ms"] <= plan["frame_ms"] and other["error"]["largest"] <= plan["error"]["largest"]
            for other in rivals
        )
        assert plan["on_front"] == (not beaten) == (plan["name"] in report["fronts"][plan["truth"]])
        assert (plan["as_ray_caster"] is None) == (plan["truth"] == "T2")
        assert f"{'*' if plan['on_front'] else ' '}{'>' if plan['chosen'] else ' '}{plan['name']}" in out
    errors = {plan["name"]: plan["error"]["rmse"] for plan in report["plans"]}
    assert errors["strict"] < 0.3 * errors["draft"]


def test_knobs_of_ones_own_are_measured_beside(measured):
    report, _ = measured("--probes", "100", "--sheet-density", "1.3", "--depth-rule", "midpoint-3")
    entry = next(plan for plan in report["plans"] if plan["chosen"])
    assert entry["name"] == report["chosen"] == "custom" and entry["knobs"]["sheet_density"] == 1.3
    assert len(report["plans"]) > 6


@pytest.mark.parametrize(
    ("extra", "said"),
    [
        (("--probes", "0"), "above zero"),
        (("--repeats", "-1"), "above zero"),
        (("--front", "nice"), "rmse"),
        (("--json", "missing/a.json"), "missing"),
        (("--quality", "standard", "--paper"), "contradict"),
    ],
)
def test_bad_input(refused, words, extra, said):
    assert said in refused(*words, *extra)


def test_tables_have_no_truth(call, refused, words, raw, raw_options, function_file, tmp_path):
    encoded = tmp_path / "ball.rle"
    function = "--transfer-function", function_file
    assert call("encode", raw, *raw_options, *function, "-o", encoded).code == 0
    assert "voxels" in refused("accuracy", encoded, *SIZE).lower()
