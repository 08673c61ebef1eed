"""Averages of extinction are those of numpy."""

import numpy as np
import pytest

from rle_splat.encode.pooling import pool_steps
from rle_splat.pipeline.scan_source import scan_source
from rle_splat.pipeline.source import Work
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.steps import Clock, drain
from rle_splat.scene import Quality


@pytest.mark.parametrize("level", [1, 2, 3, 6])
def test_a_node_is_the_average_of_its_cube(stage, level, way):
    """Against numpy's own mean of the volume's extinction and emission, with nothing beyond its ends."""
    field = (0.9 * np.random.default_rng(4).random((13, 50, 29)) ** 3).astype(np.float32)
    field[field < 0.3] = 0.0
    scene = stage.on_turntable(field)
    quality = Quality(classification="pre", threads=2)
    lit = drain(scan_source(scene, quality).medium_steps(Work(StageCache(0).job(), Clock()))).voxels
    voxels, write = lit.classified.voxels, lit.write_records("extinction")
    means = drain(pool_steps(voxels, write, level, threads=2))
    side, extinction = 2**level, -np.log1p(-field.astype(np.float64))
    emission = np.concatenate((extinction[..., None] * stage.color(field), extinction[..., None]), axis=3)
    padded = np.pad(emission, [(0, -n % side) for n in field.shape] + [(0, 0)])
    nz, ny, nx = (n // side for n in padded.shape[:3])
    expected = padded.reshape(nz, side, ny, side, nx, side, 4).mean(axis=(1, 3, 5))
    assert means.shape == expected.shape and means.max() > 0.0
    np.testing.assert_allclose(means[..., 3], expected[..., 3], rtol=2e-6)
    np.testing.assert_allclose(means[..., :3], expected[..., :3], rtol=2e-5)
