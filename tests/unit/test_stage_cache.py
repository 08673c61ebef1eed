"""The stage cache: content keys, eviction by bytes, and jobs that are all or nothing."""

import importlib

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import MOST_RESULTS, StageCache
from rle_splat.scene import Quality, RleSplatError, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume


def keep(cache, stage, key, result, size=10):
    job = cache.job()
    got = job.get(stage, key, lambda: result, lambda r: size)
    job.keep()
    return got


def test_a_result_is_made_once_per_content():
    cache = StageCache()
    first = keep(cache, "stage", ("a", 1), [1])
    again = keep(cache, "stage", ("a", 1), [2])
    other = keep(cache, "stage", ("a", 2), [3])
    assert first is again and other == [3] and cache.made == {"stage": 2} and cache.nbytes == 20


def test_the_least_recently_used_leaves_first():
    cache = StageCache(most_bytes=25)
    for name in "abac":
        keep(cache, "s", name, name)
    assert cache.has("s", "a") and cache.has("s", "c") and not cache.has("s", "b") and cache.nbytes == 20


def test_of_what_replaces_one_another_a_few_are_kept():
    cache = StageCache()
    keep(cache, "other", 0, "stays")
    for number in range(10):
        keep(cache, "records", number, number)
    most = MOST_RESULTS["records"]
    assert cache.contents == (("other", 0), *(("records", n) for n in range(10 - most, 10)))


@pytest.mark.parametrize("frames, stays", [(9, True), (1, False)])
def test_a_loop_makes_the_frames_of_a_volume_in_time_once(frames, stays):
    """Other volumes replace one another, as those of a simulation that is edited."""
    values = np.random.default_rng(0).integers(0, 255, (9, 8, 9, 10)).astype(np.uint8)
    shown = TransferFunction(opacity=((80, 0.0), (250, 0.6)), color=((0, 1, 1, 1),))
    cache, made = StageCache(), []
    for voxels in (*values, *values):
        volume = Volume(voxels, np.eye(4), frames=frames)
        camera, matrix = turntable(volume, 20, 10)
        render(Scene(volume, shown, camera, 12, 12, matrix), Quality.preset("draft"), cache=cache)
        made.append(dict(cache.made))
    assert made[8]["scalars"] == 9 > MOST_RESULTS["scalars"]
    assert (made[-1] == made[8]) is stays


def test_a_store_without_room_keeps_nothing():
    cache = StageCache(0)
    keep(cache, "s", "a", "a")
    assert cache.contents == () and not cache.keeps


def test_a_job_that_fails_or_is_dropped_leaves_all_as_it_was():
    cache = StageCache()
    keep(cache, "s", "old", "old")
    keep(cache, "s", "older", "older")
    before = cache.contents
    job = cache.job()
    assert job.get("s", "old", lambda: "never", lambda r: 1) == "old"
    assert job.get("s", "new", lambda: "new", lambda r: 1) == "new"
    assert job.get("s", "new", lambda: "never", lambda r: 1) == "new"
    with pytest.raises(ZeroDivisionError):
        job.get("s", "x", lambda: 1 / 0, lambda r: 1)
    assert cache.contents == before and cache.nbytes == 20


def test_steps_that_are_closed_half_way_leave_nothing():
    cache = StageCache()

    def work():
        yield 0.5
        return "whole"

    job = cache.job()
    steps = job.steps("s", "a", work, lambda r: 1)
    assert next(steps) == 0.5
    steps.close()
    assert cache.contents == () and cache.made == {}
    steps = job.steps("s", "a", work, lambda r: 1)
    assert list(steps) == [0.5]
    job.keep()
    assert cache.has("s", "a") and cache.made == {"s": 1}


def test_what_a_job_has_found_stays_at_hand_whatever_becomes_of_the_store():
    """Another thread's picture may empty a store, or fill it, between any two steps of a job."""
    cache = StageCache()
    keep(cache, "s", "one", "first")
    keep(cache, "s", "two", "second")
    job = cache.job()
    assert job.has("s", "one")

    def serves(key, result):
        cache.clear()
        keep(cache, "s", "three", "third")
        return key == "two"

    assert job.latest("s", serves) == "two"
    assert (job.get("s", "one", None), job.get("s", "two", None)) == ("first", "second")
    job.keep()
    assert cache.contents == (("s", "three"), ("s", "one"), ("s", "two")) and cache.nbytes == 30


@pytest.mark.parametrize("stage", ["choose_plan", "begin_picture"])
def test_memory_that_runs_out_at_any_stage_is_a_sentence(monkeypatch, stage):
    volume = Volume(np.random.default_rng(0).integers(0, 255, (9, 10, 11)).astype(np.uint8), np.eye(4))
    camera, matrix = turntable(volume, 20, 10)
    shown = TransferFunction(opacity=((80, 0.0), (250, 0.6)), color=((0, 1, 1, 1),))
    scene = Scene(volume, shown, camera, 12, 12, matrix)

    def run_out(*_):
        raise MemoryError("8 TiB")

    monkeypatch.setattr(importlib.import_module("rle_splat.pipeline.render"), stage, run_out)
    with pytest.raises(RleSplatError, match=r"Memory ran out half-way through the picture \(8 TiB\)"):
        render(scene, Quality.preset("draft"))
