"""Proves observed orders and known constants of every knob's error (Etiene and others 2014; algorithm.md 2.3): a
shift by half a voxel, a missing attenuation inside a sheet or a footprint too wide passes a threshold, not a slope."""

import math

import numpy as np
import pytest

from benchmarks.phantoms import FIELDS, blobs
from rle_splat.accuracy.metrics import LEVEL, difference
from rle_splat.accuracy.rays import camera_rays
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.scene import WARP_FILTERS
from tests.truths import closed_forms


def columns_of(profile, across=6):
    """(n, across, across): the same values in every column along z."""
    return np.broadcast_to(np.asarray(profile)[:, None, None], (len(profile), across, across))


def down_a_column(stage, extinction, thickness=1.0, **more):
    """A scene that looks down z at a medium of the given extinctions, one a slice, and nothing else."""
    field = columns_of(-np.expm1(-np.asarray(extinction)))
    fit = 1.0 / max(6.0, len(field) * thickness)  # the picture is one unit of the six across
    return stage.on_turntable(field, 0.0, 90.0, size=(4, 4), fit=fit, spacing=(1.0, 1.0, thickness), **more)


def color_error(stage, rule, count):
    """Levels: the largest error of color and of alpha on one ray through a smooth body cut into ``count`` slices."""
    h = 16.0 / count
    z = (np.arange(count) + 0.5) * h - 8.0
    scene = down_a_column(stage, 0.5 * np.exp(-0.5 * (z / 2.2) ** 2), h)
    true = stage.truth(scene)[0][1:3, 1:3]
    found = stage.render(scene, depth_rule=rule, termination=0.0, sheet_density=1.0).rgba[1:3, 1:3]
    error = np.abs(found - true).max(axis=(0, 1)) / LEVEL
    return error[:3].max(), error[3]


# Errors of color beside that of slice planes, on smooth data along an axis: what is left is that color and
# extinction are taken as constant in a slab, so the constant is that of the slabs' widths.
CONSTANTS = {
    "slice": 1.0, "midpoint-1": 2.0, "midpoint-2": 0.5, "midpoint-4": 0.125, "simpson": 1 / 3, "gauss2": 1 / 3.73,
}  # fmt: skip


def test_every_depth_rule_has_second_order_color_and_its_own_constant(stage):
    coarse, fine = ({rule: color_error(stage, rule, count) for rule in CONSTANTS} for count in (24, 48))
    for rule, constant in CONSTANTS.items():
        assert 1.9 < math.log2(coarse[rule][0] / fine[rule][0]) < 2.1, rule
        assert fine[rule][0] / fine["slice"][0] == pytest.approx(constant, rel=0.04), rule
        # Along an axis every rule integrates the tent's straight lines exactly.
        assert coarse[rule][1] < 2e-4 and fine[rule][1] < 2e-4


@pytest.mark.parametrize("width", (0.5, 0.6, 0.7))
@pytest.mark.parametrize("phase", (0.0, 0.25, 0.5))
def test_transmittance_of_a_gaussian_converges_spectrally(stage, width, phase):
    """G3: slice planes are trapezoids, whose error on a Gaussian is 2 exp(-2 pi^2 s^2) cos(2 pi phase) and no more."""
    extinction = 0.3 * np.exp(-0.5 * ((np.arange(16) - 8.0 - phase) / width) ** 2)
    alpha = stage.render(down_a_column(stage, extinction), depth_rule="slice", termination=0.0).rgba[1, 1, 3]
    relative = -np.log1p(-np.float64(alpha)) / (0.3 * width * np.sqrt(2.0 * np.pi)) - 1.0
    expected = 2.0 * np.exp(-2.0 * (np.pi * width) ** 2) * np.cos(2.0 * np.pi * phase)
    assert relative == pytest.approx(expected, rel=1e-3, abs=2e-6)


def test_transmittance_across_the_tents_kinks_is_of_second_order(stage):
    """Seen obliquely a ray crosses cells between slices: the order falls from spectral to two."""
    errors = []
    for count in (12, 24, 48):
        h = 16.0 / count
        at = (np.arange(count) + 0.5) * h - 8.0
        z, y, x = np.meshgrid(at, at, at, indexing="ij")
        extinction = 0.4 * np.exp(-0.5 * ((x - 1.0) ** 2 + (y + 1.0) ** 2 + z * z) / 2.0**2)
        scene = stage.on_turntable(-np.expm1(-extinction), 35.0, 25.0, size=(40, 40), spacing=(h, h, h))
        found = stage.render(scene, depth_rule="slice", sheet_density=4.0, termination=0.0).rgba[..., 3]
        errors.append(difference(found, stage.truth(scene)[0][..., 3]).rmse)
    assert 1.7 < math.log2(errors[0] / errors[1]) < 2.6 and 1.8 < math.log2(errors[1] / errors[2]) < 2.5, errors


def white(opacity):
    return TransferFunction(name="white", opacity=opacity, color=((0.0, 1.0, 1.0, 1.0),), opacity_unit_distance=1.0,
                            shade=None)  # fmt: skip


@pytest.mark.parametrize("depth_rule", ("slice", "simpson", "gauss2", "midpoint-2"))
def test_gray_medium_emits_half_of_what_it_hides(stage, depth_rule):
    """A7: without the attenuation inside a sheet, phi(tau), thick sheets would emit more than their opacity and every
    rule's order would fall to one.  One white voxel, out of sight, keeps colors from being clamped to what they
    should be anyway."""
    field = columns_of(-np.expm1(-np.array((0.0, 0.2, 3.0, 0.7, 0.05, 1.1, 0.0))), 16).copy()
    field[0, 0, 0] = 0.999
    gray = TransferFunction(name="gray", opacity=((0.0, 0.0), (1.0, 1.0)), opacity_unit_distance=1.0, shade=None,
                            color=((0.99, 0.5, 0.5, 0.5), (0.999, 1.0, 1.0, 1.0)))  # fmt: skip
    for tilt in (0.0, 35.0):
        scene = stage.on_turntable(field, tilt, 90.0 - tilt, size=(8, 8), fit=0.2, transfer_function=gray)
        rgba = stage.render(scene, depth_rule=depth_rule, termination=0.0).rgba
        assert rgba[..., 3].min() > 0.9
        assert np.abs(rgba[..., :3] - 0.5 * rgba[..., 3:]).max() < 1e-6


def blurred_blob(stage, kernel, count):
    """(rmse of optical depth, how many times h^2 laplacian(tau) it is) of a Gaussian blob seen along an axis."""
    h, peak, width = 16.0 / count, 0.3, 1.5
    at = (np.arange(count) + 0.5) * h - 8.0
    z, y, x = np.meshgrid(at, at, at, indexing="ij")
    field = -np.expm1(-peak * np.exp(-0.5 * (x * x + y * y + z * z) / width**2))
    scene = stage.on_turntable(field, 0.0, 0.0, size=(40, 40), fit=0.8, spacing=(h, h, h))
    rays = camera_rays(scene.camera, 40, 40)
    center = (scene.index_to_world @ (*[0.5 * (count - 1)] * 3, 1.0))[:3]
    tau = closed_forms.gaussian_tau(rays, center, peak, width)
    b = closed_forms.distance_to_axis(rays, center)
    laplacian = tau * (b * b / width**4 - 2.0 / width**2)
    knobs = dict(kernel=kernel, depth_rule="slice", sheet_density=4.0, termination=0.0)
    error = -np.log1p(-stage.render(scene, **knobs).rgba[..., 3].ravel().astype(np.float64)) - tau
    return np.sqrt(np.mean(error**2)), (error @ laplacian) / (laplacian @ laplacian) / h**2


# Order, and half the kernel's variance in voxels^2: what it blurs by, (n + 1) / 24 for the B-spline of degree n.
BLURS = {
    "nearest": (1, None), "tent": (2, 2 / 24), "bspline2": (2, 3 / 24), "bspline3": (2, 4 / 24),
    "gaussian": (2, 0.7**2 / 2),
}  # fmt: skip


@pytest.mark.parametrize("kernel", BLURS)
def test_footprints_have_their_order_and_their_blur(stage, kernel):
    order, blur = BLURS[kernel]
    (coarse, _), (fine, constant) = (blurred_blob(stage, kernel, count) for count in (32, 64))
    assert math.log2(coarse / fine) == pytest.approx(order, abs=0.12)
    if blur is not None:
        assert constant == pytest.approx(blur, rel=0.05)


@pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
def test_sheet_density(stage, perspective):
    """Sheets of cubic splines, twice differentiable: rho^-2 with a bilinear warp and steeper with the cubic one.
    Sheets of tents have kinks, on which no filter does better than about rho^-1.5."""
    field = blobs((16, 16, 16), 3, count=5, width=(1.6, 2.4))
    scene = stage.on_turntable(field, 35.0, 25.0, perspective, size=(48, 48))
    rmse = {}
    for kernel, warp_filter in (
        ("bspline3", "bilinear"), ("bspline3", "keys"), ("bspline3", "cubic"), ("tent", "cubic"),
    ):  # fmt: skip
        knobs = dict(kernel=kernel, depth_rule="slice", termination=0.0)
        best = stage.render(scene, sheet_density=8.0, warp_filter="cubic", **knobs).rgba
        rmse[kernel, warp_filter] = [
            difference(stage.render(scene, sheet_density=rho, warp_filter=warp_filter, **knobs).rgba, best).rmse
            for rho in (0.5, 1.0, 2.0)
        ]
    half, one, two = rmse["bspline3", "bilinear"]
    assert math.log2(half / one) == pytest.approx(2.0, abs=0.1)
    assert math.log2(one / two) == pytest.approx(2.0, abs=0.1)
    _, one, two = rmse["bspline3", "keys"]
    assert math.log2(one / two) == pytest.approx(3.0, abs=0.3)
    _, one, two = rmse["bspline3", "cubic"]
    assert math.log2(one / two) > 2.9
    _, one, two = rmse["tent", "cubic"]
    assert math.log2(one / two) == pytest.approx(1.6, abs=0.3)


def test_warp_error_falls_with_the_sheet_density(stage):
    """Cubic beats Keys, Keys bilinear, and all fall at least linearly on a thin shell; depth errors are taken out by
    comparing with a picture of much higher density."""
    scene = stage.on_turntable(FIELDS["thin"](24), size=(64, 64))
    knobs = dict(depth_rule="slice", termination=0.0)
    best = stage.render(scene, sheet_density=6.0, **knobs).rgba
    rmse = {
        (name, density): difference(
            stage.render(scene, sheet_density=density, warp_filter=name, **knobs).rgba, best
        ).rmse
        for name in WARP_FILTERS
        for density in (1.0, 2.0)
    }
    assert rmse["bilinear", 1.0] / rmse["bilinear", 2.0] > 2.0
    assert rmse["keys", 1.0] / rmse["keys", 2.0] > 2.3
    assert rmse["cubic", 1.0] / rmse["cubic", 2.0] > 2.5
    assert rmse["cubic", 1.0] < rmse["keys", 1.0] < 0.9 * rmse["bilinear", 1.0]
    assert rmse["cubic", 2.0] < rmse["keys", 2.0] < 0.9 * rmse["bilinear", 2.0]
    assert rmse["cubic", 1.0] < 0.8 * rmse["bilinear", 1.0] and rmse["cubic", 2.0] < 0.75 * rmse["bilinear", 2.0]


def blocks(values, depth):
    """(depth, 6, 6 n) opacities in n blocks side by side along x, six voxels wide each."""
    return np.broadcast_to(np.repeat(values, 6), (depth, 6, 6 * len(values)))


def middles(stage, scene, count, **knobs):
    """(count, 4) float64 picture in the middle of each block, looking down."""
    rays = camera_rays(scene.camera, scene.width, scene.height)
    index = rays.origin @ np.linalg.inv(scene.index_to_world)[:3, :3].T + np.linalg.inv(scene.index_to_world)[:3, 3]
    wanted = np.stack((6.0 * np.arange(count) + 2.5, np.full(count, 2.5)), axis=1)
    nearest = np.abs(index[None, :, :2] - wanted[:, None]).max(axis=-1).argmin(axis=1)
    knobs = dict(termination=0.0, sheet_density=1.0) | knobs
    return stage.render(scene, **knobs).rgba.reshape(-1, 4)[nearest].astype(np.float64)


QUANTUM = 2.0**-12  # half a step of color, of 1, and of density, relative, of 8 bytes: encode/records.py's table


def test_records_err_by_their_quantum(stage):
    """Blocks so thick that only their color shows, and so thin that their density does, beside one that sets the
    scale: never more than half a step, and nearly that somewhere."""
    thick = np.linspace(0.2, 0.9, 16)
    scene = stage.on_turntable(blocks(thick, 100), 0.0, 90.0, size=(192, 12), fit=12 / 192)
    full, coarse = (middles(stage, scene, 16, record=bytes_) for bytes_ in (16, 8))
    assert full[:, 3].min() > 0.999
    error = np.abs(coarse - full)[:, :3].max()
    # Color and density err alike, and the color that is seen is their quotient.
    assert 0.6 * QUANTUM < error < 2.1 * QUANTUM
    thin = np.geomspace(0.002, 0.02, 15)
    scene = stage.on_turntable(blocks(np.append(thin, 0.95), 40), 0.0, 90.0, size=(192, 12), fit=12 / 192)
    full, coarse = (-np.log1p(-middles(stage, scene, 15, record=bytes_)[:, 3]) for bytes_ in (16, 8))
    error = np.abs(coarse / full - 1.0).max()
    assert 0.6 * QUANTUM < error < 1.05 * QUANTUM
