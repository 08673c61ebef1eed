"""Westover's splatting: footprints hold the whole voxel, adding is order-free within a sheet, compositing is not."""

import numpy as np
import pytest

from benchmarks.phantoms import FIELDS, blobs
from rle_splat.accuracy.metrics import difference
from rle_splat.comparison import westover
from rle_splat.comparison.footprint import footprint, tent_line_integral
from rle_splat.runtime.jit import numba
from rle_splat.scene import Quality, RleSplatError

pytestmark = pytest.mark.skipif(numba is None, reason="footprint splatting is a compiled kernel: no numba here")

# RMSE and max in levels of sheets, of every sample composited, and of alpha, which is the same for both.
# Measured .27/1.5, .16/1.2, .08/.5; .64/5.8, .34/2.6, .13/1.2; .21/4.2, .21/4.2, .29/4.2.
BOUNDS = {
    "smooth": ((0.4, 2.2), (0.25, 1.8), (0.12, 0.8)),
    "thin": ((1.0, 9.0), (0.5, 4.0), (0.2, 1.8)),
    "binary": ((0.32, 6.5), (0.32, 6.5), (0.45, 6.5)),
}


@pytest.mark.parametrize("name", FIELDS)
def test_near_the_truth(stand, name):
    scene = stand.scene(FIELDS[name](32), size=(64, 64))
    true = stand.truth(scene)
    for sheets, (rmse, largest) in zip((True, False), BOUNDS[name]):
        picture = stand.draw(westover, scene, sheets=sheets)
        found = stand.error(picture, true)
        assert found.rmse < rmse and found.largest < largest
        alpha = difference(picture.rgba[..., 3], true[..., 3])
        assert alpha.rmse < BOUNDS[name][2][0] and alpha.largest < BOUNDS[name][2][1]


@pytest.mark.parametrize("scale", (1.0, 4.0))
def test_a_footprint_holds_the_whole_kernel(stand, scale):
    """Summed over all positions of a voxel within a pixel, weight times pixel area is the kernel's volume."""
    scene = stand.scene(np.zeros((20, 18, 16)), 31.0, -17.0, spacing=(1.0, 1.5, 0.7))
    table = footprint(stand.medium(scene).view, scale)
    pixel = scene.camera.ortho_scale / scene.height
    volume = table.weights.sum(dtype=np.float64) / table.shape[0] ** 2 * pixel**2
    assert volume == pytest.approx(scale**3 * 1.0 * 1.5 * 0.7, rel=2e-3)


def test_line_integral_of_tents_against_a_fine_sum():
    random = np.random.default_rng(5)
    points, along = random.uniform(-1.2, 1.2, (40, 3)), np.array((0.3, -0.8, 0.5))
    t = np.linspace(-8.0, 8.0, 160001)
    positions = points[:, None, :] + t[:, None] * along
    expected = np.maximum(1.0 - np.abs(positions), 0.0).prod(axis=-1).sum(axis=1) * (t[1] - t[0])
    np.testing.assert_allclose(tent_line_integral(points, along), expected, atol=1e-6)
    straight = tent_line_integral(np.array(((0.25, 0.5, 0.0), (1.5, 0.0, 0.0))), np.array((0.0, 0.0, 2.0)))
    np.testing.assert_allclose(straight, (0.75 * 0.5 * 0.5, 0.0))


def test_only_composited_samples_hide_each_other(stand):
    """One sheet of two colors seen face-on, and its mirror image: the sum within a sheet has no order."""
    field = np.zeros((12, 3, 12))
    field[3:9, 1, 3:9] = np.where(np.indices((6, 6)).sum(axis=0) % 2, 0.2, 0.7)
    views = [stand.scene(f, 0.0, 0.0, size=(60, 60)) for f in (field, field[:, :, ::-1])]
    for sheets, symmetric in ((True, True), (False, False)):
        first, mirrored = (stand.draw(westover, scene, sheets=sheets).rgba for scene in views)
        # The sub-pixel table is as fine as 1/32 pixel, so mirror images agree to about a level.
        apart = difference(first, mirrored[:, ::-1]).largest
        assert (apart < 4.0) is symmetric, apart


@pytest.mark.parametrize("sheets", (True, False), ids=("sheets", "every sample"))
def test_same_bits_for_any_number_of_threads(stand, sheets):
    scene = stand.scene(blobs((23, 17, 20), 2), 120.0, -40.0)
    qualities = [Quality(classification="pre", threads=n) for n in (1, 2)]
    pictures = [stand.draw(westover, scene, quality, sheets=sheets).rgba for quality in qualities]
    assert pictures[0].max() > 0.1
    np.testing.assert_array_equal(*pictures)


def test_splatting_zeros_changes_nothing(stand):
    scene = stand.scene(blobs((15, 17, 20), 4))
    np.testing.assert_array_equal(
        stand.draw(westover, scene, cull=True).rgba, stand.draw(westover, scene, cull=False).rgba
    )


def test_refusals(stand):
    scene = stand.scene(blobs((12, 12, 12), 1), perspective=True)
    with pytest.raises(RleSplatError, match="parallel projection"):
        stand.draw(westover, scene)
    scene = stand.clipped(stand.scene(blobs((12, 12, 12), 1)), clip_end=20.0)
    with pytest.raises(RleSplatError, match="clip"):
        stand.draw(westover, scene)
