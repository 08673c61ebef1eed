"""Proves what the measurement of plans is put together from: fronts, crops, plans that are the same, error maps."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.phantoms import blobs
from rle_splat.accuracy.metrics import LEVEL
from rle_splat.accuracy.planner import measure_plans
from rle_splat.accuracy.planner.error_map import error_map_steps
from rle_splat.accuracy.planner.measure_plans import front, steepest_window, sweep_steps
from rle_splat.accuracy.planner.plans import same_plan, sensible_plans, with_plan
from rle_splat.accuracy.truths import truth
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.runtime.steps import Progress, drain
from rle_splat.scene import Quality, RleSplatError, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

BASE = Quality()


@pytest.fixture(scope="module")
def scene():
    volume = Volume(blobs((16, 14, 12), 5), np.eye(4))
    function = TransferFunction(
        "test", None, ((0.0, 0.0), (1.0, 1.0)), ((0.0, 0.9, 0.3, 0.1), (0.4, 0.1, 0.3, 1.0)), 1.0, None
    )
    camera, matrix = turntable(volume, 35.0, 25.0, perspective=True)
    return Scene(volume, function, camera, 30, 24, matrix, headlight=False)


def entry(name, ms, error):
    return {"name": name, "frame_ms": ms, "error": {"rmse": error}}


def test_a_front_is_what_nothing_beats():
    plans = [entry("a", 10, 1.0), entry("b", 20, 0.5), entry("c", 15, 1.5), entry("d", 20, 0.4), entry("e", 90, 0.4)]
    assert front(plans) == ["a", "d"]
    assert front(plans[::-1]) == ["a", "d"] and front([]) == []


def test_plans_have_names_and_the_chosen_one_is_among_them():
    plans = sensible_plans(Quality(threads=1))
    assert len({plan.name for plan in plans}) == len(plans) and all(plan.threads == 1 for plan in plans)
    assert with_plan(plans, Quality.preset("fine", threads=2)) == (plans, "fine")
    own = replace(Quality.preset("fine"), sheet_density=1.7)
    more, name = with_plan(plans, own)
    assert name == "your fine" and more[-1].sheet_density == 1.7 and len(more) == len(plans) + 1
    assert not same_plan(own, Quality.preset("fine")) and same_plan(own, replace(own, name="other", threads=3))


def test_the_crop_is_where_the_picture_is_steepest():
    picture = np.zeros((40, 60, 4), np.float32)
    picture[25:29, 33:37] = 1.0
    window = steepest_window(picture, 8)
    assert window.shape == (8, 8)
    assert window.rows.start <= 24 < 29 <= window.rows.stop and window.columns.start <= 32 < 37 <= window.columns.stop
    assert steepest_window(picture, 500).shape == (40, 60)
    columns, rows = window.centers
    assert (columns[0], rows[0]) == (window.columns.start + 0.5, window.rows.start + 0.5) and len(columns) == 64


@pytest.mark.parametrize("step", (1, 4, 100))
def test_an_error_map_is_picture_less_truth(scene, step):
    quality = Quality.preset("draft")
    steps = error_map_steps(scene, quality, step=step)
    errors, report = drain(steps)
    true = truth(scene, report["error"]["truth"])[0].reshape(24, 30, 4)
    every = np.abs(render(scene, quality).rgba - true).max(axis=-1) / LEVEL
    first = min(step // 2, 23)
    np.testing.assert_allclose(errors, every[first::step, first::step], atol=1e-4)
    assert errors.dtype == np.float32 and every.max() > 1.0
    assert report["error"]["measured"] == pytest.approx(errors.max()) and report["error"]["probes"] == errors.size


def test_measuring_tells_how_far_it_is_and_stops_when_told(scene):
    steps = sweep_steps(scene, sensible_plans(BASE)[:2], BASE, probes=40, repeats=1)
    told = [next(steps) for _ in range(5)]
    assert all(isinstance(step, Progress) for step in told)
    steps.close()
    done = list(sweep_steps(scene, sensible_plans(BASE)[:2], BASE, probes=40, repeats=1))
    fractions = [step.fraction for step in done]
    assert fractions == sorted(fractions) and fractions[-1] == 1.0 and min(fractions) >= 0.0


def test_meshes_are_refused(scene):
    hidden = replace(scene, triangles=np.zeros((1, 3, 3)))
    for steps in (sweep_steps(hidden, sensible_plans(BASE), BASE), error_map_steps(hidden, BASE)):
        with pytest.raises(RleSplatError, match="meshes"):
            drain(steps)


def test_plans_for_tolerances_say_what_was_predicted(scene):
    """What the tolerance would choose is measured like any plan; a stricter wish has a smaller prediction."""
    base = Quality(classification="pre")
    report = drain(sweep_steps(scene, [base], base, probes=300, repeats=1, tolerances=(6.0, 1.0))).report
    wished = {entry["name"]: entry for entry in report["plans"] if entry["predicted"]}
    assert set(wished) == {"for 6 steps", "for 1 step"}
    loose, tight = wished["for 6 steps"], wished["for 1 step"]
    assert tight["predicted"]["largest"] < loose["predicted"]["largest"] <= 6.0
    assert tight["error"]["largest"] < loose["error"]["largest"] <= 6.0
    assert tight["error"]["largest"] <= 1.0 and tight["predicted"]["keeps"]
    none = drain(sweep_steps(scene, [base], replace(base, model="opacity"), probes=40, repeats=1, tolerances=(2.0,)))
    assert not any(entry["predicted"] for entry in none.report["plans"])
    assert any("tolerance" in remark for remark in none.report["remarks"])


def test_plans_for_tolerances_have_the_rays_that_keep_them(scene):
    base = Quality(classification="post", rays=0.0)
    report = drain(sweep_steps(scene, [base], base, probes=200, repeats=1, tolerances=(0.5,))).report
    strict, plain = (next(e for e in report["plans"] if bool(e["predicted"]) == wished) for wished in (True, False))
    assert strict["error"]["largest"] <= 0.5 < plain["error"]["largest"]
    assert strict["rays"]["pixels"] > 0 and plain["rays"] is None
    assert strict["frame_ms"] >= strict["rays_ms"] > 0.0 == plain["rays_ms"]


def test_wishes_that_cost_too_much_are_said_and_not_measured(scene, monkeypatch):
    base = Quality(classification="pre")
    monkeypatch.setattr(measure_plans, "LONGEST", 0.0)
    report = drain(sweep_steps(scene, [base], base, probes=40, repeats=1, tolerances=(8.0, 1e-6))).report
    assert not any(entry["predicted"] for entry in report["plans"])
    assert any("for 8 steps (" in remark for remark in report["remarks"])
    assert any("No plan" in remark and "for 1e-06 steps" in remark for remark in report["remarks"])
