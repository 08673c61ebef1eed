"""Proves how evenly light lies on a smooth surface, as light.md states it."""

import numpy as np
import pytest

from benchmarks.ripple import BODIES, body, lit_pixels, lit_scene, normals_at
from rle_splat.pipeline.render import render
from rle_splat.scene import Quality


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
