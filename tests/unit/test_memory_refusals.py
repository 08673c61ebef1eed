"""Memory that work will take is said before it is taken, or refused with what would fit."""

import sys
import tracemalloc
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.comparison.decode import decode
from rle_splat.pipeline import memory_estimate as estimate
from rle_splat.pipeline import quick_estimate
from rle_splat.pipeline.encode_scene import encode_scene
from rle_splat.pipeline.render import render, render_steps
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime import memory
from rle_splat.scene import RleSplatError
from rle_splat.volume.volume import Volume
from tests.encoded import to_volume_order
from tests.unit.memory_setup import BANDED, FUNCTION, GIB, POST, QUALITY, blobs, noise, scene_of, traced


def short_of_memory(monkeypatch, free):
    """As if there were ``free`` bytes; and work on few voxels at a time, as large volumes have it."""
    # By the table of modules: the name rle_splat.encode is the facade's function.
    monkeypatch.setattr(sys.modules["rle_splat.encode.sizes"], "VOXELS_AT_ONCE", 1000)
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


@pytest.mark.parametrize(
    "share, axes, words",
    (
        (0.95, 1, "voxel records of 8 bytes would fit"),
        (0.4, 1, "a narrower transfer function"), (0.001, 1, "crop or downsample the volume"),
        (0.67, 3, "voxel records of 8 bytes would fit"),
        (0.38, 3, "one principal axis at a time with voxel records of 8 bytes would fit"),
    ),
)
def test_too_little_memory_is_refused_with_what_would_fit(share, axes, words, monkeypatch):
    scene = scene_of(noise())
    short_of_memory(monkeypatch, 0)
    needed = quick_estimate.estimate(scene.volume, FUNCTION, QUALITY, axes=axes).needed
    short_of_memory(monkeypatch, int(share * needed / estimate.SPARE))
    work = (lambda: encode_scene(scene, QUALITY)) if axes == 3 else (lambda: encode_scene(scene, QUALITY, (1,)))

    def refused():
        with pytest.raises(RleSplatError, match="are free") as problem:
            work()
        return str(problem.value)

    sentence, peak = traced(refused)
    assert words in sentence and sentence.endswith(".") and sentence.count(". ") == 0, sentence
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


def counted_in_rows(volume, shown):
    """As if each row of voxels showed so many, in pieces of five."""
    counts = np.full(volume.shape_xyz[1] * volume.shape_xyz[2], shown)
    return counts, counts // 5


def found_in_rows(volume, shown):
    return estimate.Found.in_rows(volume, counted_in_rows(volume, shown))


@pytest.mark.parametrize("share, words", ((0.6, "their neighbors counted, would fit"), (0.001, "crop or downsample")))
def test_what_is_said_to_fit_speaks_of_scalars(share, words, monkeypatch):
    """There are no voxel records to make smaller; what a narrower function leaves is counted in scalars."""
    volume = blobs()
    wanted = estimate.estimate_scalars(found_in_rows(volume, 48), 3, True, 1000)
    assert wanted.with_record(8) == wanted
    monkeypatch.setattr("rle_splat.pipeline.memory_estimate.available_bytes", lambda: int(share * wanted.needed))
    with pytest.raises(RleSplatError, match=words) as problem:
        estimate.refuse_too_much(wanted)
    assert "record" not in str(problem.value) and "shown, and their neighbors, need" in str(problem.value)


def test_the_estimate_of_scalars_counts_voxels_and_axes():
    volume = blobs()
    found = found_in_rows(volume, 10)
    one, three = (estimate.estimate_scalars(found, axes, True, 0) for axes in (1, 3))
    assert one.visible_voxels == 10 * 96 * 96 and one.records == 5 * one.visible_voxels  # a value and its light
    assert three.records == 3 * one.records and one.needed < three.needed and one.volume == volume.voxels.nbytes


def test_what_is_said_to_fit_fits(monkeypatch):
    scene = scene_of(noise())
    short_of_memory(monkeypatch, 0)
    needed = quick_estimate.estimate(scene.volume, FUNCTION, QUALITY).needed
    short_of_memory(monkeypatch, int(0.95 * needed / estimate.SPARE))
    with pytest.raises(RleSplatError, match="records of 8 bytes would fit"):
        encode_scene(scene, QUALITY, (0,))
    assert encode_scene(scene, replace(QUALITY, record=8), (0,)).axes[0].visible_voxels > 0


@pytest.mark.parametrize("picture", (0, 20_000))
@pytest.mark.parametrize("axes", (1, 3))
@pytest.mark.parametrize("dtype", (np.uint8, np.uint16, np.float32))
@pytest.mark.parametrize("classification", ("pre", "post"))
@pytest.mark.parametrize("n", (16, 64, 700))
def test_a_share_of_voxels_that_is_said_to_fit_fits(n, classification, dtype, axes, picture, monkeypatch):
    """Wherever those voxels are: here each stands alone, so that there is nothing that takes more."""
    voxels = np.broadcast_to(np.zeros((), dtype), (n, n, n))
    volume = SimpleNamespace(shape_xyz=(n, n, n), voxels=voxels)
    picture *= n  # where there is one it wants all of its axes at once

    def wanted(in_a_row, axes, record):
        counts = np.full(n * n, in_a_row)
        if classification == "post":
            found = estimate.Found.in_rows(volume, (counts, counts))
            return estimate.estimate_scalars(found, axes, True, picture)
        quality = replace(QUALITY, record=record)
        return estimate.estimate_of(volume, (counts, counts), quality, axes=axes, picture=picture)

    for short in (0.25, 0.4, 0.6):
        all_shown = wanted(n, axes, 8)
        free = short * all_shown.needed + (1.0 - short) * picture
        short_of_memory(monkeypatch, round(free / estimate.SPARE))
        with pytest.raises(RleSplatError) as problem:
            estimate.refuse_too_much(all_shown)
        sentence = str(problem.value)
        one_by_one = "one principal axis at a time" in sentence
        if "at most" not in sentence:
            fits = one_by_one and wanted(n, 1, 8).needed <= free
            assert fits or (n == 16 and "crop or downsample" in sentence)
            continue
        share = float(sentence.split("at most ")[1].split(" %")[0]) / 100.0
        needed = wanted(share * n, 1 if one_by_one else axes, 8).needed
        assert 0.85 * free < needed <= free and one_by_one == (axes == 3 and not picture)


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
    stored = encode_scene(scene, QUALITY)
    grids = [to_volume_order(decode(stored.axes[axis]), axis) for axis in range(3)]
    assert (grids[0][..., 3] > 16.0).all()
    np.testing.assert_array_equal(grids[0], grids[1])
    np.testing.assert_array_equal(grids[0], grids[2])
    assert render(scene, QUALITY).rgba[32, 32, 3] > 0.99
