"""Proves how evenly light lies on a smooth surface, and how much light errs by itself, as light.md states both."""

import numpy as np
import pytest

from benchmarks.frames import view_scene
from benchmarks.light import NAMES, errors_of_light
from benchmarks.planning_scenes import calibration_volumes
from benchmarks.ripple import BODIES, body, lit_pixels, lit_scene, normals_at
from rle_splat.pipeline.render import render
from rle_splat.scene import Quality

# Levels at 99 of 100 pixels, under each of the lamps.
BOUNDS = {"draft": 60.0, "standard": 20.0, "fine": 13.0, "strict": 4.0}


@pytest.mark.parametrize("quality, most", (("draft", 1.0), ("standard", 0.5), ("fine", 0.5)))
@pytest.mark.parametrize("name", BODIES)
def test_a_hard_wall_is_lit_evenly(name, quality, most):
    """Percent from 1 to 99 %, over single rays through the same codes."""
    scene = lit_scene(body(BODIES[name], 4.0), "step", "sun, no shadows")
    where = lit_pixels(scene, normals_at(scene, BODIES[name]))
    assert where.sum() > 10_000
    rays = render(scene, Quality(rays=1e-5)).rgba[where]
    found = render(scene, Quality.preset(quality)).rgba[where]
    ratio = found[:, 0] * rays[:, 3] / (rays[:, 0] * found[:, 3])
    assert 100.0 * np.diff(np.quantile(ratio, (0.01, 0.99)))[0] < most


@pytest.mark.parametrize("name", ("head", "part", "cloud, lit"))
def test_light_keeps_the_bounds_of_its_page(name):
    volume, function = next((one, own) for found, one, own, _ in calibration_volumes() if found == name)
    scene = view_scene(volume, function, (30, 15), 200, shaded=False)
    qualities = {quality: Quality.preset(quality) for quality in BOUNDS}
    rows = errors_of_light(scene, NAMES, qualities, 700)
    assert len(rows) == len(NAMES) * len(BOUNDS) and all(row["pixels"] > 150 for row in rows)
    for row in rows:
        assert row["own"]["p99"] < BOUNDS[row["quality"]], row
