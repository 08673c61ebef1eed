"""Proves the depth output, the clip distances and meshes that stop the rays, each with a fractional last slab."""

import numpy as np
import pytest

from benchmarks.phantoms import FIELDS
from rle_splat.accuracy.metrics import LEVEL
from rle_splat.accuracy.rays import camera_rays
from rle_splat.scene import Camera, Scene
from tests.truths.other_rays import depth_to_plane

PROJECTIONS = pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))


def changed(scene, **fields):
    """The same scene with other fields."""
    values = {name: getattr(scene, name) for name in Scene.__dataclass_fields__}
    return Scene(**(values | fields))


def clipped(camera, start, end):
    values = {name: getattr(camera, name) for name in Camera.__dataclass_fields__}
    return Camera(**(values | {"clip_start": start, "clip_end": end}))


def middle_depth(scene):
    """Planar depth of the volume's middle."""
    nx, ny, nz = scene.volume.shape_xyz
    middle = scene.index_to_world @ (0.5 * (nx - 1), 0.5 * (ny - 1), 0.5 * (nz - 1), 1.0)
    camera = scene.camera.matrix_world
    return float((middle[:3] - camera[:3, 3]) @ -camera[:3, 2])


@PROJECTIONS
@pytest.mark.parametrize("depth_rule, bound", (("slice", 0.6), ("simpson", 0.5)))
def test_depth_of_half_transmittance(stage, perspective, depth_rule, bound):
    """Within a fraction of a slice of the truth wherever half transmittance is clearly passed, else none; but where
    the truth jumps from one surface to another, a pixel of the rendering may see either."""
    scene = stage.on_turntable(FIELDS["smooth"](32), perspective=perspective, size=(64, 64))
    true, true_depth = stage.truth(scene)
    depth = stage.render(scene, depth_rule=depth_rule).depth
    assert depth.shape == (64, 64) and depth.dtype == np.float32
    passed, missed = true[..., 3] > 0.55, true[..., 3] < 0.45
    assert passed.sum() > 300 and missed.sum() > 300
    error = np.abs(depth - true_depth)[passed]
    assert np.quantile(error, 0.95) < bound and np.median(error) < 0.1 * bound
    assert (error > 2.0).mean() < 0.01
    assert (depth[missed] < 1e9).mean() < 0.002


@pytest.mark.parametrize("azimuth, elevation, perspective", ((35.0, 25.0, True), (-100.0, -60.0, False)))
def test_tilted_plane_inside_the_volume(stage, perspective, azimuth, elevation):
    """Each ray ends on the plane, at a depth of its own that is never a slice's."""
    scene = stage.on_turntable(0.4 * FIELDS["smooth"](32), azimuth, elevation, perspective, size=(72, 72))
    point, normal = np.array((15.2, 16.1, 15.7)), np.array((0.5, -0.6, 0.4))
    u = np.cross(normal, (0.0, 0.0, 1.0))
    v = np.cross(normal, u)
    a, b, c, d = (point + 300.0 * (s * u + t * v) for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    stopped = changed(scene, triangles=np.array(((a, b, c), (a, c, d))))
    far = depth_to_plane(camera_rays(scene.camera, 72, 72), point, normal)
    true = stage.truth(stopped, far=far)[0]
    whole = stage.render(scene).rgba
    assert np.abs(whole - true).max() > 0.1  # the premise: the plane hides a good deal
    found = stage.error(stopped, true)
    assert found.rmse < 0.6 and found.largest < 5.0 and abs(found.bias) < 0.1
    depth = stage.render(stopped).depth
    assert (depth[true[..., 3] < 0.45] < 1e9).mean() < 0.002


@PROJECTIONS
def test_mesh_before_and_behind(stage, perspective):
    """A mesh behind the volume changes nothing, one before it leaves nothing, beside it leaves the rest alone."""
    scene = stage.on_turntable(FIELDS["thin"](24), 0.0, 0.0, perspective, size=(48, 48))
    free = stage.render(scene).rgba

    def wall(y, left=-500.0):
        a, b, c, d = ((left, y, -500.0), (500.0, y, -500.0), (500.0, y, 500.0), (left, y, 500.0))
        return np.array(((a, b, c), (a, c, d)))

    assert np.abs(stage.render(changed(scene, triangles=wall(27.0))).rgba - free).max() < 1e-6
    assert not stage.render(changed(scene, triangles=wall(-3.0))).rgba.any()


@PROJECTIONS
@pytest.mark.parametrize("part", (0.0, 0.01, 0.3, 0.5, 0.95))
def test_silhouette_of_a_mesh_before_the_volume(stage, perspective, part):
    """A wall over the right half whose edge leaves ``part`` of pixel column 24 free: every pixel holds exactly its
    uncovered share of the unstopped picture, also when the edge runs between two pixels."""
    scene = stage.on_turntable(FIELDS["thin"](24), 0.0, 0.0, perspective, size=(48, 48))
    edge = camera_rays(scene.camera, 48, 48, 24.0 + part, 24.0)
    left = edge.at_depth(depth_to_plane(edge, (0.0, -3.0, 0.0), (0.0, 1.0, 0.0)))[0, 0]
    a, b, c, d = ((left, -3.0, -500.0), (500.0, -3.0, -500.0), (500.0, -3.0, 500.0), (left, -3.0, 500.0))
    free = stage.render(scene).rgba
    half = stage.render(changed(scene, triangles=np.array(((a, b, c), (a, c, d))))).rgba
    share = np.clip(24.0 + part - np.arange(48), 0.0, 1.0)[None, :, None]
    assert free[:, 25:].max() > 0.3 and free[:, :23].max() > 0.3
    # Coverage is counted in sixteenths of a pixel.
    assert np.abs(half - share * free).max() < 1.1 / 32.0
    assert np.abs((half - share * free)[:, np.arange(48) != 24]).max() < 0.1 * LEVEL


@PROJECTIONS
def test_clip_distances_inside_the_volume(stage, perspective):
    scene = stage.on_turntable(FIELDS["smooth"](32), perspective=perspective, size=(44, 44))
    middle = middle_depth(scene)
    for start, end in ((middle - 4.3, middle + 200.0), (middle - 200.0, middle + 2.7), (middle - 6.1, middle + 5.2)):
        cut = changed(scene, camera=clipped(scene.camera, max(start, 0.01), end))
        found = stage.error(cut)
        assert found.rmse < 0.6 and found.largest < 5.0
