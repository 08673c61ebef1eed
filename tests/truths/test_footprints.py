"""Proves the footprints and depth rules: the shape of one voxel, orders, kernels and reference."""

import math

import numpy as np
import pytest

from benchmarks.phantoms import FIELDS
from rle_splat.accuracy.metrics import difference
from rle_splat.scene import DEPTH_RULES, FOOTPRINTS
from tests.ways import both


def kernel_from_its_definition(name):
    """Each footprint sampled on a fine grid: B-splines as repeated box convolutions, the Gaussian by its formula."""
    step = 1e-3
    t = np.arange(-4.0, 4.0 + step / 2, step)
    box = ((t >= -0.5) & (t < 0.5)).astype(float)
    if name == "gaussian":
        return t, np.where(np.abs(t) <= 3.0, np.exp(-0.5 * (t / 0.7) ** 2), 0.0)
    values = box
    for _ in range({"nearest": 0, "tent": 1, "bspline2": 2, "bspline3": 3}[name]):
        values = np.convolve(values, box, mode="same") * step
    return t, values


@pytest.mark.parametrize("kernel", FOOTPRINTS)
def test_one_voxel_has_the_shape_of_the_kernel(stage, kernel):
    """G8: seen along an axis a single voxel is sigma * beta(u) * beta(v) times the kernel's integral in depth."""
    field = np.zeros((15, 15, 15))
    field[7, 7, 7] = 0.3
    scene = stage.on_turntable(field, 0.0, 0.0, size=(120, 120), fit=0.5)
    rgba = stage.render(scene, kernel=kernel, depth_rule="midpoint-16", sheet_density=2.0, termination=0.0).rgba
    tau = -np.log1p(-rgba[..., 3].astype(np.float64))
    t, values = kernel_from_its_definition(kernel)
    along = (np.arange(120) + 0.5 - 60.0) * (0.5 * 15 / 120)  # voxels from the middle
    lattice = sum(np.interp(along - n, t, values) for n in range(-4, 5)) if kernel == "gaussian" else 1.0
    weight = np.interp(along, t, values) / lattice
    expected = -math.log1p(-0.3) * weight[:, None] * weight[None, :]
    if kernel == "nearest":  # its edges are the warp's business; look inside
        inside = np.abs(along) < 0.3
        np.testing.assert_allclose(tau[np.ix_(inside, inside)], expected[np.ix_(inside, inside)], rtol=1e-4)
    else:
        assert np.abs(tau - expected).max() < 4e-3 * expected.max()


@pytest.mark.parametrize("name, perspective", [("smooth", True), ("thin", False)])
def test_finer_depth_rules_come_nearer_to_the_truth(stage, name, perspective):
    """Simpson and Gauss beat slice planes several times over at the same number of slices; midpoints fall as m**-2."""
    scene = stage.on_turntable(np.pad(FIELDS[name](22), 1), perspective=perspective, size=(48, 48))
    true = stage.truth(scene)[0]
    rmse = {
        rule: difference(stage.render(scene, depth_rule=rule, sheet_density=6.0, termination=0.0).rgba, true).rmse
        for rule in (*DEPTH_RULES, "midpoint-3")
    }
    assert rmse["simpson"] < 0.35 * rmse["slice"] and rmse["gauss2"] < 0.35 * rmse["slice"]
    order = math.log2((rmse["midpoint-1"] - rmse["midpoint-16"]) / (rmse["midpoint-4"] - rmse["midpoint-16"])) / 2
    assert 1.4 < order < 2.6, rmse
    assert rmse["midpoint-4"] < rmse["midpoint-3"] < rmse["midpoint-2"]
    assert rmse["midpoint-16"] < 0.1


@pytest.mark.parametrize("kernel", FOOTPRINTS)
@pytest.mark.parametrize("minification, fit", [("off", 1.25), ("widen", 1.25), ("widen", 6.0)])
def test_numpy_equals_numba(stage, kernel, minification, fit):
    scene = stage.on_turntable(FIELDS["smooth"](20)[:, :17, :13], perspective=True, size=(40, 36), fit=fit)
    knobs = dict(kernel=kernel, minification=minification, depth_rule="gauss2", sheet_density=1.0)
    fast, slow = both(lambda: stage.render(scene, **knobs).rgba)
    if kernel == "nearest":  # a ray on a voxel's border may see either voxel
        assert (np.abs(fast - slow).max(axis=-1) > 1e-5).mean() < 0.02
    else:
        assert np.abs(fast - slow).max() < 1e-5
    assert fast.max() > 0.1


def test_a_minified_picture_does_not_shimmer(stage):
    """A fine checkerboard seen from afar: rays through single voxels beat with the pixels, wide footprints do not."""
    z, _, x = np.mgrid[0:48, 0:48, 0:48]
    scene = stage.on_turntable(0.05 * ((x + z) % 2), 0.0, 0.0, size=(26, 26), fit=1.3)
    inside = (slice(7, 19), slice(7, 19))
    spread = {
        how: np.ptp(stage.render(scene, minification=how, sheet_density=1.0).rgba[(*inside, 3)])
        for how in ("off", "widen")
    }
    assert spread["widen"] < 0.25 * spread["off"] and spread["off"] > 0.01
