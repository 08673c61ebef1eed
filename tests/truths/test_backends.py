"""Proves that a machine without numba, and any number of threads, gets the same picture."""

import numpy as np
import pytest

from benchmarks.phantoms import FIELDS
from rle_splat.pipeline.render import render
from rle_splat.scene import WARP_FILTERS, Quality
from tests.ways import both


@pytest.fixture(scope="module")
def scene(stage):
    return stage.on_turntable(FIELDS["smooth"](16)[:, :13, :11], perspective=True, size=(32, 28))


@pytest.mark.parametrize("model", ("extinction", "opacity"))
@pytest.mark.parametrize("depth_rule", ("slice", "simpson"))
@pytest.mark.parametrize("warp_filter", WARP_FILTERS)
def test_numpy_equals_numba(stage, scene, model, depth_rule, warp_filter):
    knobs = dict(model=model, depth_rule=depth_rule, warp_filter=warp_filter)
    fast, slow = both(lambda: stage.render(scene, **knobs))
    assert np.abs(fast.rgba - slow.rgba).max() < 1e-5 and fast.rgba.max() > 0.3
    # Half transmittance may be reached a sheet sooner or later by rounding, on hardly any pixel.
    assert (np.abs(fast.depth - slow.depth) > 1e-3).mean() < 0.005


def test_numpy_equals_numba_for_the_paper_and_with_stops(stage, scene):
    paper = both(lambda: render(scene, Quality.paper()).rgba)
    assert np.abs(paper[0] - paper[1]).max() < 1e-5 and paper[0].max() > 0.3
    wall = np.array((((-99.0, 6.0, -99.0), (99.0, 6.0, -99.0), (99.0, 7.0, 99.0)),
                     ((-99.0, 6.0, -99.0), (99.0, 7.0, 99.0), (-99.0, 7.0, 99.0))))  # fmt: skip
    stopped = stage.before(scene.volume, scene.camera, (32, 28), volume_matrix=scene.volume_matrix, triangles=wall)
    pictures = both(lambda: stage.render(stopped).rgba)
    assert np.abs(pictures[0] - pictures[1]).max() < 1e-5
