"""Proves that the quality presets buy what they promise: each keeps its error, pre against T1 and post against T2.

The bounds are about one and a half times what was measured.
"""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.phantoms import FIELDS, blobs
from rle_splat.accuracy.metrics import difference
from rle_splat.accuracy.truths import truth
from rle_splat.pipeline.render import render
from rle_splat.scene import QUALITY_PRESETS, Quality

MEASURED = slice(1, None, 2)  # rows and columns: the truth of all pixels took four times as long
# What each preset of pre may err: RMSE and maximum in levels, orthographic and in perspective.
PRESET_BOUNDS = {
    ("smooth", "draft"): ((0.86, 5.7), (0.61, 4.2)),
    ("smooth", "standard"): ((0.115, 0.86), (0.12, 1.2)),
    ("smooth", "fine"): ((0.072, 0.54), (0.086, 1.85)),
    ("smooth", "strict"): ((0.023, 0.11), (0.023, 0.15)),
    ("thin", "draft"): ((3.0, 30.0), (2.0, 32.0)),
    ("thin", "standard"): ((0.48, 5.8), (0.35, 7.3)),
    ("thin", "fine"): ((0.26, 3.2), (0.32, 7.3)),
    ("thin", "strict"): ((0.071, 0.66), (0.071, 0.98)),
    ("binary", "draft"): ((6.8, 98.0), (5.3, 124.0)),
    ("binary", "standard"): ((1.85, 32.0), (0.82, 25.0)),
    ("binary", "fine"): ((0.53, 11.6), (0.69, 31.0)),
    ("binary", "strict"): ((0.14, 2.8), (0.135, 4.9)),
}
# The same of post, against T2.
POST_BOUNDS = {
    ("smooth", "draft"): ((2.65, 18.3), (2.7, 19.6)),
    ("smooth", "standard"): ((0.35, 2.6), (0.36, 3.3)),
    ("smooth", "fine"): ((0.14, 1.3), (0.15, 1.3)),
    ("smooth", "strict"): ((0.06, 0.6), (0.065, 0.7)),
    ("thin", "draft"): ((11.1, 90.0), (12.0, 96.0)),
    ("thin", "standard"): ((3.1, 23.0), (3.0, 26.0)),
    ("thin", "fine"): ((0.6, 9.5), (0.57, 5.5)),
    ("thin", "strict"): ((0.145, 3.0), (0.115, 1.9)),
    ("binary", "draft"): ((18.5, 194.0), (18.2, 220.0)),
    ("binary", "standard"): ((6.3, 83.0), (6.6, 140.0)),
    ("binary", "fine"): ((2.1, 25.0), (1.9, 20.0)),
    ("binary", "strict"): ((0.47, 8.0), (0.31, 3.9)),
}


@pytest.fixture(scope="module")
def with_truth(stage):
    @cache
    def scene_and_truth(name, perspective, truth_name="T1"):
        scene = stage.on_turntable(FIELDS[name](48), perspective=perspective, fov=41.0)
        columns, rows = np.meshgrid(*(np.arange(size)[MEASURED] + 0.5 for size in (scene.width, scene.height)))
        rgba, _ = truth(scene, truth_name, pixels=(columns.ravel(), rows.ravel()), tolerance=1e-7)
        return scene, rgba.reshape(*columns.shape, 4)

    return scene_and_truth


@pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("classification", ("pre", "post"))
def test_each_preset_keeps_its_error_and_the_next_has_less(with_truth, classification, name, perspective):
    truth_name, bounds = {"pre": ("T1", PRESET_BOUNDS), "post": ("T2", POST_BOUNDS)}[classification]
    scene, true = with_truth(name, perspective, truth_name)
    found = {}
    for preset in QUALITY_PRESETS:
        rendering = render(scene, Quality.preset(preset, classification=classification))
        assert rendering.report["error"]["truth"] == truth_name
        found[preset] = error = difference(rendering.rgba[MEASURED, MEASURED], true)
        rmse, largest = bounds[name, preset][perspective]
        assert error.rmse < rmse and error.largest < largest, preset
        assert abs(error.bias) < 0.3 * rmse + 0.03, "a picture shifted or thinned as a whole shows here first"
    errors = {preset: error.rmse for preset, error in found.items()}
    assert all(finer < 0.97 * coarser for coarser, finer in pairwise(errors.values())), errors


@pytest.mark.parametrize(
    "azimuth, elevation, perspective",
    (
        *((azimuth, 0, bool(number % 2)) for number, azimuth in enumerate((0, 90, 180, -90))),
        (0, 90, False), (0, -90, True), (45, 0, False), (135, 0, True), (45, 35.26439, False), (45, 35.26439, True),
        (-45, -35.26439, False), (20, 70, True), (160, -50, False), (-70, 15, True), (-160, -10, False),
        (1e-7, 1e-7, True), (44.999, 0.001, False), (44.999, 0.001, True),
    ),
)  # fmt: skip
def test_every_side(stage, azimuth, elevation, perspective):
    """All six principal axes and both signs, ties at 45 degrees and on the diagonal, a view a hair off an axis."""
    field = blobs((21, 18, 15), 4, width=(1.6, 2.6))
    scene = stage.on_turntable(field, azimuth, elevation, perspective, size=(40, 48), spacing=(1.0, 1.2, 0.9))
    found = stage.error(scene, sheet_density=4.0)
    assert found.rmse < 0.15 and found.largest < 1.8
