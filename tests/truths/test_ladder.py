"""Proves that the quality knobs buy what they promise: errors against T1 stay near the table of algorithm.md 2.4.

The bounds are about one and a half times what was measured; the comments give the table's RMSE / max.
"""

from functools import cache

import pytest

from rle_splat.accuracy.phantoms import FIELDS

RUNGS = {
    "draft": dict(depth_rule="slice", sheet_density=1.0, warp_filter="bilinear", termination=1 / 1024),
    "preview": dict(depth_rule="simpson", sheet_density=1.0, warp_filter="cubic", termination=1 / 1024),
    "standard": dict(depth_rule="simpson", sheet_density=1.5, warp_filter="cubic", termination=1 / 1024),
}
# RMSE and max in levels.
BOUNDS = {
    ("smooth", "draft"): (1.0, 8.0),  # 0.83 / 6.6 at density 0.73
    ("smooth", "preview"): (0.10, 0.70),  # 0.064 / 0.40
    ("smooth", "standard"): (0.10, 0.60),  # 0.062 / 0.36
    ("thin", "draft"): (2.5, 30.0),  # 2.26 / 29 at density 0.73
    ("thin", "preview"): (0.55, 9.0),  # 0.33 / 5.9
    ("thin", "standard"): (0.13, 2.0),  # 0.076 / 1.09
    ("binary", "draft"): (5.0, 70.0),  # 4.34 / 69 at density 0.73
    ("binary", "preview"): (2.0, 45.0),  # 1.31 / 31
    ("binary", "standard"): (0.65, 16.0),  # 0.41 / 10.1
}


@pytest.fixture(scope="module")
def judged(stage):
    @cache
    def scene_and_truth(name, perspective):
        scene = stage.on_turntable(FIELDS[name](48), perspective=perspective, fov=41.0)
        return scene, stage.truth(scene)[0]

    return scene_and_truth


@pytest.mark.parametrize("rung", RUNGS)
@pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
@pytest.mark.parametrize("name", FIELDS)
def test_error_of_a_rung(stage, judged, name, perspective, rung, record_property):
    scene, true = judged(name, perspective)
    found = stage.error(scene, true, **RUNGS[rung])
    record_property("levels", f"rmse {found.rmse:.3f} max {found.largest:.2f} bias {found.bias:.4f}")
    rmse, largest = BOUNDS[name, rung]
    assert found.rmse < rmse and found.largest < largest
    assert abs(found.bias) < 0.3 * rmse  # a picture shifted or thinned as a whole shows here first


@pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
@pytest.mark.parametrize("azimuth, elevation", (
    (0, 0), (90, 0), (180, 0), (-90, 0), (0, 90), (0, -90), (45, 0), (135, 0), (45, 35.26439), (-45, -35.26439),
    (20, 70), (160, -50), (-70, 15), (-160, -10), (1e-7, 1e-7), (44.999, 0.001),
))
def test_every_side(stage, azimuth, elevation, perspective):
    """All six principal axes and both signs, ties at 45 degrees and on the diagonal, a view a hair off an axis."""
    field = FIELDS["smooth"](20)[:, :17, :13]
    scene = stage.on_turntable(field, azimuth, elevation, perspective, size=(40, 48), spacing=(1.0, 1.2, 0.9))
    found = stage.error(scene)
    assert found.rmse < 0.25 and found.largest < 2.0
