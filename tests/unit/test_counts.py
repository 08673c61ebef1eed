"""Counts of stored values against numpy's, and what follows from them against a look at every voxel."""

import numpy as np
import pytest

from rle_splat.volume.counts import counts_values, list_stored_values
from rle_splat.volume.histogram import histogram, percentiles
from rle_splat.volume.volume import Volume


@pytest.mark.parametrize("shape", ((3, 4, 5), (5, 7, 3), (1, 1, 1)))
@pytest.mark.parametrize("dtype", "uint8 int8 uint16 int16".split())
def test_every_value_is_counted(dtype, shape):
    limits = np.iinfo(dtype)
    voxels = np.random.default_rng(3).integers(limits.min, limits.max + 1, shape).astype(dtype)
    voxels.reshape(-1)[0], voxels.reshape(-1)[-1] = limits.min, limits.max
    volume = Volume(voxels, np.eye(4))
    counts = volume.value_counts
    assert counts.sum() == voxels.size and len(counts) == limits.max - limits.min + 1
    values, times = np.unique(voxels, return_counts=True)
    assert list_stored_values(dtype)[counts > 0].tolist() == values.tolist()
    assert counts[counts > 0].tolist() == times.tolist()


def test_other_types_are_not_counted():
    assert [counts_values(kind) for kind in ("uint8", "int16", "int32", "float32")] == [True, True, False, False]


@pytest.mark.parametrize("slope", (1.0, -0.5))
def test_what_follows_is_what_a_wider_type_finds_voxel_by_voxel(slope):
    voxels = np.random.default_rng(7).integers(-300, 900, (6, 9, 11))
    few, many = (Volume(voxels.astype(kind), np.eye(4), slope=slope, intercept=7.0) for kind in ("int16", "int32"))
    assert few.value_range == many.value_range
    percents = (0.0, 1.0, 37.0, 99.9, 100.0)
    assert percentiles(few, percents).tolist() == percentiles(many, percents).tolist()
    for limits in (None, (-50.0, 120.0)):
        one, two = (histogram(volume, 40, limits) for volume in (few, many))
        for name in ("counts", "edges", "below", "above", "not_finite"):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
        assert one.counts.dtype == two.counts.dtype
