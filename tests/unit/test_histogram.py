"""Histogram and percentiles against numpy's own on the whole array."""

import numpy as np
import pytest

from rle_splat.scene import RleSplatError
from rle_splat.volume.histogram import histogram, percentiles
from rle_splat.volume.volume import STORED_TYPES, Volume

PERCENTS = (0.0, 0.1, 1.0, 25.0, 50.0, 99.0, 99.9, 100.0)


def volume_of(dtype, slope=1.0, intercept=0.0, shape=(5, 7, 11)):
    rng = np.random.default_rng(7)
    kind = np.dtype(dtype)
    if kind.kind == "f":
        voxels = (rng.standard_normal(shape) * 10.0 ** rng.integers(-6, 6, shape)).astype(kind)
    else:
        bounds = np.iinfo(kind)
        voxels = rng.integers(bounds.min, bounds.max, shape, dtype=kind, endpoint=True)
        voxels[0, 0, :2] = bounds.min, bounds.max
    return Volume(voxels, np.eye(4), slope=slope, intercept=intercept)


@pytest.mark.parametrize("slope, intercept", [(1.0, 0.0), (0.5, -1024.0), (-2.0, 3.0)])
@pytest.mark.parametrize("dtype", STORED_TYPES)
def test_percentiles_are_exact_for_every_stored_type(dtype, slope, intercept):
    volume = volume_of(dtype, slope, intercept)
    expected = np.percentile(volume.physical(volume.voxels), PERCENTS, method="inverted_cdf")
    np.testing.assert_array_equal(percentiles(volume, PERCENTS), expected)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_values_that_are_not_finite_are_left_out_and_counted(dtype):
    volume = volume_of(dtype)
    voxels = volume.voxels.copy()
    voxels[1, 2, 3:6] = np.nan, np.inf, -np.inf
    volume = Volume(voxels, np.eye(4))
    finite = voxels[np.isfinite(voxels)].astype(np.float64)
    np.testing.assert_array_equal(percentiles(volume, PERCENTS), np.percentile(finite, PERCENTS, method="inverted_cdf"))
    found = histogram(volume, 16)
    assert found.not_finite == 3
    assert found.total == voxels.size
    np.testing.assert_array_equal(found.counts, np.histogram(finite, 16, (finite.min(), finite.max()))[0])


def test_nothing_finite_gives_zeros_and_counts_everything():
    volume = Volume(np.full((2, 3, 4), np.nan, np.float32), np.eye(4))
    np.testing.assert_array_equal(percentiles(volume, (1, 99)), (0.0, 0.0))
    assert histogram(volume).not_finite == 24


def test_eight_bit_values_have_a_bin_each():
    voxels = np.arange(256, dtype=np.uint8).repeat(3).reshape(3, 16, 16)
    found = histogram(Volume(voxels, np.eye(4), slope=2.0, intercept=-10.0), 256)
    np.testing.assert_array_equal(found.counts, np.full(256, 3))
    np.testing.assert_allclose(found.centers, 2.0 * np.arange(256) - 10.0)


def test_integer_bins_are_whole_steps_wide_so_that_none_is_starved():
    voxels = np.arange(1000, dtype=np.int16).reshape(10, 10, 10)
    found = histogram(Volume(voxels, np.eye(4)), 256)
    assert found.counts.sum() == 1000
    assert set(found.counts) == {4}


def test_constant_volume_fills_one_bin():
    found = histogram(Volume(np.full((2, 2, 2), 7.0, np.float32), np.eye(4)), 8)
    assert found.counts.sum() == found.counts.max() == 8
    assert found.edges[0] < 7.0 < found.edges[-1]


def test_limits_count_what_lies_outside():
    voxels = np.arange(100, dtype=np.float32).reshape(4, 5, 5)
    found = histogram(Volume(voxels, np.eye(4)), 10, (10.0, 20.0))
    assert (found.below, int(found.counts.sum()), found.above) == (10, 11, 79)


@pytest.mark.parametrize("bins, limits", [(0, None), (8, (2.0, 1.0)), (8, (0.0, np.nan))])
def test_senseless_requests_are_refused(bins, limits):
    with pytest.raises(RleSplatError):
        histogram(volume_of("uint8"), bins, limits)


def test_percentiles_beyond_a_hundred_are_refused():
    with pytest.raises(RleSplatError, match="0 to 100"):
        percentiles(volume_of("uint8"), (50.0, 101.0))
