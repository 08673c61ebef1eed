"""The medium as a grid for other renderers: optical depth, color and cuts are those of the scene, whatever the view."""

import math

import numpy as np
import pytest

from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.medium_grid import (
    LEAST_SIDE,
    MOST_SIDE,
    THICKEST,
    for_any_view,
    medium_steps,
    shadow_factors,
    side_for,
)
from rle_splat.runtime.steps import drain
from rle_splat.scene import Camera, Clip, Light, Quality, RleSplatError, Scene
from rle_splat.volume.reduced import node_to_index
from rle_splat.volume.volume import Volume

pytestmark = pytest.mark.usefixtures("by_numpy")  # no kernels to compile

SHAPE = 9, 10, 11  # (nz, ny, nx), not divided by 2 and 3
COLOR = (0.8, 0.4, 0.2)
QUALITY = Quality()


def scene_of(voxels=None, alpha=0.3, shade=None, **fields):
    """A scene of random values; those above 127 have one opacity and color."""
    if voxels is None:
        voxels = np.random.default_rng(7).integers(0, 256, SHAPE).astype(np.uint8)
    function = TransferFunction(
        name="one", unit=None, opacity=((0.0, 0.0), (127.0, 0.0), (127.0, alpha), (255.0, alpha)),
        color=((0.0, *COLOR), (255.0, *COLOR)), opacity_unit_distance=1.0, shade=shade,
    )  # fmt: skip
    return Scene(Volume(voxels, np.diag((1.0, 1.5, 2.0, 1.0))), function, Camera(np.eye(4)), **fields)


def grid_of(scene, factors=(1, 1, 1)):
    """(nz, ny, nx, 4) float32."""
    shape = [-(-n // factor) for n, factor in zip(scene.volume.shape_xyz, factors)][::-1]
    made = np.zeros((*shape, 4), np.float32)

    def add(plane, records):
        made[plane] = records

    drain(medium_steps(scene, QUALITY, factors, add))
    return made


@pytest.mark.parametrize("factors", [(1, 1, 1), (2, 3, 2), (11, 1, 4)])
def test_blocks_keep_the_optical_depth_and_the_color(factors):
    scene = scene_of()
    seen = scene.volume.voxels >= 127
    made = grid_of(scene, factors)
    blocks = np.pad(seen, [(0, -n % factor) for n, factor in zip(SHAPE, factors[::-1])])
    (nz, ny, nx), (fx, fy, fz) = made.shape[:3], factors
    means = blocks.reshape(nz, fz, ny, fy, nx, fx).mean(axis=(1, 3, 5))
    np.testing.assert_allclose(made[..., 3], -math.log(0.7) * means, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(made[..., :3], made[..., 3:] * np.array(COLOR, np.float32), rtol=1e-5, atol=1e-7)
    last = node_to_index(factors) @ (nx - 1, ny - 1, nz - 1, 1)
    np.testing.assert_allclose(last[:3], [(n - 1) * f + 0.5 * (f - 1) for n, f in zip((nx, ny, nz), factors)])


def test_what_clip_objects_cut_away_is_not_in_the_grid():
    box = np.diag((5.25, 40.0, 40.0, 1.0))
    kept = grid_of(scene_of(clips=(Clip("box", box),)))
    assert not kept[:, :, 6:].any() and kept[:, :, :5].any()
    np.testing.assert_array_equal(kept[:, :, :5], grid_of(scene_of())[:, :, :5])
    off = scene_of(clips=(Clip("box", box),), effects={"clip objects": False})
    np.testing.assert_array_equal(grid_of(off), grid_of(scene_of()))


def test_opaque_voxels_are_capped_and_keep_their_color():
    made = grid_of(scene_of(alpha=1.0))
    side = 3.0 ** (1.0 / 3.0)
    assert made[..., 3].max() == pytest.approx(THICKEST / side, rel=1e-5)
    np.testing.assert_allclose(made[..., 0], 0.8 * made[..., 3], rtol=1e-5)


def test_the_grid_does_not_depend_on_the_view_and_is_lit():
    shade, sun = Shade(ambient=0.2, diffuse=0.8, specular=0.9), Light("SUN", energy=2.0)
    lit = dict(shade=shade, lights=(sun,), headlight=False)
    scene = scene_of(**lit)
    turned = np.diag((-1.0, 1.0, -1.0, 1.0))
    other = scene_of(**lit, width=7, crop=(0, 0, 3, 3))
    vars(other)["camera"] = Camera(turned, aperture_radius=1.0, focus_distance=10.0)
    made = grid_of(scene)
    np.testing.assert_array_equal(made, grid_of(other))
    assert for_any_view(other).camera is for_any_view(scene).camera
    assert np.unique(made[made[..., 3] > 0][:, 0]).size > 100, "colors are shaded"
    bright = grid_of(scene_of(shade=shade, lights=(Light("SUN", energy=4.0),), headlight=False))
    assert bright[..., 0].sum() > 1.3 * made[..., 0].sum()


def test_soft_shadows_have_a_coarser_grid():
    def light(angle, casts=True):
        return Light("SUN", angle=angle, casts_shadow=casts)

    middle = np.zeros(3)
    assert side_for([light(0.0)], middle) == side_for([light(0.009)], middle) == MOST_SIDE
    assert side_for([light(1.0)], middle) == side_for([light(1.0), light(0.0, False)], middle) == LEAST_SIDE
    assert side_for([light(0.04)], middle) == 100
    far = np.eye(4)
    far[:3, 3] = 0.0, 0.0, 50.0
    for lamp in (Light("AREA", size=2.0, matrix_world=far), Light("POINT", radius=1.0, matrix_world=far)):
        assert side_for([lamp], middle) == pytest.approx(100, abs=1)
    scene = scene_of(np.full((40, 256, 200), 200, np.uint8))
    assert shadow_factors(scene, [light(0.0)]) == (3, 2, 2) and shadow_factors(scene, [light(1.0)]) == (6, 4, 3)


def test_a_classified_file_is_refused_in_a_sentence():
    class Classified:
        holds_values = False

    scene = scene_of()
    vars(scene)["volume"] = Classified()
    with pytest.raises(RleSplatError, match="rle file holds no values"):
        drain(medium_steps(scene, QUALITY, (1, 1, 1), None))
