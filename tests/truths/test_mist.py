"""Proves that mist fades what a sheet shows by its distance: against the integral in float64, in every falloff, along
the ray in perspective and along the camera's axis without, for classified voxels and for sheets of the scalar."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.accuracy.rays import camera_rays
from rle_splat.accuracy.truths import truth
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.jit import use_reference
from rle_splat.scene import MIST_FALLOFFS, Mist, Quality, RleSplatError
from tests.truths.closed_forms import box_depths

COLOR, FOG = np.array((0.9, 0.4, 0.2)), np.array((0.1, 0.6, 1.5))
SIGMA = -np.log1p(-0.12)
EVEN = TransferFunction(opacity=((0.0, 0.12),), color=((0.0, *COLOR),), opacity_unit_distance=1.0, shade=None)
STRENGTH = {"QUADRATIC": lambda t: t * t, "LINEAR": lambda t: t, "INVERSE_QUADRATIC": np.sqrt}
SIZE, SIDE = 16, 32


def slab(stage, perspective=False, **more):
    """A block of an even medium, 16 voxels a side, some way in front of the camera."""
    options = dict(transfer_function=EVEN, perspective=perspective, size=(SIDE, SIDE), fov=60.0)
    return stage.on_turntable(np.ones((SIZE, SIZE, SIZE)), 35.0, 25.0, **options, **more)


def ends_of(scene, beyond=0.0):
    """(rays, nearest, furthest): camera rays, and the planar depths at which they are inside the box, or so many voxels
    outside it."""
    rays = camera_rays(scene.camera, SIDE, SIDE)
    low, high = np.full(3, -beyond), np.full(3, SIZE - 1.0 + beyond)
    return rays, *box_depths(rays, scene.index_to_world, low, high)


def misty(scene, mist, ramped):
    """(H, W, 4) of the slab in mist, and where rays cross at least three voxels of it: by 1000 slices a ray.

    ``ramped``: whether it ramps down to nothing within a voxel of its faces, as classified voxels do.
    """
    rays, enter, leave = ends_of(scene, float(ramped))
    inside = (leave - enter > 3.0).reshape(SIDE, SIDE)
    leave = np.maximum(leave, enter)
    depth = enter[:, None] + (leave - enter)[:, None] * (np.arange(1000) + 0.5) / 1000
    points = rays.origin[:, None] + rays.step[:, None] * depth[..., None]
    to_index = np.linalg.inv(scene.index_to_world)
    points = points @ to_index[:3, :3].T + to_index[:3, 3]
    share = np.clip(1.0 - np.maximum(-points, points - (SIZE - 1.0)), 0.0, 1.0).prod(axis=2)
    tau = SIGMA * share * ((leave - enter) * rays.length_per_depth)[:, None] / 1000
    weight = np.exp(-(np.cumsum(tau, axis=1) - tau)) * -np.expm1(-tau)
    distance = depth * (rays.length_per_depth[:, None] if scene.camera.type == "PERSP" else 1.0)
    share = STRENGTH[mist.falloff](np.clip((distance - mist.start) / mist.depth, 0.0, 1.0))[..., None]
    color = (weight[..., None] * ((1.0 - share) * COLOR + share * np.array(mist.color))).sum(axis=1)
    alpha = -np.expm1(-tau.sum(axis=1))[:, None]
    return np.concatenate((color, alpha), axis=1).reshape(SIDE, SIDE, 4), inside


@pytest.mark.parametrize(
    ("classification", "depth_rule", "falloff", "perspective"),
    [
        (*how, falloff, (n + f) % 2 == 1)
        for n, how in enumerate((("post", "preintegrated"), ("post", "simpson"), ("pre", "simpson")))
        for f, falloff in enumerate(MIST_FALLOFFS)
    ],
)
def test_a_slab_in_mist(stage, classification, depth_rule, falloff, perspective):
    scene = slab(stage, perspective)
    _, enter, leave = ends_of(scene)
    seen = leave > enter
    mist = Mist(float(enter[seen].min()) + 2.0, float((leave - enter)[seen].max()), falloff, tuple(FOG))
    true, inside = misty(scene, mist, classification == "pre")
    scene = replace(scene, mist=mist)
    knobs = dict(classification=classification, depth_rule=depth_rule, sheet_density=2.0)
    found, clear = (stage.render(s, **knobs) for s in (scene, replace(scene, mist=None)))
    np.testing.assert_array_equal(found.rgba[..., 3], clear.rgba[..., 3])
    np.testing.assert_array_equal(found.depth, clear.depth)
    error = np.abs((found.rgba - true)[inside])  # largest where the box's edges cross a sheet pixel
    assert error.max() < 0.06 and np.quantile(error, 0.98) < 0.012 and error.mean() < 0.002
    assert np.abs(found.rgba - clear.rgba).max() > 0.1


def test_far_into_the_mist_there_is_nothing_else_and_before_it_nothing_of_it(stage):
    scene = slab(stage)
    _, enter, leave = ends_of(scene)
    seen = leave > enter
    near = stage.render(replace(scene, mist=Mist(float(leave[seen].max()) + 1.0, 1.0, "LINEAR", tuple(FOG))))
    np.testing.assert_allclose(near.rgba, stage.render(scene).rgba, atol=2e-4)
    within = Mist(0.0, 0.5 * float(enter[seen].min()), "LINEAR", tuple(FOG))
    far = stage.render(replace(scene, mist=within), warp_filter="bilinear").rgba
    np.testing.assert_allclose(far[..., :3], far[..., 3:] * FOG, atol=2e-5)


@pytest.mark.parametrize("classification", ("pre", "post"))
def test_threads_and_numpy_make_the_same_picture(stage, classification):
    field = np.random.default_rng(6).random((12, 12, 12))
    tf = replace(EVEN, opacity=((0.1, 0.0), (1.0, 0.5)), color=((0.0, 0.9, 0.3, 0.1), (1.0, 0.2, 0.5, 0.9)))
    scene = stage.on_turntable(field, 20.0, 30.0, True, size=(41, 37), transfer_function=tf)
    distance = float(np.linalg.norm(scene.camera.matrix_world[:3, 3] - 5.5))
    scene = replace(scene, mist=Mist(distance - 8.0, 16.0, "INVERSE_QUADRATIC", tuple(FOG)))
    one, two = (stage.render(scene, classification=classification, threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.rgba, two.rgba)
    with use_reference():
        reference = stage.render(scene, classification=classification)
    np.testing.assert_allclose(one.rgba, reference.rgba, atol=2e-3)


@pytest.mark.parametrize("classification", ("pre", "post"))
def test_off_is_the_picture_without_it_bit_for_bit(stage, classification):
    scene = replace(slab(stage), mist=Mist(1.0, 90.0))
    quality = Quality(classification=classification)
    off = render(replace(scene, effects={"mist": False}), quality, cache=StageCache())
    plain = render(replace(scene, mist=None), quality)
    np.testing.assert_array_equal(off.rgba.view(np.uint32), plain.rgba.view(np.uint32))
    assert off.report["kernels"] == plain.report["kernels"]
    row = next(e for e in render(scene, quality).report["effects"] if e["name"] == "mist")
    assert row["on"] and row["reason"] == "quadratic from 1 to 91"


@pytest.mark.parametrize(
    "wrong", [{"start": -1.0}, {"depth": 0.0}, {"falloff": "CUBIC"}, {"color": (1.0, 2.0)}, {"start": "near"}]
)
def test_what_is_no_mist_is_refused_in_one_sentence(wrong):
    with pytest.raises(RleSplatError, match=r"mist's"):
        Mist(**{"start": 1.0, "depth": 90.0} | wrong)


def test_there_is_no_truth_of_it(stage):
    with pytest.raises(RleSplatError, match="mist"):
        truth(replace(slab(stage), mist=Mist(1.0, 90.0)), "T2")
