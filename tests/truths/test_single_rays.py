"""Proves that pixels by rays of their own are the truth T2 up to their slabs: second order in these whatever the
transfer function, lit and unlit, from outside and inside, cut by the volume's faces, clip planes and clip objects; and
the same without numba and for any number of threads."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rle_splat.accuracy.lighting import shading_of
from rle_splat.accuracy.metrics import LEVEL
from rle_splat.accuracy.planner.single_rays import single_ray_steps
from rle_splat.accuracy.truths import truth
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.choose_source import choose_source
from rle_splat.pipeline.single_rays import can_trace
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.raycast.scalar_rays import COMPOSITED, WALKED
from rle_splat.runtime.jit import use_reference
from rle_splat.runtime.steps import drain
from rle_splat.scene import Clip, Light, Mist, Quality
from tests.truths.test_clips import placed
from tests.ways import both

PROJECTIONS = pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
POST = Quality(classification="post", termination=1e-6)
SIZE = (24, 24)
SHADE = Shade(ambient=0.2, diffuse=0.7, specular=0.4, shininess=12.0)
COLORS = ((0.0, 0.9, 0.3, 0.1), (0.6, 0.2, 0.8, 0.3), (1.0, 0.3, 0.4, 1.0))
PLANE = placed((8.0, 7.5, 6.0), (1.0, 1.0, 0.0), 0.9)
MIDDLE = placed((8.0, 7.0, 6.0), half=(4.0, 5.0, 3.0))
CORNER = placed((13.0, 3.0, 10.0), (0.0, 1.0, 1.0), 0.4, (5.0, 5.0, 5.0))
CURVES = {
    "wide": TransferFunction("wide", None, ((0.1, 0.0), (1.0, 0.4)), COLORS, 1.0, None),
    "narrow": TransferFunction("narrow", None, ((0.4, 0.0), (0.5, 0.8), (0.6, 0.0)), COLORS, 1.0, None),
    "lit": TransferFunction("lit", None, ((0.3, 0.0), (0.6, 0.7)), COLORS, 1.0, SHADE),
}


@cache
def waves():
    """A field from 0 to 1 that is nowhere symmetrical and that the faces cut."""
    z, y, x = np.mgrid[:13, :15, :17].astype(np.float64)
    return (0.5 + 0.5 * np.sin(0.55 * x + 0.2 * y) * np.cos(0.4 * y - 0.5 * z + 0.3)).astype(np.float32)


def traced(scene, slabs, quality=POST):
    rows, columns = np.divmod(np.arange(scene.width * scene.height), scene.width)
    return drain(single_ray_steps(scene, quality, columns, rows, slabs, StageCache(0)))[0]


def errors(scene, slabs):
    true = truth(scene, "T2", tolerance=1e-8, **shading_of(scene, "T2"))[0]
    assert true[:, 3].max() > 0.4
    return np.abs(traced(scene, slabs) - true) / LEVEL


# Largest error in levels with 4 slabs a voxel, about a half above what was measured.
BOUNDS = {"wide": 0.45, "narrow": 3.5, "lit": 3.0}
UP = np.diag((1.0, -1.0, -1.0, 1.0))
BESIDE = np.array(((1.0, 0.0, 0.0, 25.0), (0.0, 1.0, 0.0, -10.0), (0.0, 0.0, 1.0, 14.0), (0.0, 0.0, 0.0, 1.0)))
LAMPS = (
    Light(energy=2.0, matrix_world=UP), Light(type="POINT", energy=6000.0, color=(1.0, 0.6, 0.3), matrix_world=BESIDE),
)  # fmt: skip


@pytest.mark.parametrize("curve, perspective", (("wide", False), ("narrow", True), ("lit", False), ("lit", True)))
def test_rays_are_the_truth_up_to_their_slabs(stage, curve, perspective):
    lights = LAMPS if curve == "lit" else ()
    scene = stage.on_turntable(
        waves(), perspective=perspective, size=SIZE, transfer_function=CURVES[curve], lights=lights, fit=0.9
    )
    coarse, fine = errors(scene, 4), errors(scene, 16)
    assert coarse.max() < BOUNDS[curve]
    # A quarter of the slabs' depth, a sixteenth of the error, until the table of values is seen.
    order = np.log(np.sqrt((coarse**2).mean() / (fine**2).mean())) / np.log(4.0)
    assert order > 1.7 and fine.max() < 0.25 * coarse.max() + 0.02


def test_from_an_eye_inside_and_between_clip_planes(stage):
    inside = stage.looking((8.0, 6.0, 5.0), (3.0, 9.0, 11.0), lens=24.0, clip_start=1e-3, clip_end=1e3)
    scene = stage.before(stage.volume(waves()), inside, SIZE, transfer_function=CURVES["wide"])
    assert errors(scene, 16).max() < 0.1
    outside = stage.looking((-20.0, -14.0, 18.0), (8.0, 7.0, 6.0), lens=60.0, clip_start=26.0, clip_end=33.0)
    scene = stage.before(stage.volume(waves()), outside, SIZE, transfer_function=CURVES["narrow"])
    assert errors(scene, 16).max() < 0.3
    unclipped = replace(scene, camera=replace(outside, clip_start=0.1, clip_end=1e3))
    assert np.abs(traced(scene, 4) - traced(unclipped, 4)).max() > 0.1


CUTS = {
    "plane": (Clip("plane", PLANE),),
    "box": (Clip("box", MIDDLE),),
    "box removed": (Clip("box", MIDDLE, "outside"),),
    "all": (Clip("plane", PLANE), Clip("box", MIDDLE, "outside"), Clip("box", CORNER, "outside")),
}


@PROJECTIONS
@pytest.mark.parametrize("name", CUTS)
def test_between_clip_objects(stage, way, name, perspective):
    """Removed boxes leave rays of several pieces, and later ones begin where half is absorbed, or nothing."""
    scene = stage.on_turntable(
        waves(), perspective=perspective, size=SIZE, transfer_function=CURVES["wide"], clips=CUTS[name], fit=0.9
    )
    assert errors(scene, 16).max() < 0.1
    assert np.abs(traced(scene, 4) - traced(replace(scene, clips=()), 4)).max() > 0.2
    true, true_depth = truth(scene, "T2", tolerance=1e-8)
    picture = stage.render(scene, classification="post", rays=1e-6)
    assert picture.report["rays"]["share"] > 0.5
    # Where the light that is left is near to half of it after a hole, the depth is on either side of it.
    apart = np.abs(picture.depth.ravel() - true_depth)[true[:, 3] > 0.55]
    assert len(apart) > 60 and np.percentile(apart, 90) < 0.02


@PROJECTIONS
def test_the_same_without_numba_and_with_any_number_of_threads(stage, perspective):
    field = waves().copy()
    field[3, 4, 5:9] = np.nan
    scene = stage.on_turntable(
        field, perspective=perspective, size=SIZE, transfer_function=CURVES["lit"], fit=0.9, headlight=True
    )
    found = traced(scene, 3)
    assert (found == traced(scene, 3, replace(POST, threads=1))).all() and np.isfinite(found).all()
    with use_reference():
        # A normal may be rounded to the next code.
        assert np.abs(found - traced(scene, 3)).max() < 2e-5


@PROJECTIONS
def test_where_half_is_absorbed(stage, way, perspective):
    """To a hundredth of a voxel at most pixels, which is a twentieth of a slab."""
    scene = stage.on_turntable(waves(), perspective=perspective, size=SIZE, transfer_function=CURVES["wide"], fit=0.9)
    rgba, depth = truth(scene, "T2", tolerance=1e-8)
    picture = stage.render(scene, classification="post", rays=1e-6)
    assert picture.report["rays"]["share"] > 0.9 and picture.report["rays"]["slabs"] == 4
    error = np.abs(picture.depth.ravel() - depth)[rgba[:, 3] > 0.55]
    assert len(error) > 400 and np.percentile(error, 90) < 0.012 and error.max() < 0.06


def test_what_rays_know_nothing_of_is_left_to_the_sheets(stage):
    scene = stage.on_turntable(waves(), size=SIZE, transfer_function=CURVES["wide"])

    def may_be_traced(quality=POST, **changed):
        return can_trace(choose_source(replace(scene, **changed), quality))

    triangle = np.array([[(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]])
    assert may_be_traced() and may_be_traced(triangles=triangle, clips=CUTS["all"])
    assert not may_be_traced(mist=Mist(1.0, 40.0))
    assert not may_be_traced(Quality(classification="pre"))
    assert not may_be_traced(volume=stage.volume(waves()[:1]))


def test_the_work_of_a_ray_is_counted(stage):
    """Along y through a block of ten voxels: the cells between them and those at its ends; with numba and without."""
    rows, columns = np.divmod(np.arange(SIZE[0] * SIZE[1]), SIZE[0])
    block = np.zeros((13, 15, 17), np.float32)
    block[3:9, 2:12, 4:14] = 0.5
    thin = replace(CURVES["narrow"], opacity_unit_distance=1e3)
    scene = stage.on_turntable(block, 0.0, 0.0, size=SIZE, transfer_function=thin)
    found = both(lambda: drain(single_ray_steps(scene, POST, columns, rows, 4, StageCache(0)))[1])
    np.testing.assert_array_equal(found[0][:, COMPOSITED], found[1][:, COMPOSITED])
    assert set(found[0][:, COMPOSITED]) == {0, 11}
    assert (found[0][:, COMPOSITED] <= found[0][:, WALKED]).all() and (found[0][:, WALKED] <= found[1][:, WALKED]).all()
