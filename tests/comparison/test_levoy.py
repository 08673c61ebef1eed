"""Levoy's ray casting converges to T1, and neither leaping nor termination changes what it may not."""

import numpy as np
import pytest

from benchmarks.phantoms import FIELDS
from rle_splat.comparison import levoy
from rle_splat.runtime.jit import numba
from rle_splat.scene import NO_DEPTH, Quality
from tests.truths.closed_forms import impulse_tau

pytestmark = pytest.mark.skipif(numba is None, reason="ray casting is a compiled kernel: numba is not installed")

PROJECTIONS = pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
# RMSE and max in levels at one and at a quarter of a voxel; measured .11/.53, .03/.12; .47/4.1, .03/.29; .68/14, .04/1.
BOUNDS = {"smooth": ((0.2, 0.9), (0.05, 0.25)), "thin": ((0.7, 6.0), (0.05, 0.5)), "binary": ((1.0, 20.0), (0.08, 1.6))}


@PROJECTIONS
@pytest.mark.parametrize("name", FIELDS)
def test_near_the_truth(stand, name, perspective):
    scene = stand.scene(FIELDS[name](32), perspective=perspective)
    true = stand.truth(scene)
    for step, (rmse, largest) in zip((1.0, 0.25), BOUNDS[name]):
        found = stand.error(stand.draw(levoy, scene, step=step), true)
        assert found.rmse < rmse and found.largest < largest


@PROJECTIONS
def test_leaping_over_empty_blocks_changes_no_picture(stand, perspective):
    field = np.zeros((30, 41, 35))
    field[3:6, 30:33, 20:28] = 0.4
    field[20:22, 5:8, 2:5] = 0.2
    scene = stand.scene(field, -20.0, 33.0, perspective, spacing=(1.0, 0.8, 1.3))
    medium = stand.medium(scene)
    blocks = levoy.occupied_blocks(medium.field)
    assert 0 < blocks.sum() < 0.2 * blocks.size
    leaped, stepped = (levoy.cast(medium, stand.quality, blocks, 0.5, leaping) for leaping in (True, False))
    assert stepped.rgba.max() > 0.1
    np.testing.assert_allclose(leaped.rgba, stepped.rgba, atol=1e-7)
    np.testing.assert_array_equal(leaped.depth < NO_DEPTH, stepped.depth < NO_DEPTH)


def test_a_block_is_occupied_when_a_corner_of_its_cells_absorbs():
    field = np.zeros((9, 9, 9, 4), np.float32)
    field[4, 0, 8, 3] = 1.0  # on the far corner of block z 0 and of block x 1
    expected = np.zeros((3, 3, 3), np.uint8)
    expected[:2, 0, 1:] = 1
    np.testing.assert_array_equal(levoy.occupied_blocks(field), expected)


def test_one_voxel_has_the_depth_of_its_tents(stand):
    field = np.zeros((9, 9, 9))
    field[4, 4, 4] = 0.6
    scene = stand.scene(field, 0.0, 0.0, size=(27, 27), fit=1.0)  # three pixels a voxel, along +y
    alpha = stand.draw(levoy, scene, step=0.02).rgba[..., 3].astype(np.float64)
    offset = (np.arange(27) + 0.5) / 3.0 - 4.5
    expected = impulse_tau(offset[None, :], offset[:, None], -np.log1p(-0.6), 1.0)
    np.testing.assert_allclose(-np.log1p(-alpha), expected, atol=2e-4)


def test_clip_distances_and_half_depth(stand):
    scene = stand.scene(np.full((20, 20, 20), 0.1), 0.0, 0.0, size=(16, 16))
    camera = scene.camera
    middle = np.linalg.norm(camera.matrix_world[:3, 3] - 9.5)
    scene = stand.clipped(scene, clip_end=float(middle) + 2.25)
    picture = stand.draw(levoy, scene, step=0.05)
    assert stand.error(picture, stand.truth(scene)).largest < 0.1
    # Along -1 .. 20 the medium ramps up over one voxel and is constant then: half of it is seen at ln 2 / sigma.
    entry = middle - 9.5 - 0.5
    np.testing.assert_allclose(picture.depth[8, 8], entry + np.log(2.0) / -np.log1p(-0.1), atol=0.01)


@pytest.mark.parametrize("termination", (1 / 256, 1 / 16))
def test_termination_bound(stand, termination):
    scene = stand.scene(np.full((30, 24, 24), 0.3), size=(24, 24))
    full = stand.draw(levoy, scene).rgba
    short = stand.draw(levoy, scene, Quality.preset("fine", classification="pre", termination=termination)).rgba
    assert 0.0 < np.abs(full - short).max() <= termination
