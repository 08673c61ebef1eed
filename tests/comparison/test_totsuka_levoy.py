"""Frequency domain X-rays: the spectrum is the voxels' transform, its slices are sums of optical depth."""

import numpy as np
import pytest

from benchmarks.phantoms import FIELDS, blobs
from rle_splat.accuracy.metrics import difference
from rle_splat.comparison import spectrum, totsuka_levoy
from rle_splat.runtime.jit import numba
from rle_splat.scene import RleSplatError

pytestmark = pytest.mark.skipif(numba is None, reason="the spectrum is looked up by a compiled kernel: no numba here")

# Alpha against T1, RMSE and max in levels, with 2 and 3 bands; measured .002/.01, .002/.01; .005/.02, .002/.01;
# .09/.9, .01/.12.  What is cut off matters where the field has edges.
BOUNDS = {"smooth": ((0.01, 0.05),) * 2, "thin": ((0.02, 0.1), (0.01, 0.05)), "binary": ((0.15, 1.5), (0.03, 0.3))}


def test_spectrum_against_the_sum_that_defines_it():
    random = np.random.default_rng(0)
    voxels = random.random((7, 9, 12)).astype(np.float32)
    found = spectrum.transform(voxels)
    rows = np.array(((0.3, -0.41, 0.2), (0.77, 0.1, -1.3)))
    across, down = np.array((0.0, 0.5, 1.0, -0.7)), np.array((0.1, -0.6, 2.0, 0.0, 1.3))
    out = np.empty((5, 4), np.complex64)
    spectrum.look_up(found.values, found.size, rows, across, down, out)
    z, y, x = np.indices(voxels.shape)
    for b in range(5):
        for a in range(4):
            k = across[a] * rows[0] + down[b] * rows[1]
            turns = k[0] * (x - found.center[0]) + k[1] * (y - found.center[1]) + k[2] * (z - found.center[2])
            assert abs((voxels * np.exp(-2j * np.pi * turns)).sum() - out[b, a]) < 1e-4 * np.abs(voxels).sum()


@pytest.mark.parametrize("name", FIELDS)
def test_alpha_is_that_of_the_truth(stand, name):
    scene = stand.scene(FIELDS[name](33))
    true = stand.truth(scene)[..., 3]
    for bands, (rmse, largest) in zip((2, 3), BOUNDS[name]):
        found = difference(stand.draw(totsuka_levoy, scene, bands=bands).rgba[..., 3], true)
        assert found.rmse < rmse and found.largest < largest


def test_optical_depth_is_the_sum_along_an_axis(stand):
    """Looking along y with one pixel a voxel, a ray through voxel centers sees the sum of their extinctions.

    The worst view there is: along an axis the tents' spectrum falls as slowly as 1 / f^2, so what is cut off falls
    as one over the number of bands.
    """
    field = blobs((24, 24, 24), 6)
    medium = stand.medium(stand.scene(field, 0.0, 0.0, size=(24, 24), fit=1.0))
    expected = -np.log1p(-field.astype(np.float64)).sum(axis=1)[::-1]  # row 0 on top
    transformed = spectrum.transform(medium.field[1:-1, 1:-1, 1:-1, 3])
    worst = [
        np.abs(totsuka_levoy.optical_depth(medium, stand.quality, transformed, bands) - expected).max()
        for bands in (4, 8, 16)
    ]
    assert worst[0] < 0.006 * expected.max() and worst[1] < 0.6 * worst[0] and worst[2] < 0.6 * worst[1]


@pytest.mark.parametrize("fit", (0.4, 3.0))
def test_what_lies_outside_the_picture_does_not_come_round(stand, fit):
    scene = stand.scene(blobs((20, 26, 22), 9), 50.0, -30.0, fit=fit, spacing=(1.0, 0.8, 1.2))
    true = stand.truth(scene)[..., 3]
    assert true.max() > 0.1
    assert difference(stand.draw(totsuka_levoy, scene, bands=3).rgba[..., 3], true).largest < 0.5


def test_fast_sizes():
    assert [spectrum.fast_size(n) for n in (1, 7, 11, 97, 257)] == [2, 8, 12, 100, 270]


def test_perspective_is_refused(stand):
    with pytest.raises(RleSplatError, match="parallel projection"):
        stand.draw(totsuka_levoy, stand.scene(blobs((9, 9, 9), 1), perspective=True))
