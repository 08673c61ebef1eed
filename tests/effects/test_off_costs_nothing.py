"""What a picture computes, and the modules whose kernels run for it: by counters, not by clocks.

A stage or a kernel that an effect brings along and that runs although nothing asks for it makes these lists longer.
"""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.render import render, render_steps
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.jit import NotingKernels, compiled, kernel
from rle_splat.scene import Light, Quality, Scene
from rle_splat.shade.surface_normals import surface_steps
from rle_splat.view.turntable import turntable
from rle_splat.volume.gradient import normal_steps
from rle_splat.volume.volume import Volume
from tests.ways import NUMPY

needs_kernels = pytest.mark.skipif(not compiled(), reason="nothing is compiled without numba")
SIZE = 24
VOLUME = Volume(np.random.default_rng(3).integers(0, 255, (15, 14, 16)).astype(np.uint8), np.eye(4))
FUNCTION = TransferFunction(opacity=((80.0, 0.0), (250.0, 0.5)), color=((0.0, 0.2, 0.5, 0.8),), shade=None)
MATT = replace(FUNCTION, shade=Shade(specular=0.0))
SHINY = replace(FUNCTION, shade=Shade(specular=0.5))
MESH = np.array((((-20.0, 6.0, -20.0), (8.0, 6.0, -20.0), (8.0, 6.0, 40.0)),))

# What the plain, unlit picture takes: by classification the stages whose results are kept, and the modules whose
# kernels run.
STAGES = {
    "pre": {"blocks", "visible", "properties", "runs", "records"},
    "post": {"blocks", "relevant", "runs", "scalars", "table"},
}
SHARED = {"classify.relevant", "encode.encode_kernels", "volume.blocks", "warp.resample", "warp.spline_prefilter"}
KERNELS = {
    "pre": SHARED | {"classify.classify_kernels", "shade.shading", "splat.sheet_buffer"},
    "post": SHARED | {"splat.scalar_sheets"},
}
GIVEN = "as given"  # a quality of this name is no preset, whose plan depends on the scene
# What light adds to them.
LIT_STAGES = {"pre": {"normals"}, "post": {"surfaces", "normals", "codes"}}
LIT_KERNELS = {"pre": {"volume.gradient"}, "post": {"shade.surface_normals", "shade.surface_points"}}


def scene_of(azimuth=25.0, **more) -> Scene:
    camera, matrix = turntable(VOLUME, azimuth, 15.0, 1.2, False, 40.0)
    return Scene(**{
        "volume": VOLUME, "transfer_function": FUNCTION, "camera": camera, "width": SIZE, "height": SIZE,
        "volume_matrix": matrix, "headlight": False, **more,
    })  # fmt: skip


def worked(scene, classification, **knobs):
    """(stages made, modules whose kernels ran) for a first picture."""
    cache = StageCache()
    quality = Quality(classification=classification, **{"name": GIVEN, **knobs})
    report = render(scene, quality, cache=cache).report
    return set(cache.made), modules_of(report["kernels"])


def modules_of(kernels) -> set[str]:
    return {name.rpartition(".")[0] for name in kernels}


@pytest.mark.parametrize("classification", KERNELS)
def test_a_plain_unlit_scene_makes_these_stages_and_no_other(classification, way):
    assert worked(scene_of(), classification)[0] == STAGES[classification]


@needs_kernels
@pytest.mark.parametrize("classification", KERNELS)
def test_a_plain_unlit_scene_runs_these_kernels_and_no_other(classification):
    assert worked(scene_of(), classification)[1] == KERNELS[classification]


def test_the_plan_of_a_preset_takes_one_stage_more_and_no_kernel(way):
    hazy = scene_of(transfer_function=replace(FUNCTION, opacity=((0.0, 0.0), (1e6, 0.01))))
    given, preset = (worked(hazy, "post", name=name) for name in (GIVEN, "standard"))
    assert preset == (given[0] | {"roughness"}, given[1])


@needs_kernels
def test_single_rays_are_what_a_quality_that_has_them_adds():
    """The default has none, and its first picture does not wait for their kernels."""
    knobs = dict(depth_rule="preintegrated", sheet_density=1.0, termination=1 / 1024)
    stages, kernels = worked(scene_of(), "post", **knobs, rays=0.1)
    assert Quality().rays == 0.0 < Quality.preset("fine").rays
    assert stages - STAGES["post"] == {"bricks"} and stages >= STAGES["post"]
    assert kernels - KERNELS["post"] == {"raycast.scalar_rays", "warp.steep"}
    assert worked(scene_of(), "post", **knobs, rays=1.1)[0] == STAGES["post"]  # where nothing is as steep


@needs_kernels
@pytest.mark.parametrize("classification", KERNELS)
@pytest.mark.parametrize("more", [
    {"headlight": True}, {"lights": (Light("SUN"),)}, {"triangles": MESH + (0.0, 500.0, 0.0)},
    {"triangles": np.empty((0, 3, 3))},
])  # fmt: skip
def test_what_changes_nothing_runs_nothing(more, classification):
    """Light on what is not shaded, and meshes behind the volume."""
    assert worked(scene_of(**more), classification) == (STAGES[classification], KERNELS[classification])


@needs_kernels
@pytest.mark.parametrize("classification", KERNELS)
def test_light_adds_gradients_and_nothing_else(classification):
    stages, kernels = worked(scene_of(transfer_function=MATT, lights=(Light("SUN"),)), classification)
    assert stages - STAGES[classification] == LIT_STAGES[classification]
    assert kernels - KERNELS[classification] == LIT_KERNELS[classification]
    assert stages >= STAGES[classification] and kernels >= KERNELS[classification]


@needs_kernels
@pytest.mark.parametrize("classification", KERNELS)
def test_a_mesh_in_the_volume_adds_its_depths_and_nothing_else(classification):
    stages, kernels = worked(scene_of(triangles=MESH), classification)
    assert stages == STAGES[classification]
    assert kernels - KERNELS[classification] == {"effects.mesh_depth", "effects.depth_layers", "view.ray_intervals"}


@pytest.mark.parametrize("classification", KERNELS)
def test_shading_that_is_off_by_hand_computes_no_gradient(classification, way, monkeypatch):
    name, asked = {
        "pre": ("scan_source.normal_steps", normal_steps),
        "post": ("scalar_light.surface_steps", surface_steps),
    }[classification]
    calls = []
    monkeypatch.setattr(f"rle_splat.pipeline.{name}", lambda *a, **k: calls.append(a) or asked(*a, **k))
    lit = scene_of(transfer_function=SHINY, lights=(Light("SUN"),))
    assert worked(replace(lit, effects={"shading": False}), classification)[0] == STAGES[classification]
    assert not calls
    worked(lit, classification)
    assert len(calls) == 1


@pytest.mark.parametrize("classification, again", [("pre", 2), ("post", 1)])
def test_only_highlights_of_voxels_are_shaded_again_when_the_camera_moves(classification, again, way):
    """What light leaves on a voxel is kept while the camera moves, unless a highlight follows it.  Samples are lit in
    every picture anyway, and nothing is made for that but the picture."""
    quality = Quality(classification=classification, name=GIVEN)
    kept = {"pre": "records", "post": "codes"}[classification]
    for tf, times in ((MATT, 1), (SHINY, again)):
        cache = StageCache()
        for azimuth in (25.0, 27.0):
            render(scene_of(azimuth, transfer_function=tf, lights=(Light("SUN"),)), quality, cache=cache)
        assert cache.made[kept] == times and cache.made["normals"] == 1


@needs_kernels
def test_a_second_frame_runs_only_what_it_makes_anew():
    cache, scene = StageCache(), scene_of()
    render(scene, Quality(name=GIVEN), cache=cache)
    again = render(scene, Quality(name=GIVEN), cache=cache).report["kernels"]
    assert modules_of(again) == {"splat.scalar_sheets", "warp.resample", "warp.spline_prefilter"}


@needs_kernels
def test_pictures_made_by_turns_do_not_note_one_anothers_kernels():
    unlit = render_steps(scene_of(), Quality(classification="pre"))
    lamp = scene_of(transfer_function=MATT, lights=(Light("SUN"),))
    lit = render_steps(lamp, Quality(classification="post", name=GIVEN))
    reports = {}
    while len(reports) < 2:
        for name, steps in (("unlit", unlit), ("lit", lit)):
            try:
                next(steps)
            except StopIteration as finished:
                if finished.value is not None:
                    reports[name] = finished.value.report
    assert modules_of(reports["unlit"]["kernels"]) == KERNELS["pre"]
    assert modules_of(reports["lit"]["kernels"]) == KERNELS["post"] | LIT_KERNELS["post"]


@kernel
def _twice(value):
    return 2.0 * value


@needs_kernels
def test_kernels_are_noted_where_somebody_asks_and_only_there():
    names, inner = set(), set()
    _twice(1.0)
    with NotingKernels(names):
        with NotingKernels(inner):
            _twice(1.0)
        assert not names
    _twice(1.0)
    assert not names and {name.rpartition(".")[2] for name in inner} == {"_twice"}


@NUMPY
def test_without_kernels_none_are_listed(way):
    assert worked(scene_of(), "post")[1] == set()
