"""Memory that work will take is said before it is taken, or refused with what to do."""

import re
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.comparison.ours import decode
from rle_splat.pipeline import memory_estimate as estimate
from rle_splat.pipeline import quick_estimate
from rle_splat.pipeline.encode_scene import encode
from rle_splat.pipeline.memory_estimate import PlannedTables
from rle_splat.pipeline.render import render, render_steps
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime import memory
from rle_splat.scene import RECORDS, RleSplatError
from rle_splat.volume.volume import Volume
from tests.encoded import to_volume_order
from tests.unit.memory_setup import BANDED, FUNCTION, GIB, POST, QUALITY, blobs, noise, scene_of, traced


def short_of_memory(monkeypatch, free):
    """As if there were ``free`` bytes; and work on few voxels at a time, as large volumes have it."""
    monkeypatch.setattr(estimate, "RECORDS_AT_ONCE", 1000)
    for module in ("pipeline.memory_estimate", "pipeline.stage_cache", "runtime.memory"):
        monkeypatch.setattr(f"rle_splat.{module}.available_bytes", lambda: free)


def test_it_is_said_before_the_lists_are_made_and_while_they_are():
    """And in the words of the report, before anything that it speaks of is taken."""
    work, messages, held = render_steps(scene_of(noise()), QUALITY), [], None
    render(scene_of(noise(16)), QUALITY)  # whatever is made once
    tracemalloc.start()
    try:
        while True:
            messages.append(next(work).message)
            if held is None and " in all" in messages[-1]:
                held = tracemalloc.get_traced_memory()[0]
    except StopIteration as finished:
        report = finished.value.report
    finally:
        tracemalloc.stop()
    needed, kept = report["memory_estimate_bytes"]["needed"], report["volume"]["visible_voxels"]
    told = f"Classifying {kept} voxels, about {memory.bytes_text(needed)} in all"
    said = [n for n, message in enumerate(messages) if message == told]
    assert len(said) > 1, "only for a moment"
    assert messages.index("Counting") < said[0] and said[-1] < messages.index("Encoding")
    assert held < 0.1 * needed


@pytest.mark.parametrize("share", (0.95, 0.001))
@pytest.mark.parametrize("axes", (1, 3))
def test_too_little_memory_is_refused_with_what_to_do(share, axes, monkeypatch):
    scene = scene_of(noise())
    short_of_memory(monkeypatch, 0)
    needed = quick_estimate.estimate_memory(scene.volume, FUNCTION, QUALITY, axes=axes).needed
    short_of_memory(monkeypatch, int(share * needed / estimate.SPARE))
    one_by_one = "encode one principal axis at a time, " if axes == 3 else ""
    work = (lambda: encode(scene, QUALITY)) if axes == 3 else (lambda: encode(scene, QUALITY, (1,)))

    def refused():
        with pytest.raises(RleSplatError, match="are free") as problem:
            work()
        return str(problem.value)

    sentence, peak = traced(refused)
    assert re.fullmatch(
        rf"The \d+ voxels that the transfer function shows need about \S+ \w+ of memory and \S+ \w+ are free; to need "
        rf"less, use voxel records of {RECORDS[-1]} bytes, {one_by_one}narrow the transfer function, or write a "
        r"coarser file with rle-splat convert --level 1\.", sentence,
    ), sentence  # fmt: skip
    assert peak < 0.2 * needed  # nothing was taken yet


def test_too_little_memory_for_scalars_is_refused_before_it_is_taken(monkeypatch):
    scene = scene_of(blobs(), function=BANDED)
    render(scene, POST)  # whatever is made once
    short_of_memory(monkeypatch, 2 << 20)

    def refused():
        with pytest.raises(RleSplatError, match="are free") as problem:
            render(scene, POST)
        return str(problem.value)

    sentence, peak = traced(refused)
    assert sentence.endswith(".") and sentence.count(". ") == 0 and peak < 3 << 20


def found_in_rows(volume, shown):
    """As if each row of voxels showed so many, in pieces of five."""
    counts = np.full(volume.shape_xyz[1] * volume.shape_xyz[2], shown)
    return estimate.VoxelCount.in_rows(volume, (counts, counts // 5))


def test_a_refusal_of_scalars_speaks_of_neighbors_and_not_of_records(monkeypatch):
    wanted = estimate.estimate_tables(found_in_rows(blobs(), 48), PlannedTables(axes=3), 1000)
    monkeypatch.setattr("rle_splat.pipeline.memory_estimate.available_bytes", lambda: wanted.needed // 2)
    with pytest.raises(RleSplatError, match=r"shown, and their neighbors, need .* less, narrow the") as problem:
        estimate.refuse_too_much(wanted)
    assert "record" not in str(problem.value) and "axis" not in str(problem.value)


def test_the_estimate_of_scalars_counts_voxels_and_axes():
    volume = blobs()
    found = found_in_rows(volume, 10)
    one, three = (estimate.estimate_tables(found, PlannedTables(axes=axes)) for axes in (1, 3))
    assert one.visible_voxels == 10 * 96 * 96 and one.records == 7 * one.visible_voxels  # a value and its normal
    assert three.records == 3 * one.records and one.needed < three.needed and one.volume == volume.voxels.nbytes


def test_another_light_is_refused_too_when_it_no_longer_fits(monkeypatch):
    cache, scene = StageCache(), scene_of(noise(), headlight=False)
    render(scene, QUALITY, cache=cache)
    short_of_memory(monkeypatch, 3 << 20)
    with pytest.raises(RleSplatError, match="are free"):
        render(replace(scene, headlight=True), QUALITY, cache=cache)


def test_a_picture_too_large_is_refused_at_once(monkeypatch):
    scene = scene_of(noise(16))
    short_of_memory(monkeypatch, 8 * GIB)
    with pytest.raises(RleSplatError, match=r"65536 x 65536 pixels needs about .* GiB") as problem:
        render(replace(scene, width=65536, height=65536), QUALITY)
    fits = int(str(problem.value).split(" pixels would fit")[0].split()[-1])
    assert 5000 < fits < 20000


def test_what_is_kept_makes_room(monkeypatch):
    cache, scene = StageCache(), scene_of(noise())
    picture = render(scene, QUALITY, cache=cache).rgba
    assert cache.nbytes > 0
    cache.make_room(cache.nbytes)
    assert cache.nbytes > 0  # there is enough
    short_of_memory(monkeypatch, 100)
    cache.make_room(1000)
    assert cache.nbytes == 0 and cache.contents == ()
    monkeypatch.undo()
    np.testing.assert_array_equal(render(scene, QUALITY, cache=cache).rgba, picture)


def test_solid_noise_keeps_working():
    """Every voxel opaque and colored by itself: no run to skip, nothing alike."""
    values = np.random.default_rng(1).integers(0, 256, (20, 22, 24)).astype(np.uint8)
    function = TransferFunction(opacity=((0, 1.0),), color=((0, 0, 0, 1), (255, 1, 1, 0)), shade=None)
    scene = scene_of(Volume(values, np.eye(4)), function=function)
    stored = encode(scene, QUALITY)
    grids = [to_volume_order(decode(stored.axes[axis]), axis) for axis in range(3)]
    assert (grids[0][..., 3] > 16.0).all()
    np.testing.assert_array_equal(grids[0], grids[1])
    np.testing.assert_array_equal(grids[0], grids[2])
    assert render(scene, QUALITY).rgba[32, 32, 3] > 0.99
