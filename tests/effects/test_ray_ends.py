"""Rays that end at given depths: the same picture as of the triangles that the depths are of, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.accuracy.planner.tolerance import render_within
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.effects import mesh_occlusion
from rle_splat.effects.mesh_depth import mesh_depth
from rle_splat.pipeline.render import render
from rle_splat.scene import Pose, Quality, RleSplatError, Scene
from rle_splat.view.projection import depth_row
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

pytestmark = pytest.mark.usefixtures("by_numpy")  # no kernels to compile

FUNCTION = TransferFunction(opacity=((0.0, 0.2), (1.0, 0.3)), color=((0.0, 0.9, 0.3, 0.1), (1.0, 0.2, 0.5, 0.9)))
SIZE = 48, 40
QUALITY = Quality()
REACH = 5  # pixels on either side of a silhouette that the warp may mix


def scene_of(perspective=True, **more):
    width, height = SIZE
    volume = Volume(np.random.default_rng(5).random((14, 13, 12), np.float32), np.eye(4))
    camera, matrix = turntable(volume, 30.0, 20.0, perspective=perspective)
    return Scene(volume, FUNCTION, camera, width, height, matrix, **more)


def wall_of(scene):
    """A slanted triangle across the volume that ends every ray: without silhouettes both ways give the same depths."""
    middle = scene.index_to_world @ (6.0, 6.5, 5.5, 1.0)
    depth = float(depth_row(scene.camera) @ middle)
    corners = np.array([(-90, -80, -depth - 9, 1), (90, -70, -depth, 1), (0, 90, -depth + 11, 1)], float)
    return (corners @ scene.camera.matrix_world.T)[None, :, :3]


def depths_of(scene, triangles):
    return mesh_depth(triangles, scene.camera, *SIZE).mean(axis=-1, dtype=np.float64).astype("f4")


@pytest.mark.parametrize("perspective", [False, True])
def test_depths_of_a_wall_end_rays_as_its_triangles_do(perspective):
    scene = scene_of(perspective)
    wall = wall_of(scene)
    found = render(replace(scene, ray_ends=depths_of(scene, wall)), QUALITY)
    expected = render(replace(scene, triangles=wall), QUALITY)
    assert np.abs(render(scene, QUALITY).rgba - expected.rgba).max() > 0.1, "the wall hides nothing"
    np.testing.assert_allclose(found.rgba, expected.rgba, atol=0.1 / 255.0)


def test_away_from_silhouettes_both_agree():
    scene = scene_of()
    triangles = np.array([((-20, -20, 2), (1, -20, 2), (1, 20, 2))], float)
    ends = depths_of(scene, triangles)
    found = render(replace(scene, ray_ends=ends), QUALITY).rgba
    expected = render(replace(scene, triangles=triangles), QUALITY).rgba
    ended = np.isfinite(mesh_depth(triangles, scene.camera, *SIZE))
    near = np.pad(ended.any(axis=-1) & ~ended.all(axis=-1), REACH)
    edges = np.zeros(ends.shape, bool)
    for down in range(2 * REACH + 1):
        for across in range(2 * REACH + 1):
            edges |= near[down : down + ends.shape[0], across : across + ends.shape[1]]
    assert 0.05 < edges.mean() < 0.9
    np.testing.assert_allclose(found[~edges], expected[~edges], atol=1.0 / 255.0)


def test_a_bilinear_warp_draws_no_pixel_twice(monkeypatch):
    scene = scene_of()
    triangles = np.array([((-20, -20, 2), (1, -20, 2), (1, 20, 2))], float)
    ended = replace(scene, ray_ends=depths_of(scene, triangles))
    passes = []
    splat = mesh_occlusion.layers_to_splat
    monkeypatch.setattr(mesh_occlusion, "layers_to_splat", lambda *a: passes.append(len(splat(*a))) or splat(*a))
    quick = replace(QUALITY, warp_filter="bilinear")
    rough, fine = render(ended, quick).rgba, render(ended, QUALITY).rgba
    assert passes == [1, 2]
    assert np.median(np.abs(rough - fine).max(axis=-1)) < 4.0 / 255.0
    assert np.abs(render(scene, quick).rgba - rough).max() > 0.1


def test_depths_without_an_end_change_no_bit():
    scene = scene_of()
    ends = np.full(SIZE[::-1], np.inf, np.float32)
    rendering = render(replace(scene, ray_ends=ends), QUALITY)
    np.testing.assert_array_equal(rendering.rgba, render(scene, QUALITY).rgba)
    assert not next(one for one in rendering.report["effects"] if one["name"] == "mesh occlusion")["on"]


def test_a_crop_has_the_bits_of_the_whole():
    scene = scene_of()
    scene = replace(scene, ray_ends=depths_of(scene, wall_of(scene)))
    left, top, right, bottom = crop = (10, 8, 37, 30)
    found = render(replace(scene, crop=crop), QUALITY)
    np.testing.assert_array_equal(found.rgba, render(scene, QUALITY).rgba[top:bottom, left:right])


def test_what_is_refused():
    scene = scene_of()
    ends = np.full(SIZE[::-1], np.inf, np.float32)
    with pytest.raises(RleSplatError, match="a depth for each of its 40 x 48 pixels"):
        replace(scene, ray_ends=ends[1:])
    pose = Pose(scene.camera.matrix_world, scene.volume_matrix)
    with pytest.raises(RleSplatError, match="one sharp view"):
        replace(scene, ray_ends=ends, motion=(pose, pose))
    with pytest.raises(RleSplatError, match="one sharp view"):
        replace(scene, ray_ends=ends, camera=replace(scene.camera, aperture_radius=0.1, focus_distance=9.0))
    ends[3, 4] = np.nan
    with pytest.raises(RleSplatError, match="not a number"):
        render(replace(scene, ray_ends=ends), QUALITY)
    with pytest.raises(RleSplatError, match="give triangles"):
        render_within(replace(scene, ray_ends=np.full(SIZE[::-1], 2.0, np.float32)), 4.0, QUALITY)
