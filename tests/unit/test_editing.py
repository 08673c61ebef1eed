"""Every edit redoes only what it must, and gives the picture that a fresh start gives."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline import scan_source
from rle_splat.pipeline.encode_scene import encode_scene
from rle_splat.pipeline.render import render, render_steps
from rle_splat.pipeline.stage_cache import MOST_RESULTS, StageCache
from rle_splat.scene import Camera, Light, Quality, Scene
from rle_splat.shade.shading import light_records
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

QUALITY = Quality.preset("draft", classification="pre")
SUN = Light("SUN", energy=3.0, matrix_world=np.array([[1, 0, 0, 0], [0, 0.8, -0.6, 0], [0, 0.6, 0.8, 0], [0, 0, 0, 1]]))
MATT = Shade(ambient=0.2, diffuse=0.8, specular=0.0)
FUNCTION = TransferFunction(
    opacity=((80, 0.0), (120, 0.3), (250, 0.6)), color=((80, 1.0, 0.3, 0.1), (250, 0.9, 0.9, 0.8))
)


def ball(dtype=np.uint8):
    z, y, x = np.indices((24, 22, 26))
    radius = np.sqrt((x - 12.0) ** 2 + (y - 11.0) ** 2 + (z - 12.0) ** 2)
    return Volume((250.0 / (1.0 + np.exp(radius - 8.0))).astype(dtype), np.eye(4))


BALL = ball()


def scene(azimuth=20, function=FUNCTION, lights=(), headlight=False, volume=BALL):
    camera, matrix = turntable(volume, azimuth, 10, width=40, height=40)
    return Scene(volume, function, camera, 40, 40, matrix, lights=lights, headlight=headlight)


def work_of(edited, first, quality=QUALITY):
    """Which stages the edit ran again; its picture is held against a fresh one."""
    cache = StageCache()
    render(first, quality, cache=cache)
    before = dict(cache.made)
    picture = render(edited, quality, cache=cache).rgba
    np.testing.assert_array_equal(picture, render(edited, quality).rgba)
    return {stage for stage, count in cache.made.items() if count > before.get(stage, 0)}


def heights(function, factor):
    return replace(function, opacity=tuple((v, a * factor) for v, a in function.opacity))


MATT_FUNCTION = replace(FUNCTION, shade=MATT)
PLAIN_FUNCTION = replace(FUNCTION, shade=None)
WIDER = replace(FUNCTION, opacity=((60, 0.0), (120, 0.3), (250, 0.6)))
WARMER = replace(FUNCTION, color=((80, 1.0, 0.1, 0.0), (250, 1.0, 0.8, 0.2)))
EDITS = {
    "camera, matt under a sun": (dict(azimuth=24, function=MATT_FUNCTION, lights=(SUN,)),
                                 dict(function=MATT_FUNCTION, lights=(SUN,)), set()),
    "camera, unshaded": (dict(azimuth=24, function=PLAIN_FUNCTION), dict(function=PLAIN_FUNCTION), set()),
    "camera with a headlight": (dict(azimuth=24, headlight=True), dict(headlight=True), {"records"}),
    "light": (dict(lights=(replace(SUN, energy=1.0),)), dict(lights=(SUN,)), {"records"}),
    "shading": (dict(lights=(SUN,), function=MATT_FUNCTION), dict(lights=(SUN,)), {"records"}),
    "light put out": (dict(), dict(lights=(SUN,)), {"records"}),
    "name": (dict(lights=(SUN,), function=replace(FUNCTION, name="other")), dict(lights=(SUN,)), set()),
    "opacities of the same values": (dict(lights=(SUN,), function=heights(FUNCTION, 0.5)), dict(lights=(SUN,)),
                                     {"looks", "records"}),
    "colours": (dict(lights=(SUN,), function=WARMER), dict(lights=(SUN,)), {"looks", "records"}),
    "values shown": (dict(lights=(SUN,), function=WIDER), dict(lights=(SUN,)),
                     {"visible", "looks", "normals", "runs", "records"}),
    "values shown, unlit": (dict(function=WIDER), dict(), {"visible", "looks", "runs", "records"}),
    "another principal axis": (dict(azimuth=70, function=MATT_FUNCTION, lights=(SUN,)),
                               dict(function=MATT_FUNCTION, lights=(SUN,)), {"runs", "records"}),
}


@pytest.mark.parametrize("dtype", (np.uint8, np.float32))
@pytest.mark.parametrize("name", EDITS)
def test_an_edit_redoes_only_what_it_must(name, dtype):
    edited, first, stages = EDITS[name]
    volume = ball(dtype)
    assert work_of(scene(volume=volume, **edited), scene(volume=volume, **first)) == stages


def test_the_numpy_twins_are_kept_alike():
    quality = replace(QUALITY, backend="numpy")
    edited, first, stages = EDITS["light"]
    assert work_of(scene(**edited), scene(**first), quality) == stages


NARROWER = replace(FUNCTION, opacity=((100, 0.0), (140, 0.3), (250, 0.6)))


@pytest.mark.parametrize("dtype", (np.uint8, np.float32))
@pytest.mark.parametrize("threads", (1, 2))
def test_pictures_and_normals_of_other_ranges_are_those_of_a_fresh_start(dtype, threads):
    cache, volume = StageCache(), ball(dtype)
    quality, shown = replace(QUALITY, threads=threads), []
    for function in (FUNCTION, WIDER, NARROWER, WIDER):
        edited = scene(function=function, lights=(SUN,), volume=volume)
        picture = render(edited, quality, cache=cache)
        shown.append(picture.report["volume"]["visible_voxels"])
        fresh = StageCache()
        np.testing.assert_array_equal(picture.rgba, render(edited, quality, cache=fresh).rgba)
        for (stage, key), (result, _) in fresh._results.items():
            if stage == "normals":
                np.testing.assert_array_equal(result, cache._results[stage, key][0])
    assert shown[2] < shown[0] < shown[1] == shown[3]
    assert cache.made["normals"] == 3  # the last was there already


def test_normals_of_another_volume_or_another_place_do_not_serve():
    """Content decides: equal voxels serve whoever holds them, others never do."""
    cache, lit = StageCache(), dict(function=MATT_FUNCTION, lights=(SUN,))
    first = scene(**lit)
    render(first, QUALITY, cache=cache)
    longer = np.diag((1.0, 1.0, 2.0, 1.0)) @ first.volume_matrix
    bent = replace(BALL, voxels=BALL.voxels + (BALL.voxels > 130).astype(np.uint8))
    for made, other in enumerate((replace(first, volume_matrix=longer), scene(**lit, volume=bent)), start=2):
        picture = render(other, QUALITY, cache=cache).rgba
        np.testing.assert_array_equal(picture, render(other, QUALITY).rgba)
        assert cache.made["normals"] == made
    render(scene(**lit, volume=ball()), QUALITY, cache=cache)
    assert cache.made["normals"] == 3


def test_a_dragged_transfer_function_does_not_fill_the_memory():
    cache, sizes = StageCache(), []
    for step in range(2 * max(MOST_RESULTS.values())):
        wider = replace(FUNCTION, opacity=((80 - 2 * step, 0.0), *FUNCTION.opacity[1:]))
        render(scene(function=wider, lights=(SUN,)), QUALITY, cache=cache)
        sizes.append(cache.nbytes)
    counts = Counter(stage for stage, _ in cache.contents)
    assert counts["normals"] == MOST_RESULTS["normals"] and sizes[-1] < 1.5 * sizes[len(sizes) // 2]


def test_the_tables_are_shared_between_lights():
    cache = StageCache()
    render(scene(lights=(SUN,)), QUALITY, cache=cache)
    runs = [size for (stage, _), (_, size) in cache._results.items() if stage == "runs"]
    render(scene(lights=(replace(SUN, energy=1.0),)), QUALITY, cache=cache)
    records = [result for (stage, _), (result, _) in cache._results.items() if stage == "records"]
    assert len(runs) == 1 and len(records) == 2 and records[0].runs is records[1].runs


def test_going_back_costs_nothing():
    cache = StageCache()
    for energy in (1.0, 2.0, 1.0, 2.0):
        render(scene(lights=(replace(SUN, energy=energy),)), QUALITY, cache=cache)
    assert cache.made["records"] == 2


def test_equal_voxels_are_the_same_content():
    cache = StageCache()
    for volume in (ball(), ball()):
        render(scene(volume=volume), QUALITY, cache=cache)
    assert set(cache.made.values()) == {1}


def test_without_a_store_no_voxel_is_hashed():
    volume = ball()
    render(scene(volume=volume), QUALITY)
    assert "key" not in vars(volume)
    render(scene(volume=volume), QUALITY, cache=StageCache())
    assert "key" in vars(volume)


def test_a15_a_cancelled_job_leaves_what_is_kept_as_it_was():
    cache = StageCache()
    first = render(scene(lights=(SUN,)), QUALITY, cache=cache).rgba
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
    assert steps > 3 and "Splatting" in messages and "Encoding" in messages
    np.testing.assert_array_equal(render(scene(lights=(SUN,)), QUALITY, cache=cache).rgba, first)


@pytest.mark.parametrize("record", (16, 8, 6, 4))
def test_three_axes_are_shaded_once(record, monkeypatch):
    shaded = []

    def light(*arguments, **machine):
        shaded.append(arguments)
        return light_records(*arguments, **machine)

    monkeypatch.setattr(scan_source, "light_records", light)
    lit, quality = scene(lights=(SUN,), headlight=True), replace(QUALITY, record=record)
    together = encode_scene(lit, quality).axes
    assert list(together) == [0, 1, 2] and len(shaded) == 1
    for axis, tables in together.items():
        alone = encode_scene(lit, quality, axes=(axis,)).axes[axis]
        np.testing.assert_array_equal(tables.voxel_data, alone.voxel_data)
        np.testing.assert_array_equal(tables.runs, alone.runs)
        assert tables.most_color == alone.most_color
    assert len(shaded) == 4


def test_a_camera_inside_shades_once(monkeypatch):
    """All principal axes at once, one of them in the order of the voxels; a fresh start for each axis is the same."""
    inside = np.eye(4)
    inside[:3, 3] = (12.3, 11.2, 12.1)
    camera = Camera(inside, type="PERSP", lens=8.0, clip_start=0.01, clip_end=100.0)
    wide = Scene(BALL, replace(FUNCTION, shade=MATT), camera, 40, 40, lights=(SUN,))
    cache = StageCache()
    render(wide, QUALITY, cache=cache)
    assert cache.made["records"] == 3 and cache.made["visible"] == 1
