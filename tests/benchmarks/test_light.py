"""The benchmark of light's own error: what is wrong without lamps, too, is no error of light."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from benchmarks import light, walls
from benchmarks.frames import view_scene
from benchmarks.scenes import shells
from rle_splat.runtime.jit import compiled
from rle_splat.scene import Quality

pytestmark = pytest.mark.skipif(not compiled(), reason="slow without kernels")


def small(name: str):
    return view_scene(*shells(24), light.VIEW, 24, shaded=False)


def test_table_and_report(read_rows, capsys, monkeypatch):
    monkeypatch.setattr(light, "scan", small)
    words = ["--scan", "CT head", "--light", "headlight", "sun", "--quality", "standard", "strict", "--probes", "200"]
    assert light.main(words) == 0
    rows = read_rows("light")
    assert [(row["light"], row["quality"]) for row in rows] == [
        (lamps, quality) for lamps in ("headlight", "sun") for quality in ("standard", "strict")
    ]
    printed = capsys.readouterr().out
    for row in rows:
        for kind in ("own", "all"):
            assert 0.0 < row[kind]["rmse"] <= row[kind]["p99"] <= row[kind]["p999"] < 255.0
            assert f"{row[kind]['rmse']:.2f}" in printed


def test_a_missing_scan_is_named(capsys, monkeypatch):
    monkeypatch.setattr(light, "scan", lambda name: None)
    assert light.main(["--scan", "X-ray foot"]) == 0 and "X-ray foot" in capsys.readouterr().out


def test_dim_colors_are_no_error_of_light_and_dim_light_is(monkeypatch):
    scene, exact, found = small(""), light.render, []

    def dim(which, scene, quality, cache):
        made = exact(scene, quality, cache=cache)
        return replace(made, rgba=made.rgba * np.float32([0.5, 0.5, 0.5, 1.0])) if scene.headlight in which else made

    for which in ((), (False, True), (True,)):  # by whether there is a headlight
        monkeypatch.setattr(light, "render", partial(dim, which))
        (row,) = light.errors_of_light(scene, ["headlight"], {"strict": Quality.preset("strict", threads=1)}, 200)
        found.append(row)
    plain, colors, shine = found
    assert colors["own"]["rmse"] == pytest.approx(plain["own"]["rmse"], rel=1e-3)
    assert colors["all"]["rmse"] > 1.5 * plain["all"]["rmse"]
    assert shine["own"]["rmse"] > 1.5 * plain["own"]["rmse"]


@pytest.mark.parametrize("quality", ("reference", "standard"))
def test_a_thick_wall_is_lit_on_its_face_alone(quality):
    found = walls.measure(4, quality)
    assert found["lit face"] == pytest.approx(100.0, abs=0.1)
    assert found["dark face"] < 0.5 and found["vessel"] < 0.1
