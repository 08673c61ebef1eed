"""Which plan a quality preset takes: by the volume and the transfer function alone, and never over given knobs."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.calibrate_presets import fit
from benchmarks.lamps import under
from benchmarks.plans import BEFORE, Judge, plan_of, vessels
from rle_splat.classify.roughness import roughness
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.plan_model import CALIBRATION, PresetPlan, preset_plans
from rle_splat.pipeline.preset_plan import EQUAL_COSTS, EXPECTED_SHARE, choose, hold_plan
from rle_splat.pipeline.render import render
from rle_splat.pipeline.shadow_pass import shadow_pass_steps
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.steps import drain
from rle_splat.scene import NO_RAYS, PRESET_AIMS, PRESET_KNOBS, Light, Mist, Quality, RleSplatError, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from rle_splat.warp.steep import UNLIMITED

WHITE = ((0.0, 1.0, 1.0, 1.0),)
STEP = TransferFunction("step", None, ((0.0, 0.0), (500.0, 0.0), (500.0, 1.0)), WHITE, 1.0, None)
WALL = ((0.0, 0.0), (450.0, 0.0), (550.0, 0.9))
RAMP = TransferFunction("ramp", None, ((0.0, 0.0), (1000.0, 0.2)), WHITE, 1.0, None)


def own(name):
    return tuple(getattr(Quality.preset(name), knob) for knob in PRESET_KNOBS)


@pytest.fixture(scope="module")
def thin():
    return vessels(48)


def scene_of(volume, function, azimuth=35.0, fit=1.1, perspective=False, size=64, **fields):
    camera, matrix = turntable(volume, azimuth, 25.0, fit, perspective, 40.0)
    return Scene(volume, function, camera, size, size, matrix, **fields)


def smooth(n=24):
    axis = np.linspace(-1.0, 1.0, n)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    return Volume((1000.0 * np.exp(-2.0 * (x**2 + y**2 + z**2))).astype(np.float32), np.eye(4))


def test_a_step_is_rougher_than_a_ramp_and_thin_things_are_rougher_than_thick_ones(thin):
    ball = smooth()
    assert 0.0 < roughness(ball, RAMP) < 3.0 < roughness(ball, STEP) < roughness(thin[0], STEP)
    assert roughness(thin[0], thin[1]) == roughness(thin[0], thin[1])  # same number to the bit


def test_a_step_down_in_stored_values_is_as_rough_as_one_up(thin):
    volume = thin[0]
    mirrored = replace(volume, voxels=1000 - volume.voxels, slope=-1.0, intercept=1000.0)
    assert roughness(mirrored, STEP) == pytest.approx(roughness(volume, STEP), rel=1e-9)


def test_where_nothing_is_visible_nothing_is_known():
    ball = smooth()
    hidden = replace(STEP, opacity=((0.0, 0.0), (5000.0, 0.0), (5000.0, 1.0)))
    nan = replace(ball, voxels=np.full_like(ball.voxels, np.nan))
    for volume, function in ((ball, hidden), (nan, STEP), (replace(ball, voxels=ball.voxels[:1]), STEP)):
        assert roughness(volume, function) is None
    even = replace(ball, voxels=np.full_like(ball.voxels, 700.0))
    assert roughness(even, STEP) == 0.0


@pytest.mark.parametrize("name", ("standard", "fine", "strict"))
def test_a_preset_takes_its_usual_plan_or_one_that_errs_less(name):
    usual, costs = next(one for one in preset_plans() if one.knobs == own(name)), []
    for rough in np.geomspace(0.1, 255.0, 60):
        chosen = choose(own(name), PRESET_AIMS[name], rough, True)[1]
        costs.append(chosen.cost)
        if usual.error(rough) <= EXPECTED_SHARE * PRESET_AIMS[name]:
            assert chosen.knobs == usual.knobs
        else:
            assert chosen.error(rough) < usual.error(rough)
            cheaper = [one.error(rough) for one in preset_plans() if EQUAL_COSTS * one.cost < chosen.cost]
            allowed = EXPECTED_SHARE * PRESET_AIMS[name]
            assert min(cheaper) > allowed or chosen.error(rough) > allowed
    assert costs[0] == usual.cost < costs[-1] and all(one <= other for one, other in pairwise(costs))


def test_a_calibration_writes_what_it_reads():
    assert [plan.report() for plan in preset_plans()] == json.loads(CALIBRATION.read_text())["presets"]


def test_a_calibration_finds_the_constants_of_the_errors():
    rough, costs = np.geomspace(3.0, 100.0, 9), np.arange(1.0, 1.0 + len(preset_plans()))
    errors = [[plan.factor * value**plan.power for plan in preset_plans()] for value in rough]
    for found, plan, cost in zip(fit(rough, errors, costs), preset_plans(), costs, strict=True):
        assert found == replace(plan, cost=cost)


def test_of_plans_that_cost_the_same_the_most_accurate_is_taken(monkeypatch):
    usual = PresetPlan(own("standard"), 1.0, 100.0, 1.0)
    some = [PresetPlan(("slice", density, "cubic", 1 / 1024, NO_RAYS), cost, error, 1.0)
            for density, cost, error in ((1.0, 2.0, 9.0), (1.5, 2.0 * EQUAL_COSTS, 7.0), (2.0, 2.3, 1.0))]  # fmt: skip
    monkeypatch.setattr("rle_splat.pipeline.preset_plan.preset_plans", lambda: (usual, *some))
    assert choose(own("standard"), 25.0, 1.0, True) == (usual, some[1])
    assert choose(own("standard"), 12.5, 1.0, True) == (usual, some[2])


def test_without_single_rays_no_plan_has_any_but_the_presets_own():
    for name in ("standard", "fine", "strict"):
        for rough in np.geomspace(0.1, 255.0, 20):
            chosen = choose(own(name), PRESET_AIMS[name], rough, False)[1]
            assert chosen.rays == NO_RAYS or chosen.knobs == own(name)
    assert choose(own("standard"), 80.0, 80.0, False)[1].knobs != own("standard")


def test_thin_vessels_get_rays_wherever_something_is_seen(thin):
    scene, cache = scene_of(*thin), StageCache()
    judge = Judge(scene, 4000)
    rendering = render(scene, Quality.preset("strict", threads=1), cache=cache)
    before = judge.errors(render(scene, plan_of(BEFORE["strict"]), cache=cache).rgba)
    after = judge.errors(rendering.rgba)
    assert after["p999"] < 10.0 < 0.5 * before["p999"] and after["rmse"] < 0.5 * before["rmse"]
    plan = rendering.report["plan"]
    assert plan["rays"] == UNLIMITED and plan["quality"] == "strict" and plan["aim"] == 25.0 >= 2.5 * plan["expected"]
    assert "in 8-bit steps, of at most 25 in 99.9% of pixels" in plan["why"]
    assert "exact pixels wherever something is seen" in plan["why"]


@pytest.mark.parametrize("lamps", ("headlight", "sun", "three lamps"))
def test_presets_keep_their_aims_under_lamps(lamps):
    """A ball with a wall of a tenth of its values and one with a step, on whose rim a draft errs more."""
    for opacity, names in ((WALL, PRESET_AIMS), (STEP.opacity, ("standard", "fine", "strict"))):
        scene = under(scene_of(smooth(32), replace(STEP, opacity=opacity, shade=Shade()), size=96), lamps)
        judge = Judge(scene, 4000)
        for name in names:
            rendering = render(scene, Quality.preset(name, threads=1))
            assert judge.errors(rendering.rgba)["p999"] < rendering.report["plan"]["aim"] == PRESET_AIMS[name]


def test_the_plan_is_that_of_the_volume_and_the_transfer_function_and_looked_for_once(thin):
    cache, plans = StageCache(), []
    for fields in (dict(), dict(azimuth=-120.0, perspective=True), dict(fit=0.3)):
        plan = render(scene_of(*thin, **fields), Quality(threads=1), cache=cache).report["plan"]
        plans.append([plan[key] for key in (*PRESET_KNOBS, "why")])
    assert plans[0] == plans[1] == plans[2] and cache.made["roughness"] == 1
    render(scene_of(thin[0], RAMP), Quality(threads=1), cache=cache)
    assert cache.made["roughness"] == 2


def test_given_knobs_win(thin):
    scene, cache = scene_of(*thin, size=24), StageCache()
    for quality in (
        Quality(depth_rule="slice"), Quality.preset("fine", rays=0.0), Quality(name="mine"), Quality.preset("draft"),
        replace(Quality(), sheet_density=0.8), Quality.preset("standard", classification="pre"),
    ):  # fmt: skip
        plan = render(scene, quality, cache=cache).report["plan"]
        assert [plan[knob] for knob in PRESET_KNOBS] == [getattr(quality, knob) for knob in PRESET_KNOBS]
        assert plan["expected"] is None and plan["why"]
    assert "roughness" not in cache.made


def test_scenes_that_cannot_be_traced_get_finer_sheets(thin):
    volume, function = thin
    scene = scene_of(volume, function, size=24)
    plan = render(replace(scene, mist=Mist(10.0, 200.0)), Quality()).report["plan"]
    assert plan["rays"] == NO_RAYS and plan["depth_rule"] != Quality().depth_rule
    assert render(replace(scene, mode="mip"), Quality()).report["plan"]["expected"] is None


def test_an_animation_keeps_the_plan_of_its_first_frame(thin):
    volume, function = thin
    cache = StageCache()
    first = render(scene_of(volume, function, size=24), Quality(), cache=cache).report["plan"]
    kept = hold_plan(Quality(), first)
    later = render(scene_of(volume, RAMP, size=24), kept, cache=cache).report["plan"]
    assert [later[knob] for knob in PRESET_KNOBS] == [first[knob] for knob in PRESET_KNOBS]
    assert "first frame" in later["why"] and cache.made["roughness"] == 1
    unplanned = render(scene_of(volume, RAMP, size=24), Quality.preset("draft"), cache=cache).report["plan"]
    assert hold_plan(Quality.preset("draft"), unplanned) == Quality.preset("draft")


def test_a_shadow_pass_has_no_single_rays(thin):
    volume, function = thin
    sun = Light("SUN", energy=3.0, matrix_world=np.eye(4))
    scene = scene_of(volume, function, size=24, lights=(sun,), volume_shadows=True)
    rendering, taken = drain(shadow_pass_steps(scene, Quality(threads=1)))
    assert rendering.report["rays"]["pixels"] > 0 and taken.shape == (24, 24) and np.isfinite(taken).all()


def test_a_preset_can_be_named():
    z, y, x = np.mgrid[:12, :12, :12] - 5.5
    volume = Volume(np.clip(60.0 * (6.0 - np.sqrt(x * x + y * y + z * z)), 0, 1000).astype(np.uint16), np.eye(4))
    camera, matrix = turntable(volume)
    scene = Scene(volume, RAMP, camera, 24, 24, volume_matrix=matrix)
    named, given = render(scene, "draft"), render(scene, Quality.preset("draft"))
    assert np.array_equal(named.rgba, given.rgba) and named.report["plan"] == given.report["plan"]
    with pytest.raises(RleSplatError, match="There is no quality 'best'"):
        render(scene, "best")
    with pytest.raises(RleSplatError, match="must be a Quality or the name of one"):
        render(scene, 3)


@pytest.mark.parametrize("classification", ["pre", "post"])
@pytest.mark.parametrize("name", list(PRESET_AIMS))
def test_a_quality_with_the_name_of_a_preset_has_its_settings(name, classification):
    quality = Quality(name=name, classification=classification)
    assert quality == Quality.preset(name, classification) and quality.is_preset
