"""Proves orders, not only sizes, of errors: a shift by half a voxel passes a threshold but breaks a slope."""

import numpy as np
import pytest

from benchmarks.phantoms import FIELDS
from rle_splat.accuracy.metrics import difference
from rle_splat.scene import WARP_FILTERS

PROJECTIONS = pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))


def shell_and_blob(count):
    """Opacity per world unit of one smooth body 16 units wide on a grid of ``count`` voxels a side."""
    h = 16.0 / count
    along = (np.arange(count) + 0.5) * h - 8.0
    z, y, x = np.meshgrid(along, along, along, indexing="ij")
    r = np.sqrt(x * x + y * y + z * z)
    extinction = 0.5 * np.exp(-0.5 * ((r - 4.5) / 1.0) ** 2)
    extinction += 0.7 * np.exp(-0.5 * ((x - 1) ** 2 + (y + 1) ** 2 + z * z) / 1.2**2)
    return -np.expm1(-np.where(extinction > 1e-5, extinction, 0.0)), h


@PROJECTIONS
def test_depth_rules_are_of_second_order_and_simpson_is_ten_times_better(stage, perspective):
    errors = {}
    for rule in ("slice", "simpson"):
        for count in (16, 32):
            field, h = shell_and_blob(count)
            scene = stage.on_turntable(field, 35.0, 25.0, perspective, size=(48, 48), spacing=(h, h, h))
            knobs = dict(depth_rule=rule, sheet_density=4.0, termination=0.0)
            errors[rule, count] = stage.error(scene, **knobs).rmse
    slope = np.log2(errors["slice", 16] / errors["slice", 32])
    assert 1.6 < slope < 2.5
    assert np.log2(errors["simpson", 16] / errors["simpson", 32]) > 1.6
    assert errors["slice", 16] / errors["simpson", 16] > 5.0


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
