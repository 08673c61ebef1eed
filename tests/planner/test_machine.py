"""Proves that plans for a tolerance repeat: they depend on the scene and on a profile of the machine that is measured
once and kept, never on the times of a run; and that the frames of an animation share one as long as it serves."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from rle_splat.accuracy.planner import machine
from rle_splat.accuracy.planner import tolerance as planned
from rle_splat.accuracy.planner.candidates import KEPT_KNOBS
from rle_splat.accuracy.planner.machine import MachineProfile, profile_steps
from rle_splat.accuracy.planner.ray_cost import measured_us
from rle_splat.accuracy.planner.session import session_steps
from rle_splat.accuracy.planner.tolerance import render_within_steps
from rle_splat.accuracy.planner.tolerance_report import CHOSEN, KEPT
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline import plan_model
from rle_splat.pipeline.choose_source import choose_source
from rle_splat.pipeline.preset_plan import choose_plan
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.jit import use_reference
from rle_splat.runtime.steps import drain
from rle_splat.scene import QUALITY_PRESETS, Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from tests.lamps import LAMPS, placed

PROFILE = MachineProfile(splat=1.5, warp=0.7, cell_us=0.05, slab_us=0.02, memory=1 << 35)
COLORS = ((0.0, 0.9, 0.2, 0.1), (1.0, 1.0, 0.9, 0.4))
CLASSIFICATIONS = pytest.mark.parametrize("classification", ("pre", "post"))


def scene_of(steepness: float, size: int = 40) -> Scene:
    z, y, x = np.meshgrid(*(np.linspace(-1.0, 1.0, 24),) * 3, indexing="ij")
    field = np.clip(0.5 + steepness * (0.7 - np.sqrt(x**2 + 0.8 * y**2 + 1.2 * z**2)), 0.0, 1.0)
    volume = Volume(field.astype(np.float32), np.eye(4))
    camera, matrix = turntable(volume, 28.0, 17.0)
    function = TransferFunction(opacity=((0.2, 0.0), (0.8, 0.6)), color=COLORS)
    return Scene(volume, function, camera, size, size, matrix)


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """The cache folder, empty, and how often this machine was measured."""
    measured = []

    def measure(quality):
        measured.append(quality)
        yield from ()
        return PROFILE

    monkeypatch.setattr(machine, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(machine, "_measure_steps", measure)
    return tmp_path, measured


def test_a_machine_is_measured_once(folder):
    path, measured = folder
    for _ in range(3):
        assert drain(profile_steps(Quality(classification="post"))) == PROFILE
    assert len(measured) == 1
    for other in (Quality(classification="pre"), Quality(classification="pre", record=8)):
        drain(profile_steps(other))
    with use_reference():
        drain(profile_steps(Quality()))
    with use_reference():
        drain(profile_steps(Quality()))
    assert len(measured) == 4
    (kept,) = path.iterdir()
    assert len(json.loads(kept.read_text())) == 4


def test_a_machine_is_measured_again_for_another_calibration(folder, monkeypatch, tmp_path_factory):
    _, measured = folder
    drain(profile_steps(Quality()))
    other = tmp_path_factory.mktemp("other") / "calibration.json"
    other.write_text("{}")
    monkeypatch.setattr(plan_model, "CALIBRATION", other)
    drain(profile_steps(Quality()))
    assert len(measured) == 2


@pytest.mark.parametrize("content", ("", "[]", '{"a": 1}', "no JSON", "\x00" * 9))
def test_a_profile_that_cannot_be_read_is_measured_again(folder, content):
    path, measured = folder
    quality = Quality(classification="post")
    drain(profile_steps(quality))
    (kept,) = path.iterdir()
    known = json.loads(kept.read_text())
    kept.write_text(content)
    assert drain(profile_steps(quality)) == PROFILE and len(measured) == 2
    for damaged in ({"splat": -1.0}, {"warp": "fast"}, {"memory": None}):
        kept.write_text(json.dumps({key: {**asdict(PROFILE), **damaged} for key in known}))
        before = len(measured)
        assert drain(profile_steps(quality)) == PROFILE and len(measured) == before + 1


@pytest.mark.parametrize("path", ("/dev/null/rle_splat", "a file"))
def test_where_nothing_can_be_kept_it_is_measured_each_time(folder, monkeypatch, path, tmp_path):
    (tmp_path / "a file").write_text("")
    monkeypatch.setattr(machine, "cache_folder", lambda: tmp_path / path)
    for count in (1, 2):
        assert drain(profile_steps(Quality())) == PROFILE
        assert len(folder[1]) == count


@CLASSIFICATIONS
def test_this_machine_has_a_speed(monkeypatch, classification, way):
    monkeypatch.setattr(machine, "KERNELS", machine.NUMPY)
    profile = drain(machine._measure_steps(Quality(classification=classification)))
    assert profile.splat > 0.0 and profile.warp > 0.0 and profile.memory > 1 << 28
    assert (profile.cell_us > 0.0 and profile.slab_us > 0.0) == (classification == "post")


@CLASSIFICATIONS
def test_no_time_of_a_run_decides_over_a_plan(monkeypatch, classification):
    """Every time that was measured is multiplied by a factor of its own, from a fifth to five."""
    monkeypatch.setattr("rle_splat.accuracy.planner.session.profile_steps", always(PROFILE))
    random, times = np.random.default_rng(3), set()
    quality = Quality(classification=classification)
    session = drain(session_steps(scene_of(3.0), quality, StageCache(), 0.2))
    timed, cost = session.pilots, session.ray_cost
    for tolerance in (16.0, 4.0, 1.0, 0.5):
        found = set()
        for _ in range(6):
            session.pilots = {
                pilot: (plan, {name: ms * 5.0 ** random.uniform(-1.0, 1.0) for name, ms in stages.items()})
                for pilot, (plan, stages) in timed.items()
            }
            if cost is not None:
                us = tuple(each * 5.0 ** random.uniform(-1.0, 1.0) for each in cost.measured_us)
                session.ray_cost = replace(cost, measured_us=us)
            choice = session.choose(tolerance)
            found.add((choice.plan, choice.rays, choice.slabs))
            times.add(choice.milliseconds)
        assert len(found) == 1, tolerance
    assert len(times) == 24, "the time that users read is of this run"


@pytest.mark.parametrize("lamps", ("headlight", "two suns and a point"))
def test_three_runs_choose_the_same_plans_under_lamps(monkeypatch, lamps):
    """Each run measures its own pilots and traces its own light; presets choose theirs anew, too."""
    monkeypatch.setattr("rle_splat.accuracy.planner.session.profile_steps", always(PROFILE))
    scene, found = lit_scene_of(lamps), set()
    for _ in range(3):
        session = drain(session_steps(scene, Quality(classification="post"), StageCache(), 0.2))
        choices = [session.choose(tolerance) for tolerance in (16.0, 4.0, 1.0)]
        presets = [
            choose_plan(choose_source(scene, Quality.preset(name)), StageCache()).quality for name in QUALITY_PRESETS
        ]
        found.add((*((choice.plan, choice.rays, choice.slabs) for choice in choices), *presets))
    (chosen,) = found
    assert len(set(chosen)) == 3 + len(QUALITY_PRESETS), "each of them asks for a plan of its own"


def lit_scene_of(lamps: str) -> Scene:
    """``scene_of`` under a headlight, or under lamps that cast shadows."""
    scene = scene_of(3.0, size=24)
    function = replace(scene.transfer_function, shade=Shade())
    # The volume is one unit large, its middle the origin.
    suns = LAMPS["sun"], replace(LAMPS["sun"], matrix_world=np.eye(4), energy=1.0)
    near = replace(LAMPS["point"], matrix_world=placed(1.5, 1.0, -1.0).matrix_world, energy=60.0)
    lights = () if lamps == "headlight" else (*suns, near)
    return replace(scene, transfer_function=function, headlight=not lights, lights=lights, volume_shadows=bool(lights))


def always(profile):
    def steps(quality):
        yield from ()
        return profile

    return steps


@CLASSIFICATIONS
def test_a_frame_keeps_the_plan_of_the_one_before_while_it_serves(monkeypatch, classification):
    monkeypatch.setattr("rle_splat.accuracy.planner.session.profile_steps", always(PROFILE))
    quality, first = Quality(classification=classification), None
    plans = []
    for steepness in (6.0, 3.0, 1.5):  # ever smoother: a coarser plan would serve
        rendering = drain(render_within_steps(scene_of(steepness), 4.0, quality, probes=300, earlier=first))
        report = rendering.report
        assert report["error"]["kept"] and report["plan"]["why"] == (CHOSEN if first is None else KEPT)
        first = report["plan"]
        plans.append(tuple(first[knob] for knob in KEPT_KNOBS))
    assert len(set(plans)) == 1


def test_a_plan_that_does_not_serve_a_frame_is_replaced_by_a_finer_one(monkeypatch):
    monkeypatch.setattr("rle_splat.accuracy.planner.session.profile_steps", always(PROFILE))
    quality = Quality(classification="pre")
    smooth, steep = (scene_of(steepness) for steepness in (0.5, 12.0))
    first = drain(render_within_steps(smooth, 4.0, quality, probes=300)).report["plan"]
    alone, after = (drain(render_within_steps(steep, 4.0, quality, probes=300, earlier=plan)) for plan in (None, first))
    assert after.report["plan"]["why"] == CHOSEN
    assert [after.report["plan"][knob] for knob in KEPT_KNOBS] == [alone.report["plan"][knob] for knob in KEPT_KNOBS]
    np.testing.assert_array_equal(after.rgba, alone.rgba)


def test_the_time_of_rays_is_that_of_their_work_scaled_by_what_some_took():
    assert measured_us((5.0, 4.0, 6.0), (2.0, 0.5)) == pytest.approx((8.0, 2.0)), "the least ratio counts"


def test_the_time_that_is_told_of_rays_is_corrected_by_what_they_take(monkeypatch):
    """Before, the FLAIR brain for 1 level was told to take six seconds until it was done after three."""
    now = [10.0]
    monkeypatch.setattr(planned.time, "perf_counter", lambda: now[0])
    say, said = planned._say_rays(6200.0), []
    for now[0], share in ((10.1, 0.02), (11.5, 0.5)):
        said.append(say(share).rpartition(", ")[2])
    assert said == ["about 6 s", "about 3 s"]
