"""Normals and the places where shadows begin against the reference of light, which shares no code with them."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from rle_splat.accuracy.light_model import PostLight
from rle_splat.classify.points import LARGEST
from rle_splat.classify.relevant import Reach, count_kept, gather_kept, relevant_steps
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.runtime.steps import drain
from rle_splat.scene import Camera, Clip, Light, Scene
from rle_splat.shade.sample_light import ONE
from rle_splat.shade.surface_normals import surface_steps
from rle_splat.shade.surface_points import STEPS, faces_of, place_steps
from rle_splat.volume.blocks import block_steps
from rle_splat.volume.volume import Volume

TURNED = np.array([[0.36, 0.48, -0.8, 10.0], [-0.8, 0.6, 0.0, -3.0], [0.48, 0.64, 0.6, 2.0], [0, 0, 0, 1.0]])
CUTS = (Clip("plane", np.array([[1, 0, 0, 12], [0, 0.6, -0.8, 1], [0, 0.8, 0.6, 14], [0, 0, 0, 1.0]])),)
REMOVED = (Clip("box", TURNED @ np.diag((4.03, 3.07, 6.05, 1.0)), "outside"),)
OPACITIES = {
    "bone": ((300.0, 0.0), (400.0, 0.5)),
    "air": ((100.0, 0.3), (200.0, 0.0)),
    "bands": ((50.0, 0.0), (150.0, 0.2), (250.0, 0.0), (400.0, 0.0), (600.0, 0.5)),
}


def values(dtype):
    rng = np.random.default_rng(4)
    z, y, x = np.indices((14, 15, 16)) - 7.0
    ball = 900.0 / (1.0 + np.exp((np.sqrt(x**2 + y**2 + 2.0 * z**2) - 6.0) / 1.2))
    return (ball + rng.uniform(0.0, 9.0, ball.shape)).astype(dtype)


@pytest.mark.parametrize("dtype", [np.int16, np.float32])
@pytest.mark.parametrize("clips", [(), CUTS, REMOVED], ids=["whole", "cut", "removed"])
@pytest.mark.parametrize("opacity", OPACITIES)
@pytest.mark.parametrize("smoothness", [None, 0.0])
def test_surfaces_are_those_of_the_reference(opacity, clips, dtype, smoothness):
    volume = Volume(values(dtype), TURNED @ np.diag((0.7, 0.8, 1.5, 1.0)), slope=1.5, intercept=-20.0)
    shade = Shade(smoothness=smoothness)
    function = TransferFunction(opacity=OPACITIES[opacity], color=((0.0, 1.0, 1.0, 1.0),), shade=shade)
    scene = Scene(volume, function, Camera(), 8, 8, lights=(Light(type="SUN"),), clips=clips, volume_shadows=True)
    blocks = drain(block_steps(volume, threads=1))
    reach = Reach.of_values(volume, ((-LARGEST, LARGEST),))
    bits = drain(relevant_steps(volume, reach, blocks, threads=1))
    voxels = gather_kept(volume, bits, count_kept(bits, threads=1), blocks, threads=1)
    sigma = 1.5 if smoothness is None else smoothness
    surfaces = drain(surface_steps(volume, voxels.row_start, voxels.column, sigma, threads=1))
    matrix = scene.index_to_world
    place = partial(place_steps, surfaces, voxels, volume, function, matrix, faces_of(clips, matrix))
    codes, offsets = drain(place(with_points=True, threads=1))
    row = np.searchsorted(voxels.row_start, np.arange(len(voxels)), side="right") - 1
    x, y, z = voxels.column.astype(np.int64), row % 15, row // 15
    m, beside = PostLight(scene, 1.0).surfaces(z, y, x)
    np.testing.assert_allclose(codes / ONE, m, atol=2e-3)
    apart = np.abs(offsets / STEPS - (beside - np.stack((x, y, z), axis=1)))
    assert np.quantile(apart, 0.99) < 0.02 and apart.max() < 0.3  # of steepness that is nearly 0, little is known
