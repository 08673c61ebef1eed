"""Averages of extinction are those of numpy."""

import sys

import numpy as np
import pytest

from rle_splat.classify.visible import VisibleVoxels
from rle_splat.encode.pooling import pool_steps
from rle_splat.runtime.steps import drain


@pytest.mark.parametrize("side", [1, 2, 4, 64])
@pytest.mark.parametrize("at_once", [1, 1 << 22])
def test_a_node_is_the_average_of_its_cube(side, at_once, way, monkeypatch):
    """Against numpy's own mean, with nothing beyond the volume's ends."""
    monkeypatch.setattr(sys.modules[pool_steps.__module__], "VOXELS_AT_ONCE", at_once)
    field = (0.9 * np.random.default_rng(4).random((13, 50, 29)) ** 3).astype(np.float32)
    kept = field >= 0.3
    starts = np.concatenate(([0], np.cumsum(kept.reshape(-1, 29).sum(axis=1))))
    column = np.nonzero(kept)[2].astype(np.uint16)
    voxels = VisibleVoxels((29, 50, 13), starts, np.zeros(len(starts) - 1, np.int32), column, field[kept], 0)
    means = drain(pool_steps(voxels, field[kept], side, threads=2))
    padded = np.pad(np.where(kept, field, 0.0).astype(np.float64), [(0, -n % side) for n in field.shape])
    nz, ny, nx = (n // side for n in padded.shape)
    expected = padded.reshape(nz, side, ny, side, nx, side).mean(axis=(1, 3, 5))
    assert means.shape == expected.shape and means.max() > 0.0
    np.testing.assert_allclose(means, expected, rtol=2e-6)
