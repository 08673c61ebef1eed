"""Every edit of a post-classified scene redoes only what it must, and gives the picture of a fresh start; what it takes
of memory is what was said."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.relevant import Reach
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.memory_estimate import refuse_too_much, scalar_estimate
from rle_splat.pipeline.render import render, render_steps
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.scene import Camera, Light, Quality, RleSplatError, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from tests.unit.test_memory import traced

QUALITY = Quality(classification="post", depth_rule="slice", sheet_density=0.7, warp_filter="bilinear", rays=0.05)
SUN = Light("SUN", energy=3.0, matrix_world=np.array([[1, 0, 0, 0], [0, 0.8, -0.6, 0], [0, 0.6, 0.8, 0], [0, 0, 0, 1]]))
MATT = Shade(ambient=0.2, diffuse=0.8, specular=0.0)
FUNCTION = TransferFunction(
    opacity=((80, 0.0), (120, 0.3), (150, 0.3), (170, 0.0)), color=((80, 1.0, 0.3, 0.1), (250, 0.9, 0.9, 0.8))
)


def ball(dtype=np.uint8):
    z, y, x = np.indices((24, 22, 26))
    radius = np.sqrt((x - 12.0) ** 2 + (y - 11.0) ** 2 + (z - 12.0) ** 2)
    return Volume((10.0 + 240.0 / (1.0 + np.exp(0.5 * (radius - 8.0)))).astype(dtype), np.eye(4))


BALL = ball()


def scene(azimuth=20, function=FUNCTION, lights=(), headlight=False, volume=BALL):
    camera, matrix = turntable(volume, azimuth, 10, width=40, height=40)
    return Scene(volume, function, camera, 40, 40, matrix, lights=lights, headlight=headlight)


def work_of(edited, first, quality=QUALITY):
    """Which stages the edit ran again; its picture is held against a fresh one, to the bit."""
    cache = StageCache()
    render(first, quality, cache=cache)
    before = dict(cache.made)
    picture = render(edited, quality, cache=cache).rgba
    fresh = render(edited, quality).rgba
    np.testing.assert_array_equal(picture, fresh)
    assert fresh.max() > 0.1 or edited.transfer_function is HIDING
    return {stage for stage, count in cache.made.items() if count > before.get(stage, 0)}


def shown(*points):
    return replace(FUNCTION, opacity=points)


MATT_FUNCTION = replace(FUNCTION, shade=MATT)
WIDER = shown((60, 0.0), (120, 0.3), (150, 0.3), (170, 0.0))
NARROWER = shown((100, 0.0), (120, 0.5), (140, 0.0))
STEPS = shown((90, 0.0), (90, 0.4), (131, 0.4), (131, 0.0))
SPLIT = shown((85, 0.0), (90, 0.4), (100, 0.0), (150, 0.0), (155, 0.9), (160, 0.0))
HIDING = shown((80, 0.0))
WARMER = replace(FUNCTION, color=((80, 1.0, 0.1, 0.0), (250, 1.0, 0.8, 0.2)))
LIT = dict(lights=(SUN,))
ALL_BUT_BLOCKS = {"relevant", "normals", "light", "lights", "runs", "scalars", "table", "bricks"}
EDITS = {  # edited, first, stages
    "camera, matt under a sun": (dict(azimuth=24, function=MATT_FUNCTION, **LIT), dict(function=MATT_FUNCTION, **LIT),
                                 set()),
    "camera, unshaded": (dict(azimuth=24), dict(), set()),
    "camera with a headlight": (dict(azimuth=24, headlight=True), dict(headlight=True), {"light", "lights"}),
    "light": (dict(lights=(replace(SUN, energy=1.0),)), LIT, {"light", "lights"}),
    "coloured light": (dict(lights=(replace(SUN, color=(1.0, 0.5, 0.2)),)), LIT, {"light", "lights"}),
    "light put out": (dict(), LIT, set()),
    "light lit": (LIT, dict(), {"normals", "light", "lights"}),
    "name": (dict(function=replace(FUNCTION, name="other"), **LIT), LIT, set()),
    "opacities": (dict(function=shown((80, 0.0), (110, 0.1), (170, 0.0)), **LIT), LIT, {"table"}),
    "colours": (dict(function=WARMER, **LIT), LIT, {"table"}),
    "fewer values shown": (dict(function=NARROWER, **LIT), LIT, {"table"}),
    "steps within": (dict(function=STEPS, **LIT), LIT, {"table"}),
    "two ranges within": (dict(function=SPLIT, **LIT), LIT, {"table"}),
    # Nothing is worth keeping for nothing.
    "nothing shown": (dict(function=HIDING, **LIT), LIT, ALL_BUT_BLOCKS - {"bricks"}),
    "more values shown": (dict(function=WIDER, **LIT), LIT, ALL_BUT_BLOCKS),
    "more values shown, unlit": (dict(function=WIDER), dict(), {"relevant", "runs", "scalars", "table", "bricks"}),
    "another principal axis": (dict(azimuth=70, function=MATT_FUNCTION, **LIT), dict(function=MATT_FUNCTION, **LIT),
                               {"runs", "scalars", "lights"}),
}  # fmt: skip


@pytest.mark.parametrize(("dtype", "backend"), ((np.uint8, "auto"), (np.float32, "numpy")))
@pytest.mark.parametrize("name", EDITS)
def test_an_edit_redoes_only_what_it_must(name, dtype, backend):
    edited, first, stages = EDITS[name]
    volume, quality = ball(dtype), replace(QUALITY, backend=backend)
    assert work_of(scene(volume=volume, **edited), scene(volume=volume, **first), quality) == stages


@pytest.mark.parametrize("rule", ("simpson", "preintegrated"))
@pytest.mark.parametrize("dtype", (np.uint8, np.int16, np.uint32, np.float32, np.float64))
def test_a_wider_range_that_is_kept_gives_the_same_picture(dtype, rule):
    """Voxels that are kept and do not matter leave no trace: to the bit, for every kind of values.

    Between two sheets they would, so that there each range keeps its own."""
    volume, quality = ball(dtype), replace(QUALITY, depth_rule=rule, backend="numpy")
    for function in (NARROWER, STEPS, SPLIT):
        edited = scene(function=function, volume=volume, headlight=True)
        cache = StageCache()
        render(scene(function=FUNCTION, volume=volume, headlight=True), quality, cache=cache)
        assert cache.made["relevant"] == 1
        picture, fresh = render(edited, quality, cache=cache), render(edited, quality)
        assert cache.made["relevant"] == (1 if rule == "simpson" else 2) and cache.made["table"] == 2
        more = picture.report["volume"]["visible_voxels"] - fresh.report["volume"]["visible_voxels"]
        assert more > 0 if rule == "simpson" else more == 0
        np.testing.assert_array_equal(picture.rgba, fresh.rgba)
        np.testing.assert_array_equal(picture.depth, fresh.depth)


def test_a_range_that_is_far_too_wide_is_not_used():
    """Nobody pays for ever for one look at everything."""
    x = np.broadcast_to(np.arange(320) * 0.75, (40, 48, 320))
    volume = Volume(x.astype(np.uint8), np.eye(4))
    narrow = scene(function=shown((100, 0.0), (105, 0.5), (110, 0.0)), volume=volume)
    assert "relevant" in work_of(narrow, scene(function=shown((0, 0.3)), volume=volume))
    near = scene(function=shown((95, 0.0), (105, 0.5), (115, 0.0)), volume=volume)
    assert work_of(narrow, near) == {"table"}


def test_infinite_values_are_placed_again_when_the_ends_change():
    """What stands for infinity is the function's end, so the scalars depend on it, and only then."""
    voxels = ball(np.float32).voxels.copy()
    voxels[10:14, 9:13, 10:15] = np.inf
    volume = Volume(voxels, np.eye(4))
    first = scene(volume=volume)
    longer = replace(NARROWER, opacity=(*NARROWER.opacity, (400, 0.0)))
    assert work_of(scene(function=NARROWER, volume=volume), first) == {"table"}
    assert work_of(scene(function=longer, volume=volume), first) == {"table", "scalars"}


def test_going_back_costs_nothing_and_equal_voxels_are_the_same_content():
    cache = StageCache()
    for energy in (1.0, 2.0, 1.0, 2.0):
        for function in (FUNCTION, NARROWER):
            lit = scene(function=function, lights=(replace(SUN, energy=energy),), volume=ball())
            render(lit, QUALITY, cache=cache)
    assert cache.made == {
        "blocks": 1, "relevant": 1, "normals": 1, "runs": 1, "scalars": 1, "light": 2, "lights": 2, "table": 2,
        "bricks": 1,
    }


def test_without_a_store_no_voxel_is_hashed():
    volume = ball()
    render(scene(volume=volume), QUALITY)
    assert "key" not in vars(volume)


def test_a_cancelled_job_leaves_what_is_kept_as_it_was():
    cache = StageCache()
    first = render(scene(**LIT), QUALITY, cache=cache).rgba
    before, size = cache.contents, cache.nbytes
    edited = scene(azimuth=70, function=WIDER, headlight=True)
    steps = 0
    while True:
        work = render_steps(edited, QUALITY, cache)
        messages = []
        for _ in range(steps + 1):
            messages.append(next(work).message)
        work.close()
        if messages[-1] == "Done":
            break
        assert cache.contents == before and cache.nbytes == size, messages[-1]
        steps += 1
    assert steps > 3 and {"Splatting", "Encoding", "Finding the voxels that matter"} <= set(messages)
    np.testing.assert_array_equal(render(scene(**LIT), QUALITY, cache=cache).rgba, first)


def test_a_camera_inside_lights_once():
    inside = np.eye(4)
    inside[:3, 3] = (12.3, 11.2, 12.1)
    camera = Camera(inside, type="PERSP", lens=8.0, clip_start=0.01, clip_end=100.0)
    cache = StageCache()
    render(Scene(BALL, MATT_FUNCTION, camera, 40, 40, lights=(SUN,)), QUALITY, cache=cache)
    assert cache.made["runs"] == 3 and cache.made["scalars"] == cache.made["lights"] == 2, "y and z share their records"
    assert cache.made["light"] == cache.made["relevant"] == cache.made["table"] == 1


def test_a_dragged_transfer_function_or_light_does_not_fill_the_memory():
    cache, sizes = StageCache(), []
    for step in range(20):
        wider = shown((80 - 2 * step, 0.0), *FUNCTION.opacity[1:])
        lit = scene(function=wider, lights=(replace(SUN, energy=1.0 + step),))
        render(lit, QUALITY, cache=cache)
        sizes.append(cache.nbytes)
    counts = Counter(stage for stage, _ in cache.contents)
    assert max(counts.values()) < 20 and sizes[-1] < 1.5 * sizes[len(sizes) // 2], counts


# --- memory ---------------------------------------------------------------------------------------------------


def noise(n=96, dtype=np.uint8, share=0.04):
    """Voxels of which FUNCTION shows blobs, so that cells are kept in runs."""
    values = np.random.default_rng(5).random((n // 4, n // 4, n // 8)) < share
    return Volume(np.kron(np.where(values, 130, 10), np.ones((4, 4, 8))).astype(dtype), np.eye(4))


@pytest.mark.parametrize(
    ("dtype", "size", "headlight"),
    ((np.uint8, 160, True), (np.uint8, 160, False), (np.float32, 160, False), (np.float64, 160, False),
     (np.uint8, 700, True)),
)  # fmt: skip
def test_the_estimate_of_a_picture_covers_what_it_takes(dtype, size, headlight):
    volume = noise(160, dtype)
    camera, matrix = turntable(volume, 20, 10, width=size, height=size)
    big = Scene(volume, FUNCTION, camera, size, size, matrix, headlight=headlight)
    render(big, QUALITY)  # whatever is made once
    rendering, peak = traced(lambda: render(big, QUALITY))
    needed = rendering.report["memory_estimate_bytes"]["needed"]
    assert rendering.report["volume"]["visible_voxels"] > 400_000
    # Writing a file, which is in it too, is not done here.
    assert 0.9 * peak <= needed <= 2.4 * peak, (needed, peak)


def test_too_little_memory_is_refused_before_it_is_taken(monkeypatch):
    camera, matrix = turntable(noise(), 20, 10, width=64, height=64)
    big = Scene(noise(), FUNCTION, camera, 64, 64, matrix)
    render(big, QUALITY)
    for module in ("pipeline.memory_estimate", "pipeline.stage_cache", "runtime.memory"):
        monkeypatch.setattr(f"rle_splat.{module}.available_bytes", lambda: 2 << 20)

    def refused():
        with pytest.raises(RleSplatError, match="are free") as problem:
            render(big, QUALITY)
        return str(problem.value)

    sentence, peak = traced(refused)
    assert sentence.endswith(".") and sentence.count(". ") == 0 and peak < 3 << 20


@pytest.mark.parametrize("share, words", ((0.6, "their neighbours counted, would fit"), (0.001, "crop or downsample")))
def test_what_is_said_to_fit_speaks_of_scalars(share, words, monkeypatch):
    """There are no voxel records to make smaller; what a narrower function leaves is reckoned in scalars."""
    volume = noise()
    counts = np.full(volume.shape_xyz[1] * volume.shape_xyz[2], volume.shape_xyz[0] // 2)
    wanted = scalar_estimate(volume, (counts, counts // 5), axes=3, picture=1000)
    assert wanted.with_record(4) == wanted
    monkeypatch.setattr("rle_splat.pipeline.memory_estimate.available_bytes", lambda: int(share * wanted.needed))
    with pytest.raises(RleSplatError, match=words) as problem:
        refuse_too_much(wanted)
    assert "record" not in str(problem.value) and "shown, and their neighbours, need" in str(problem.value)


def test_the_estimate_counts_voxels_and_axes():
    volume = noise()
    counts = np.full(volume.shape_xyz[1] * volume.shape_xyz[2], 10)
    one, three = (scalar_estimate(volume, (counts, counts // 5), axes=axes) for axes in (1, 3))
    assert one.visible_voxels == counts.sum() and three.records == 3 * one.records
    assert one.needed < three.needed and one.volume == volume.voxels.nbytes
    assert Reach.of(volume, FUNCTION).covers(Reach.of(volume, NARROWER))
