"""Every edit redoes only what it must, and gives the picture that a fresh start gives, however it is classified."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline import scan_source
from rle_splat.pipeline.encode_scene import encode
from rle_splat.pipeline.render import render, render_steps
from rle_splat.pipeline.stage_cache import MOST_RESULTS, StageCache
from rle_splat.scene import Camera, Light, Quality, Scene
from rle_splat.shade.shading import light_records
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from tests.ways import NUMPY

PRE = Quality.preset("draft", classification="pre")
POST = Quality(classification="post", depth_rule="slice", sheet_density=0.7, warp_filter="bilinear", rays=0.05)
QUALITIES = {"pre": PRE, "post": POST}
SUN = Light("SUN", energy=3.0, matrix_world=np.array([[1, 0, 0, 0], [0, 0.8, -0.6, 0], [0, 0.6, 0.8, 0], [0, 0, 0, 1]]))
FUNCTION = TransferFunction(
    opacity=((80, 0.0), (120, 0.3), (150, 0.3), (170, 0.0)), color=((80, 1.0, 0.3, 0.1), (250, 0.9, 0.9, 0.8))
)
every_classification = pytest.mark.parametrize("classification", QUALITIES)


def ball(dtype=np.uint8):
    z, y, x = np.indices((24, 22, 26))
    radius = np.sqrt((x - 12.0) ** 2 + (y - 11.0) ** 2 + (z - 12.0) ** 2)
    return Volume((10.0 + 240.0 / (1.0 + np.exp(0.5 * (radius - 8.0)))).astype(dtype), np.eye(4))


BALL = ball()


def scene(azimuth=20, function=FUNCTION, lights=(), headlight=False, volume=BALL):
    camera, matrix = turntable(volume, azimuth, 10)
    return Scene(volume, function, camera, 40, 40, matrix, lights=lights, headlight=headlight)


def work_of(edited, first, quality):
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


FAINTER = replace(FUNCTION, opacity=tuple((value, 0.5 * alpha) for value, alpha in FUNCTION.opacity))
MATT = replace(FUNCTION, shade=Shade(ambient=0.2, diffuse=0.8, specular=0.0))
PLAIN = replace(FUNCTION, shade=None)
WIDER = shown((60, 0.0), (120, 0.3), (150, 0.3), (170, 0.0))
NARROWER = shown((100, 0.0), (120, 0.5), (140, 0.0))
STEPS = shown((90, 0.0), (90, 0.4), (131, 0.4), (131, 0.0))
SPLIT = shown((85, 0.0), (90, 0.4), (100, 0.0), (150, 0.0), (155, 0.9), (160, 0.0))
HIDING = shown((80, 0.0))
WARMER = replace(FUNCTION, color=((80, 1.0, 0.1, 0.0), (250, 1.0, 0.8, 0.2)))
LIT = dict(lights=(SUN,))
MATT_LIT = dict(function=MATT, **LIT)
PRE_PROPERTIES, PRE_VISIBLE = {"properties", "records"}, {"visible", "properties", "normals", "runs", "records"}
POST_LIGHT = {"surfaces", "normals", "codes"}
POST_RELEVANT = {"relevant", *POST_LIGHT, "runs", "scalars", "table", "bricks"}
POST_RANGES = {"table", "normals", "codes"}  # normals point away from what is shown
EDITS = {  # edited, first, stages where voxels are classified, stages where sheets are
    "camera, matt under a sun": (dict(azimuth=24, **MATT_LIT), MATT_LIT, set(), set()),
    "camera, unshaded": (dict(azimuth=24, function=PLAIN), dict(function=PLAIN), set(), set()),
    "camera, unlit": (dict(azimuth=24), dict(), set(), set()),
    "camera with a headlight": (dict(azimuth=24, headlight=True), dict(headlight=True), {"records"}, set()),
    "light": (dict(lights=(replace(SUN, energy=1.0),)), LIT, {"records"}, set()),
    "colored light": (dict(lights=(replace(SUN, color=(1.0, 0.5, 0.2)),)), LIT, {"records"}, set()),
    "shading": (MATT_LIT, LIT, {"records"}, set()),
    "light put out": (dict(), LIT, {"records"}, set()),
    "light lit": (LIT, dict(), {"normals", "records"}, POST_LIGHT),
    "name": (dict(function=replace(FUNCTION, name="other"), **LIT), LIT, set(), set()),
    "opacities of the same values": (dict(function=FAINTER, **LIT), LIT, PRE_PROPERTIES, {"table"}),
    "opacities": (dict(function=shown((80, 0.0), (110, 0.1), (170, 0.0)), **LIT), LIT, PRE_PROPERTIES, {"table"}),
    "colors": (dict(function=WARMER, **LIT), LIT, PRE_PROPERTIES, {"table"}),
    "fewer values shown": (dict(function=NARROWER, **LIT), LIT, PRE_VISIBLE, POST_RANGES),
    "steps within": (dict(function=STEPS, **LIT), LIT, PRE_VISIBLE, POST_RANGES),
    "two ranges within": (dict(function=SPLIT, **LIT), LIT, PRE_VISIBLE, POST_RANGES),
    # Nothing is worth keeping for nothing.
    "nothing shown": (dict(function=HIDING, **LIT), LIT, PRE_VISIBLE, POST_RELEVANT - {"bricks"}),
    "more values shown": (dict(function=WIDER, **LIT), LIT, PRE_VISIBLE, POST_RELEVANT),
    "more values shown, unlit": (dict(function=WIDER), dict(), PRE_VISIBLE - {"normals"},
                                 POST_RELEVANT - POST_LIGHT),
    "another principal axis": (dict(azimuth=70, **MATT_LIT), MATT_LIT, {"runs", "records"},
                               {"runs", "scalars", "codes"}),
}  # fmt: skip


@pytest.mark.parametrize("dtype", (np.uint8, np.float32))
@every_classification
@pytest.mark.parametrize("name", EDITS)
def test_an_edit_redoes_only_what_it_must(name, classification, dtype):
    edited, first, *stages = EDITS[name]
    volume, quality = ball(dtype), QUALITIES[classification]
    redone = work_of(scene(volume=volume, **edited), scene(volume=volume, **first), quality)
    assert redone == stages[classification == "post"]


@NUMPY
@pytest.mark.parametrize(
    ("name", "classification"),
    (("light", "pre"), ("opacities", "post"), ("fewer values shown", "post"), ("another principal axis", "pre")),
)
def test_the_numpy_reference_is_kept_alike(name, classification, way):
    edited, first, *stages = EDITS[name]
    redone = work_of(scene(**edited), scene(**first), QUALITIES[classification])
    assert redone == stages[classification == "post"]


# --- ranges of values -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", (np.uint8, np.float32))
@pytest.mark.parametrize("threads", (1, 2))
def test_pictures_and_normals_of_other_ranges_are_those_of_a_fresh_start(dtype, threads):
    cache, volume = StageCache(), ball(dtype)
    quality, counts = replace(PRE, threads=threads), []
    for function in (FUNCTION, WIDER, NARROWER, WIDER):
        edited = scene(function=function, lights=(SUN,), volume=volume)
        picture = render(edited, quality, cache=cache)
        counts.append(picture.report["volume"]["visible_voxels"])
        fresh = StageCache()
        np.testing.assert_array_equal(picture.rgba, render(edited, quality, cache=fresh).rgba)
        for (stage, key), (result, *_) in fresh._results.items():
            if stage == "normals":
                np.testing.assert_array_equal(result, cache._results[stage, key][0])
    assert counts[2] < counts[0] < counts[1] == counts[3]
    assert cache.made["normals"] == 3  # the last was there already


@pytest.mark.parametrize(
    ("dtype", "rule", "way"),
    (*((dtype, rule, "numba") for dtype in (np.uint8, np.int16, np.float32) for rule in ("simpson", "preintegrated")),
     (np.uint32, "simpson", "numpy"), (np.float64, "preintegrated", "numpy")),
    indirect=["way"],
)  # fmt: skip
def test_a_wider_range_that_is_kept_gives_the_same_picture(dtype, rule, way):
    """Voxels that are kept and do not matter leave no trace: to the bit, for every kind of values.

    Between two sheets they would, so that there each range keeps its own."""
    volume, quality = ball(dtype), replace(POST, depth_rule=rule)
    for function in (NARROWER, STEPS, SPLIT)[: 1 if way == "numpy" else None]:
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
    assert "relevant" in work_of(narrow, scene(function=shown((0, 0.3)), volume=volume), POST)
    near = scene(function=shown((95, 0.0), (105, 0.5), (115, 0.0)), volume=volume)
    assert work_of(narrow, near, POST) == {"table"}


def test_infinite_values_are_placed_again_when_the_ends_change():
    """What stands for infinity is the function's end, so the scalars depend on it, and only then."""
    voxels = ball(np.float32).voxels.copy()
    voxels[10:14, 9:13, 10:15] = np.inf
    volume = Volume(voxels, np.eye(4))
    first = scene(volume=volume)
    longer = replace(NARROWER, opacity=(*NARROWER.opacity, (400, 0.0)))
    assert work_of(scene(function=NARROWER, volume=volume), first, POST) == {"table"}
    assert work_of(scene(function=longer, volume=volume), first, POST) == {"table", "scalars"}


# --- what is kept, and for whom -------------------------------------------------------------------------------


def test_normals_of_another_volume_or_another_place_do_not_serve():
    """Content decides: equal voxels serve whoever holds them, others never do."""
    cache = StageCache()
    first = scene(**MATT_LIT)
    render(first, PRE, cache=cache)
    longer = np.diag((1.0, 1.0, 2.0, 1.0)) @ first.volume_matrix
    bent = replace(BALL, voxels=BALL.voxels + (BALL.voxels > 130).astype(np.uint8))
    for made, other in enumerate((replace(first, volume_matrix=longer), scene(**MATT_LIT, volume=bent)), start=2):
        picture = render(other, PRE, cache=cache).rgba
        np.testing.assert_array_equal(picture, render(other, PRE).rgba)
        assert cache.made["normals"] == made
    render(scene(**MATT_LIT, volume=ball()), PRE, cache=cache)
    assert cache.made["normals"] == 3


@every_classification
def test_a_dragged_transfer_function_or_light_does_not_fill_the_memory(classification):
    cache, sizes = StageCache(), []
    for step in range(2 * max(MOST_RESULTS.values())):
        wider = shown((80 - 2 * step, 0.0), *FUNCTION.opacity[1:])
        lit = scene(function=wider, lights=(replace(SUN, energy=1.0 + step),))
        render(lit, QUALITIES[classification], cache=cache)
        sizes.append(cache.nbytes)
    counts = Counter(stage for stage, _ in cache.contents)
    assert counts["normals"] == MOST_RESULTS["normals"] and max(counts.values()) <= max(MOST_RESULTS.values())
    assert sizes[-1] < 1.5 * sizes[len(sizes) // 2], counts


def test_the_tables_are_shared_between_lights():
    cache = StageCache()
    render(scene(lights=(SUN,)), PRE, cache=cache)
    runs = [size for (stage, _), (_, size, _) in cache._results.items() if stage == "runs"]
    render(scene(lights=(replace(SUN, energy=1.0),)), PRE, cache=cache)
    records = [result for (stage, _), (result, *_) in cache._results.items() if stage == "records"]
    assert len(runs) == 1 and len(records) == 2 and records[0].runs is records[1].runs


# How often each stage is made for two lights in turn, each under two functions of which one shows less.
MADE = {
    "pre": {"blocks": 1, "visible": 2, "properties": 2, "normals": 2, "runs": 2, "records": 4},
    "post": {
        "blocks": 1, "relevant": 1, "surfaces": 1, "normals": 2, "codes": 2, "runs": 1, "scalars": 1, "table": 2,
        "bricks": 1,
    },
}  # fmt: skip


@every_classification
def test_going_back_costs_nothing_and_equal_voxels_are_the_same_content(classification):
    cache = StageCache()
    for energy in (1.0, 2.0, 1.0, 2.0):
        for function in (FUNCTION, NARROWER):
            lit = scene(function=function, lights=(replace(SUN, energy=energy),), volume=ball())
            render(lit, QUALITIES[classification], cache=cache)
    assert cache.made == MADE[classification]


@every_classification
def test_without_a_cache_no_voxel_is_hashed(classification):
    volume = ball()
    render(scene(volume=volume), QUALITIES[classification])
    assert "key" not in vars(volume)
    render(scene(volume=volume), QUALITIES[classification], cache=StageCache())
    assert "key" in vars(volume)


@pytest.mark.parametrize(
    ("classification", "messages_of"),
    (("pre", {"Splatting", "Encoding"}), ("post", {"Splatting", "Encoding", "Finding the voxels that matter"})),
)
def test_a15_a_cancelled_job_leaves_what_is_kept_as_it_was(classification, messages_of):
    cache, quality = StageCache(), QUALITIES[classification]
    first = render(scene(**LIT), quality, cache=cache).rgba
    before, size = cache.contents, cache.nbytes
    edited = scene(azimuth=70, function=WIDER, headlight=True)
    steps = 0
    while True:
        work = render_steps(edited, quality, cache=cache)
        messages = [next(work).message for _ in range(steps + 1)]
        work.close()
        if messages[-1] == "Done":
            break
        assert cache.contents == before and cache.nbytes == size, messages[-1]
        steps += 1
    assert steps > 3 and messages_of <= set(messages)
    np.testing.assert_array_equal(render(scene(**LIT), quality, cache=cache).rgba, first)


# --- three axes -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("record", (16, 8))
def test_three_axes_are_shaded_once(record, monkeypatch):
    shaded = []

    def light(*arguments, **machine):
        shaded.append(arguments)
        return light_records(*arguments, **machine)

    monkeypatch.setattr(scan_source, "light_records", light)
    lit, quality = scene(lights=(SUN,), headlight=True), replace(PRE, record=record)
    together = encode(lit, quality).axes
    assert list(together) == [0, 1, 2] and len(shaded) == 1
    for axis, tables in together.items():
        alone = encode(lit, quality, axes=(axis,)).axes[axis]
        np.testing.assert_array_equal(tables.voxel_data, alone.voxel_data)
        np.testing.assert_array_equal(tables.runs, alone.runs)
        assert tables.most_color == alone.most_color
    assert len(shaded) == 4


@every_classification
def test_a_camera_inside_lights_once(classification):
    """All principal axes at once, one of them in the order of the voxels; a fresh start for each axis is the same."""
    inside = np.eye(4)
    inside[:3, 3] = (12.3, 11.2, 12.1)
    camera = Camera(inside, type="PERSP", lens=8.0, clip_start=0.01, clip_end=100.0)
    cache = StageCache()
    render(Scene(BALL, MATT, camera, 40, 40, lights=(SUN,)), QUALITIES[classification], cache=cache)
    if classification == "pre":
        assert cache.made["records"] == 3 and cache.made["visible"] == 1
    else:
        made = cache.made
        assert made["runs"] == 3 and made["scalars"] == made["codes"] == 2, "y and z share their records"
        assert made["normals"] == made["relevant"] == made["table"] == 1
