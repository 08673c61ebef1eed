"""The times of stages: each moment belongs to one stage, and together they are the whole.  The clock is a fake one."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.render import render, render_steps
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.steps import SETUP, STAGES, Clock, Progress, drain, forward, step_within
from rle_splat.scene import CLASSIFICATIONS, Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from tests.ways import NUMPY


class Watch:
    """Seconds that pass by one thousandth whenever they are read, and when they are told to."""

    def __init__(self):
        self.now = 0.0

    def __call__(self) -> float:
        self.now += 1e-3
        return self.now


@pytest.fixture
def watch(monkeypatch):
    made = Watch()
    monkeypatch.setattr("rle_splat.pipeline.render.Clock", partial(Clock, made))
    return made


def scene_of(**more) -> Scene:
    volume = Volume(np.random.default_rng(3).integers(0, 255, (7, 8, 9)).astype(np.uint8), np.eye(4))
    tf = TransferFunction(opacity=((80.0, 0.0), (250.0, 0.5)), color=((0.0, 0.2, 0.5, 0.8),), shade=Shade())
    camera, matrix = turntable(volume, 25.0, 15.0)
    return Scene(volume, tf, camera, 8, 8, matrix, **more)


def test_a_stage_within_another_is_not_counted_twice():
    watch = Watch()
    clock = Clock(watch)
    with clock.stage("encode"):
        watch.now += 1.0
        with clock.stage("shade"):
            watch.now += 5.0
        watch.now += 2.0
    watch.now += 10.0
    found = clock.report()
    assert round(found["encode"]) == 3002 and round(found["shade"]) == 5001 and round(found[SETUP]) == 10002
    assert found["total"] == pytest.approx(1e3 * watch.now - 1.0)  # the clock was made after one thousandth
    assert found["total"] == pytest.approx(sum(found[stage] for stage in STAGES))


def test_a_stage_that_fails_ends():
    watch = Watch()
    clock = Clock(watch)
    with pytest.raises(ValueError):
        with clock.stage("splat"):
            raise ValueError
    watch.now += 4.0
    assert round(clock.report()[SETUP]) == 4002


def test_what_passes_between_steps_belongs_to_no_stage():
    watch = Watch()
    clock = Clock(watch)

    def steps():
        with clock.stage("warp"):
            watch.now += 3.0
            yield 0.5
            watch.now += 4.0

    def idle(step):
        watch.now += 100.0

    with clock.running():
        pass
    drain(step_within(steps(), clock.running), idle)
    assert round(clock.report()["warp"]) == 7002


@pytest.mark.parametrize("classification", CLASSIFICATIONS)
def test_the_stages_of_a_picture_add_up_to_the_call(classification, way, watch):
    quality = Quality.preset("draft", classification=classification)
    began = watch.now
    cache = StageCache()
    for _ in range(2):
        steps = []
        found = render(scene_of(), quality, steps.append, cache=cache).report["stages_ms"]
        assert set(found) == {*STAGES, "total"}
        assert found["total"] == pytest.approx(sum(found[stage] for stage in STAGES))
        # Every reading of the watch belongs to the picture, but for those at which it goes on after a step, and a few
        # before the first step and behind the report.
        outside = 1e3 * (watch.now - began) - found["total"]
        assert 0.0 <= outside <= len(steps) + 6 and found["total"] > 1.5 * outside
        assert all(found[stage] > 0.0 for stage in (SETUP, "splat", "warp", "report"))
        began = watch.now


@NUMPY
def test_who_waits_between_the_steps_of_a_picture_is_not_counted(watch, way):
    quality = Quality.preset("draft")

    def wait(step):
        watch.now += 1000.0

    found = drain(render_steps(scene_of(), quality), wait).report["stages_ms"]
    assert found["total"] < 1000.0


@NUMPY
def test_the_pictures_of_a_blur_add_up(watch, way):
    scene = scene_of()
    camera = replace(scene.camera, aperture_radius=1.0, focus_distance=5.0)
    quality = Quality.preset("draft")
    found = render(replace(scene, camera=camera), quality).report["stages_ms"]
    assert found["total"] == pytest.approx(sum(found[stage] for stage in STAGES)) and found["report"] > 3.0


def test_progress_never_runs_backwards():
    def steps():
        for fraction in (0.1, 0.4, 0.2, 0.4, 1.0, 0.9):
            yield Progress(fraction, f"at {fraction}")
        return "done"

    said = []
    assert drain(forward(steps()), said.append) == "done"
    assert [step.fraction for step in said] == [0.1, 0.4, 0.4, 0.4, 1.0, 1.0]
    assert said[2].message == "at 0.2"
