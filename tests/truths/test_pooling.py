"""Proves the minification "pool": averages keep optical depth, place and light, and follow the picture's size."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.phantoms import FIELDS
from rle_splat.accuracy.metrics import difference
from rle_splat.classify.transfer_function import Shade
from rle_splat.encode.pooling import pooled_steps
from rle_splat.encode.stored import StoredVolume
from rle_splat.pipeline.encode_scene import encode_scene
from rle_splat.pipeline.render import render
from rle_splat.pipeline.scan_source import scan_source
from rle_splat.pipeline.source import Work
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.jit import numba
from rle_splat.runtime.steps import Clock, drain
from rle_splat.scene import Light, Quality, RleSplatError

WITH_NUMBA = pytest.mark.skipif(numba is None, reason="numba cannot be loaded")

POOL = dict(minification="pool", depth_rule="midpoint-4", sheet_density=1.0, termination=0.0)


def pooled_side(stage, scene, **knobs):
    """How many voxels a side the nodes of a picture have."""
    return stage.render(scene, **POOL | knobs).report["plan"]["pooled"]


@pytest.mark.parametrize("shape", [(48, 48, 48), (37, 50, 29)])
def test_averages_keep_the_optical_depth(stage, shape):
    """Closed form: optical depth summed over the pixels, times a pixel's area, is extinction times volume."""
    field = 0.02 * np.random.default_rng(3).random(shape)
    scene = stage.on_turntable(field, 0.0, 0.0, size=(24, 24), fit=2.0)
    made = stage.render(scene, **POOL)
    assert made.report["plan"]["pooled"] == 4
    tau = -np.log1p(-made.rgba[..., 3].astype(np.float64))
    world = np.linalg.det(scene.index_to_world[:3, :3])
    pixel = scene.camera.ortho_scale / 24
    true = -np.log1p(-field).sum() * world / pixel**2
    # So few rays see the sum of what is between them to a hundredth or two.
    assert abs(tau.sum() / true - 1.0) < 0.02


@pytest.mark.parametrize("backend", [pytest.param("numba", marks=WITH_NUMBA), "numpy"])
@pytest.mark.parametrize("level", [1, 2, 3, 6])
def test_a_node_is_the_average_of_its_cube(stage, level, backend):
    """Against numpy's own mean of the volume's extinction and emission, with nothing beyond its ends."""
    field = (0.9 * np.random.default_rng(4).random((13, 50, 29)) ** 3).astype(np.float32)
    field[field < 0.3] = 0.0
    scene = stage.on_turntable(field)
    quality = Quality(classification="pre", backend=backend, threads=2)
    lit = drain(scan_source(scene, quality).medium_steps(Work(StageCache(0).job(), Clock()))).voxels
    voxels, write = lit.classified.voxels, lit.write_records("extinction")
    nodes, colors = drain(pooled_steps(voxels, write, level, lit.classified, backend=backend, threads=2))
    side, extinction = 2**level, -np.log1p(-field.astype(np.float64))
    emission = np.concatenate((extinction[..., None] * stage.color(field), extinction[..., None]), axis=3)
    padded = np.pad(emission, [(0, -n % side) for n in field.shape] + [(0, 0)])
    nz, ny, nx = (n // side for n in padded.shape[:3])
    means = padded.reshape(nz, side, ny, side, nx, side, 4).mean(axis=(1, 3, 5))
    seen = means[..., 3] > 0.0
    assert nodes.shape_xyz == (nx, ny, nz) and nodes.visible_voxels == seen.sum() > 0
    np.testing.assert_allclose(nodes.extinction, means[seen][:, 3], rtol=2e-6)
    np.testing.assert_allclose(colors * nodes.extinction[:, None], means[seen][:, :3], rtol=2e-5)
    assert (nodes.column == np.nonzero(seen)[2]).all() and (np.diff(nodes.row_start) == seen.sum(2).ravel()).all()


def averaged(rgba, side: int) -> np.ndarray:
    """A picture of squares of ``side`` pixels of a larger one."""
    height, width = rgba.shape[0] // side, rgba.shape[1] // side
    return rgba.astype(np.float64).reshape(height, side, width, side, 4).mean(axis=(1, 3))


@pytest.mark.parametrize("perspective, width", [(False, 20), (True, 14)], ids=["ortho", "perspective"])
def test_nodes_lie_where_their_voxels_do_and_are_lit_as_they_are(stage, perspective, width):
    """A stretched, sheared and lit medium, against the average of all that rays through every voxel see."""
    affine = np.array(((1.0, 0.2, 0.0, 3.0), (0.0, -0.8, 0.1, -2.0), (0.1, 0.0, 1.5, 7.0), (0.0, 0.0, 0.0, 1.0)))
    field = np.pad(0.05 * FIELDS["smooth"](63)[:, :57, :50], 1)
    scene = stage.on_turntable(field, perspective=perspective, size=(width, width), fit=1.4, fov=20.0)
    shade = replace(scene.transfer_function, shade=Shade())
    scene = replace(
        scene, volume=stage.volume(field, affine), transfer_function=shade,
        lights=(Light(color=(1.0, 0.8, 0.5), energy=3.0),),
    )
    large = stage.render(replace(scene, width=8 * width, height=8 * width), **POOL | {"minification": "off"})
    true = averaged(large.rgba, 8)
    found = difference(stage.render(scene, **POOL).rgba, true)
    assert pooled_side(stage, scene) == 2
    assert true[..., 3].max() > 0.4 and found.rmse < 1.0, found  # half a voxel beside their places: 1.2


def test_no_node_is_larger_than_a_sheet_pixel(stage):
    """Half the picture, twice the node; a near end in perspective keeps its voxels; and denser sheets do."""
    scene = stage.on_turntable(FIELDS["smooth"](60), size=(128, 128), fit=1.0)
    sides = [pooled_side(stage, replace(scene, width=n, height=n)) for n in (128, 64, 32, 16, 8)]
    assert sides[0] == 1 and all(b == 2 * a for a, b in pairwise(sides[1:])) and sides[-1] == 8, sides
    small = replace(scene, width=16, height=16)
    assert pooled_side(stage, small, sheet_density=4.0) == 1
    assert pooled_side(stage, small, sheet_density=0.0) == 1  # one sheet pixel for each voxel: nothing to average
    speck = replace(scene, camera=replace(scene.camera, ortho_scale=1e6))
    assert pooled_side(stage, speck) == 64


def test_work_follows_the_picture_and_is_kept(stage):
    scene, cache = stage.on_turntable(FIELDS["smooth"](60), size=(16, 16), fit=1.0), StageCache()
    quality = Quality(classification="pre", **POOL)
    first = render(scene, quality, cache=cache)
    plain = render(scene, replace(quality, minification="off"))
    assert first.report["plan"]["base_planes"][0]["sheets"] * 3 < plain.report["plan"]["base_planes"][0]["sheets"]
    assert first.report["memory_bytes"]["total"] * 8 < plain.report["memory_bytes"]["total"]
    assert first.report["volume"] == plain.report["volume"]
    ((nodes, colors), size), = (held for (stage, _), held in cache._results.items() if stage == "nodes")
    arrays = (*vars(nodes.voxels).values(), nodes.properties, colors)
    assert size == sum(array.nbytes for array in arrays if hasattr(array, "nbytes"))
    made = dict(cache.made)
    turned = replace(scene, camera=stage.on_turntable(FIELDS["smooth"](60), 37.0, size=(16, 16), fit=1.0).camera)
    second = render(turned, quality, cache=cache)
    assert cache.made == made and (second.rgba != first.rgba).any()
    np.testing.assert_array_equal(second.rgba, render(turned, quality).rgba)


def test_what_has_no_averages_says_so(stage):
    scene = stage.on_turntable(FIELDS["smooth"](20), size=(4, 4))
    with pytest.raises(RleSplatError, match=r"^The minification pool averages .* or the minification widen\.$"):
        Quality(classification="pre", model="opacity", **POOL)
    stored = encode_scene(scene)
    assert isinstance(stored, StoredVolume)
    with pytest.raises(RleSplatError, match=r"choose the minification widen or off\.$"):
        render(replace(scene, volume=stored), Quality(classification="pre", **POOL))
