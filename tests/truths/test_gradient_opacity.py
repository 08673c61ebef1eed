"""Proves that a gradient opacity multiplies extinction by how steep the values are: against closed forms where the
gradient is known, for both classifications and in absorption alone, by the reference implementations; the kernels make
their picture."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.phantoms import radius_from_center
from rle_splat.accuracy.rays import camera_rays
from rle_splat.accuracy.truths import truth
from rle_splat.classify.transfer_function import GradientOpacity, Shade, TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.jit import use_reference
from rle_splat.scene import Quality, RleSplatError
from rle_splat.volume.gradient_size import gradient_sizes
from rle_splat.volume.volume import Volume
from tests.truths.closed_forms import box_depths, composed
from tests.ways import NUMPY

COLOR = (0.9, 0.4, 0.2)
EVEN = TransferFunction(  # the same everywhere, so that only the gradient tells
    opacity=((0.0, 0.06),), color=((0.0, *COLOR),), opacity_unit_distance=1.0, shade=None,
)  # fmt: skip
SIGMA = -np.log1p(-0.06)
RULES = [("post", "preintegrated"), ("post", "simpson"), ("pre", "simpson")]


def steep(low, high, tf=EVEN):
    return replace(tf, gradient_opacity=GradientOpacity(low, high))


def path_of(scene, size=16):
    rays = camera_rays(scene.camera, scene.width, scene.height)
    high = np.full(3, size - 1.0)
    return rays, *box_depths(rays, scene.index_to_world, np.zeros(3), high)


@NUMPY
@pytest.mark.parametrize(("classification", "depth_rule"), RULES)
@pytest.mark.parametrize("dtype", (np.float32, np.int16))
def test_an_even_slope_thins_everything_evenly(stage, classification, depth_rule, dtype, way):
    """7 values a voxel, voxels 2 long: 3.5 values a unit, between 1.5 and 5.5 half of everything is left."""
    z, _, _ = np.mgrid[:16, :16, :16]
    volume = Volume((7 * z).astype(dtype), np.diag((2.0, 2.0, 2.0, 1.0)))
    options = dict(transfer_function=steep(1.5, 5.5), size=(32, 32), spacing=(2.0,) * 3)
    scene = stage.on_turntable(7.0 * z, 30.0, 20.0, **options)
    scene = replace(scene, volume=volume)
    knobs = dict(classification=classification, depth_rule=depth_rule, sheet_density=2.0)
    found = stage.render(scene, **knobs).rgba
    half = replace(EVEN, opacity=((0.0, float(-np.expm1(-0.5 * SIGMA))),))
    plain = stage.render(replace(scene, transfer_function=half), **knobs).rgba
    np.testing.assert_allclose(found, plain, atol=3e-4)
    assert found[..., 3].max() > 0.4
    if classification == "post":
        _, enter, leave = path_of(scene)
        true = composed(0.5 * SIGMA * np.maximum(leave - enter, 0.0), COLOR).reshape(32, 32, 4)
        inside = (leave - enter > 6.0).reshape(32, 32)
        np.testing.assert_allclose(found[inside], true[inside], atol=0.01)


@NUMPY
@pytest.mark.parametrize(("classification", "depth_rule"), RULES)
@pytest.mark.parametrize("mode", ("composite", "xray"))
def test_a_field_that_grows_steeper_outwards(stage, classification, depth_rule, mode, way):
    """The square of the radius has a gradient of twice the radius, and central differences find it exactly."""
    scene = stage.on_turntable(
        radius_from_center(16) ** 2, 35.0, 25.0, size=(32, 32), transfer_function=steep(4.0, 14.0), mode=mode
    )
    rays, enter, leave = path_of(scene)
    center = (scene.index_to_world @ (7.5, 7.5, 7.5, 1.0))[:3]
    share = (np.arange(400) + 0.5) / 400
    depth = enter[:, None] + (leave - enter)[:, None] * share
    points = rays.origin[:, None] + rays.step[:, None] * depth[..., None]
    radius = np.linalg.norm(points - center, axis=2)
    factor = np.clip((2.0 * radius - 4.0) / 10.0, 0.0, 1.0).mean(axis=1)
    color = COLOR if mode == "composite" else (1.0, 1.0, 1.0)
    true = composed(SIGMA * factor * np.maximum(leave - enter, 0.0), color).reshape(32, 32, 4)
    inside = (leave - enter > 10.0).reshape(32, 32)
    knobs = dict(classification=classification, depth_rule=depth_rule, sheet_density=2.0)
    found = stage.render(scene, **knobs).rgba
    assert true[inside][:, 3].std() > 0.015
    ramps = classification == "pre" and mode == "composite"  # half a voxel at either end, there
    error = (found - true)[inside]
    assert np.abs(error).max() < (0.08 if ramps else 0.03) and abs(error.mean()) < (0.05 if ramps else 0.006)


def test_sizes_of_gradients_whatever_the_spacing_the_type_and_what_is_no_number(way):
    z, y, x = np.mgrid[:7, :6, :5].astype(float)
    field = 3.0 * x - 4.0 * y + 12.0 * z
    affine = np.diag((2.0, 0.5, 3.0, 1.0))
    affine[:3, :3] = np.array(((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))) @ affine[:3, :3]
    everything = np.arange(0, 7 * 6 * 5 + 1, 5), np.tile(np.arange(5, dtype=np.uint16), 42)
    true = 2.0 * np.hypot(np.hypot(3.0 / 2.0, 4.0 / 0.5), 12.0 / 3.0)
    for dtype in (np.int16, np.float32):
        volume = Volume(field.astype(dtype), affine, slope=-2.0)
        np.testing.assert_allclose(gradient_sizes(volume, *everything), true, rtol=1e-6)
    field[3, 3, 3] = np.nan
    assert np.isfinite(gradient_sizes(Volume(field.astype(np.float32), affine), *everything)).all()


def test_threads_and_numpy_make_the_same_picture(stage):
    rng = np.random.default_rng(4)
    tf = replace(EVEN, opacity=((0.0, 0.0), (1.0, 0.4)), shade=Shade(0.2, 0.6, 0.3, 9.0))
    scene = stage.on_turntable(
        rng.random((12, 12, 12)), 20.0, 30.0, size=(40, 40), transfer_function=steep(0.2, 0.5, tf), headlight=True
    )
    one, two = (stage.render(scene, classification="post", threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.rgba, two.rgba)
    with use_reference():
        reference = stage.render(scene, classification="post")
    np.testing.assert_allclose(one.rgba, reference.rgba, atol=2e-3)
    plain = stage.render(replace(scene, transfer_function=tf), classification="post")
    assert np.abs(one.rgba - plain.rgba).max() > 0.1


@pytest.mark.parametrize("classification", ("pre", "post"))
def test_off_is_the_picture_without_it_and_measures_no_gradient(stage, classification):
    scene = stage.on_turntable(radius_from_center(12), size=(24, 24), transfer_function=steep(0.2, 0.9))
    cache, quality = StageCache(), Quality(classification=classification)
    off = render(replace(scene, effects={"gradient opacity": False}), quality, cache=cache)
    plain = render(replace(scene, transfer_function=EVEN), quality)
    np.testing.assert_array_equal(off.rgba.view(np.uint32), plain.rgba.view(np.uint32))
    assert not {"gradients", "thinned", "lights"} & set(cache.made)
    row = next(e for e in render(scene, quality).report["effects"] if e["name"] == "gradient opacity")
    assert row["on"] and row["reason"] == "from 0.2 to 0.9 values per unit of length"


def test_json_and_what_is_refused(stage):
    tf = steep(2.0, 8.0)
    assert TransferFunction.from_json(tf.to_json()) == tf and tf.key != EVEN.key
    assert tf.remapped(0.0, 0.0).gradient_opacity == tf.gradient_opacity
    assert "gradient_opacity" not in EVEN.to_json()
    bent = replace(tf, gradient_opacity=GradientOpacity(2.0, 8.0, ((0.0, 0.2), (0.5, 1.0), (1.0, 0.0))))
    assert TransferFunction.from_json(bent.to_json()) == bent and bent.key != tf.key
    np.testing.assert_allclose(bent.gradient_opacity.factor([0, 3.5, 5, 6.5, 9]), [0.2, 0.6, 1, 0.5, 0], atol=1e-6)
    wrongs = ({"low": 3, "high": 1}, {"low": -1}, {"slope": 2}, {"low": "steep"}, {"curve": [[0, 2]]}, {"curve": []},
              {"curve": 3})  # fmt: skip
    for wrong in wrongs:
        with pytest.raises(RleSplatError, match="gradient"):
            TransferFunction.from_json(EVEN.to_json() | {"gradient_opacity": wrong})
    scene = stage.on_turntable(radius_from_center(8), transfer_function=tf)
    with pytest.raises(RleSplatError, match="no reference of a transfer function with gradient opacity"):
        truth(scene, "T2")
