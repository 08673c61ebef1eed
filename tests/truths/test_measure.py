"""Proves the measurement after a render: it finds a fault where one is, calls the truth by name, knows crop and
surfaces, and gives the same answer as comparing every pixel."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.phantoms import blobs
from rle_splat.accuracy.metrics import LEVEL
from rle_splat.scene import RleSplatError
from tests.truths.measure import measure


@pytest.fixture(scope="module")
def scene(stage):
    return stage.on_turntable(blobs((16, 14, 12), 5), perspective=True, size=(40, 32))


@pytest.mark.parametrize("which", ("T1", "T2"))
def test_a_true_picture_has_no_error(stage, scene, which):
    true, _ = stage.truth(scene, which)
    found = measure(scene, true, which, 0.01, count=400)
    assert found["truth"] == which and found["kept"] and found["largest"] < 1e-3
    assert found["random"]["count"] > 250 and found["steep"]["count"] == 100
    other = measure(scene, true, "T2" if which == "T1" else "T1", 0.01, count=400)
    assert other["largest"] > 1.0 and not other["kept"]


def test_all_pixels_probed_is_the_whole_comparison(stage, scene):
    true, _ = stage.truth(scene)
    picture = stage.render(scene, depth_rule="slice").rgba
    found = measure(scene, picture, "T1", 1.0, count=4 * 40 * 32)
    assert found["largest"] == pytest.approx(np.abs(picture - true).max() / LEVEL, abs=1e-3)
    spoilt = true + 3.0 * LEVEL
    found = measure(scene, spoilt, "T1", 2.0, count=400)
    assert found["random"]["failed"] == found["random"]["count"] and found["share"] == 1.0
    assert found["largest"] == pytest.approx(3.0, abs=1e-3)


def test_a_crop_is_measured_where_it_lies(stage, scene):
    true, _ = stage.truth(scene)
    cropped = replace(scene, crop=(9, 4, 33, 26))
    assert measure(cropped, true[4:26, 9:33], "T1", 0.01, count=200)["kept"]
    assert not measure(cropped, true[5:27, 9:33], "T1", 0.01, count=200)["kept"]


def test_surfaces_end_the_rays(stage, scene):
    far = np.where(np.arange(32)[:, None] < 16, np.full((32, 40), 27.0), np.inf)
    true, _ = stage.truth(scene, far=far.ravel())
    assert np.abs(true - stage.truth(scene)[0]).max() > 0.05
    assert measure(scene, true, "T1", 0.01, count=400, far=far)["kept"]
    assert not measure(scene, true, "T1", 0.01, count=400)["kept"]


def test_an_unknown_truth_is_refused(scene):
    with pytest.raises(RleSplatError, match="There is no reference called 'T3'"):
        measure(scene, np.zeros((32, 40, 4)), "T3", 1.0)
