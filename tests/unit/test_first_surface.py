"""Proves that the first visible surface along a ray is where it is known to be, with the value that is known there."""

import math

import numpy as np
import pytest

from rle_splat.accuracy.rays import camera_rays
from rle_splat.accuracy.truths import truth
from rle_splat.classify.transfer_function import GradientOpacity, TransferFunction
from rle_splat.pipeline.first_surface import find_surface, point_along
from rle_splat.scene import Camera, Channel, Clip, Labels, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.sample import values_at
from rle_splat.volume.volume import Volume

SIDE = 24
SPACING = (1.0, 1.5, 2.0)
CENTER, RADIUS = np.array((11.0, 12.0, 11.5)), 7.0  # voxels
COLOR = ((0.0, 1.0, 1.0, 1.0),)


def function(*opacity, **more):
    return TransferFunction(name="test", opacity=opacity, color=COLOR, opacity_unit_distance=1.0, shade=None, **more)


SOLID = function((499.0, 0.0), (500.0, 1.0))  # opaque from the middle between the sphere's value and the box's


def indices():
    z, y, x = np.mgrid[:SIDE, :SIDE, :SIDE].astype(np.float64)
    return x, y, z


def sphere(affine=None):
    """1000 in a sphere, 0 around it, and between them a ramp of one voxel, as a scanner's blur leaves."""
    x, y, z = indices()
    apart = np.sqrt((x - CENTER[0]) ** 2 + (y - CENTER[1]) ** 2 + (z - CENTER[2]) ** 2)
    return Volume(np.clip(1000.0 * (RADIUS - apart + 0.5), 0.0, 1000.0).astype(np.float32),
                  np.eye(4) if affine is None else affine)  # fmt: skip


def trilinear(x, y, z):
    """A field that trilinear interpolation reproduces exactly, from 0 up."""
    return 3.0 + 2.0 * x + 5.0 * y + 1.0 * z + 0.25 * x * y + 0.01 * x * y * z


def scene_of(volume, tf=SOLID, **more):
    return Scene(volume=volume, transfer_function=tf, camera=Camera(), **more)


def rays_to_sphere():
    generator = np.random.default_rng(5)
    for _ in range(40):
        away = generator.normal(size=3)
        away /= np.linalg.norm(away)
        aside = generator.normal(size=3)
        aside -= away * (aside @ away)
        offset = generator.uniform(0.0, 0.8 * RADIUS)
        aim = CENTER + offset * aside / np.linalg.norm(aside)
        yield aim + 60.0 * away, -away, 60.0 - math.sqrt(RADIUS**2 - offset**2)


def test_a_sphere_in_a_box_within_half_a_voxel():
    scene = scene_of(sphere())
    for origin, direction, known in rays_to_sphere():
        found = find_surface(scene, origin, direction)
        assert abs(found.distance - known) < 0.5
        np.testing.assert_allclose(found.index, origin + found.distance * direction, atol=1e-9)
        assert 499.0 < found.value < 700.0 and found.opacity >= 0.5 and found.label is None


@pytest.mark.parametrize("spacing", ((1.0, 1.0, 1.0), SPACING))
def test_the_value_is_exact_where_the_field_is_trilinear(spacing):
    volume = Volume(trilinear(*indices()).astype(np.float64), np.diag((*spacing, 1.0)), slope=2.0, intercept=-10.0)
    for threshold in (60.0, 150.0, 300.0):
        scene = scene_of(volume, function((threshold - 1e-6, 0.0), (threshold, 1.0)))
        for direction in ((1.0, 0.6, 0.4), (0.2, 1.0, 0.1), (-0.3, 0.5, 1.0)):
            origin = np.array((0.5, 0.45, 0.5)) * (SIDE - 1) * spacing - 100.0 * np.array(direction)
            found = find_surface(scene, origin, direction)
            assert found.value == pytest.approx(2.0 * trilinear(*found.index) - 10.0, rel=1e-12)
            np.testing.assert_allclose(found.position, found.index * spacing, rtol=1e-12)
            assert found.value >= threshold - 1e-6


@pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
def test_the_depth_is_that_of_the_truth_in_a_translucent_volume(perspective):
    """Where T2's transmittance is one half, in a moved, turned and scaled volume that a plane and a box cut."""
    angle = 0.4
    matrix = np.array((
        (math.cos(angle), -math.sin(angle), 0.0, 3.0), (math.sin(angle), math.cos(angle), 0.0, -2.0),
        (0.0, 0.0, 1.3, 1.0), (0.0, 0.0, 0.0, 1.0)))  # fmt: skip
    volume = sphere(np.diag((*SPACING, 1.0)))
    camera, _ = turntable(volume, 30.0, 20.0, 1.25, perspective, scene_scale=0.5)
    cut = np.eye(4)
    cut[:3, 3] = 8.0, 8.0, 30.0
    hole = np.diag((6.0, 6.0, 6.0, 1.0))
    hole[:3, 3] = 5.0, 5.0, 20.0
    scene = Scene(
        volume=volume, transfer_function=function((300.0, 0.0), (1000.0, 0.4)), camera=camera, width=64, height=64,
        volume_matrix=matrix, scene_scale=0.5,
        clips=(Clip("plane", cut), Clip("box", hole, "outside")))  # fmt: skip
    rows, columns = np.divmod(np.arange(64 * 64)[::37], 64)
    rgba, depth = truth(scene, "T2", pixels=(columns + 0.5, rows + 0.5))
    rays = camera_rays(camera, 64, 64, columns + 0.5, rows + 0.5)
    clear = np.abs(rgba[:, 3] - 0.5) > 0.01
    halved = (rgba[:, 3] > 0.5) & clear
    assert halved.sum() > 8 and (rgba[:, 3] < 0.004).sum() > 8
    for n in np.flatnonzero(clear):
        found = find_surface(scene, rays.origin[n], rays.direction[n])
        if halved[n]:
            assert abs(found.distance - depth[n] * rays.length_per_depth[n]) < 0.5 * 0.5  # half a voxel in the world
        elif rgba[n, 3] < 0.003:
            assert found is None
        elif rgba[n, 3] > 0.006:
            assert found.opacity == pytest.approx(rgba[n, 3], abs=0.05)  # cuts lie between two samples


def test_a_faint_ray_gives_its_most_opaque_sample():
    scene = scene_of(sphere(), function((0.0, 0.0), (1000.0, 0.01)))
    found = find_surface(scene, CENTER - (40.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    assert 0.004 < found.opacity < 0.2 and found.value == pytest.approx(1000.0)


def test_nothing_is_found_where_nothing_is_visible():
    scene = scene_of(sphere())
    assert find_surface(scene, CENTER - (40.0, RADIUS + 2.0, 0.0), (1.0, 0.0, 0.0)) is None  # beside the sphere
    assert find_surface(scene, CENTER - (40.0, 99.0, 0.0), (1.0, 0.0, 0.0)) is None  # beside the box
    assert find_surface(scene, CENTER - (40.0, 0.0, 0.0), (-1.0, 0.0, 0.0)) is None  # behind
    assert find_surface(scene, CENTER - (40.0, 0.0, 0.0), (1.0, 0.0, 0.0), furthest=30.0) is None  # a mesh before it
    within = find_surface(scene, CENTER - (40.0, 0.0, 0.0), (1.0, 0.0, 0.0), nearest=38.0)
    assert within.distance == pytest.approx(38.0, abs=0.5)
    behind = find_surface(scene, CENTER, (1.0, 0.0, 0.0), nearest=-math.inf)
    assert behind.distance == pytest.approx(-RADIUS, abs=0.5)


def test_labels_and_channels_count():
    volume = sphere()
    x, _, _ = indices()
    labels = Volume(np.where(x < CENTER[0], 1, 2).astype(np.uint8), np.eye(4))
    origin, direction = CENTER - (40.0, 0.0, 0.0), (1.0, 0.0, 0.0)
    hidden = find_surface(scene_of(volume, labels=Labels(labels, {1: None})), origin, direction)
    assert hidden.label == 2 and hidden.index[0] == pytest.approx(CENTER[0] - 0.5, abs=0.5)
    own = {1: function((5000.0, 0.0), (6000.0, 1.0))}
    assert find_surface(scene_of(volume, labels=Labels(labels, own)), origin, direction).label == 2
    assert find_surface(scene_of(volume, labels=Labels(labels)), origin, direction).label == 1
    further = Channel(Volume(np.full((SIDE,) * 3, 1000.0, np.float32), np.eye(4)), SOLID)
    found = find_surface(scene_of(volume, channels=(further,)), origin, direction)
    assert found.index[0] == pytest.approx(0.0, abs=0.5) and found.value == 0.0  # the value is the volume's own


def test_gradient_opacity_leaves_the_surface_alone():
    even = function((499.0, 0.0), (500.0, 0.02), gradient_opacity=GradientOpacity(400.0, 450.0))
    found = find_surface(scene_of(sphere(), even), CENTER - (40.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    assert abs(abs(found.index[0] - CENTER[0]) - RADIUS) < 1.5  # not in the even middle


def test_modes_of_values_give_the_value_that_is_shown():
    volume = Volume(trilinear(*indices()).astype(np.float64), np.eye(4))
    shown = function((0.0, 1.0), (1.0, 1.0))
    origin, direction = (-40.0, 10.2, 9.6), (1.0, 0.0, 0.0)
    largest = find_surface(scene_of(volume, shown, mode="mip"), origin, direction)
    smallest = find_surface(scene_of(volume, shown, mode="minip"), origin, direction)
    assert largest.value == pytest.approx(trilinear(SIDE - 1.0, 10.2, 9.6))
    assert smallest.value == pytest.approx(trilinear(0.0, 10.2, 9.6))


def test_modes_of_values_pass_hidden_voxels_by():
    x, y, z = indices()
    volume = Volume(trilinear(x, y, z).astype(np.float64), np.eye(4))
    hidden = Labels(Volume(np.digitize(x, (4, SIDE - 4)).astype(np.uint8), np.eye(4)), {0: None, 2: None})
    shown, ray = function((0.0, 1.0), (1.0, 1.0)), ((-40.0, 10.2, 9.6), (1.0, 0.0, 0.0))
    largest, smallest = (
        find_surface(scene_of(volume, shown, mode=mode, labels=hidden), *ray) for mode in ("mip", "minip")
    )
    assert 3.4 < smallest.index[0] < 3.8 and SIDE - 4.8 < largest.index[0] < SIDE - 4.4
    whole = Labels(Volume(np.zeros(volume.voxels.shape, np.uint8), np.eye(4)), {0: None})
    assert find_surface(scene_of(volume, shown, mode="mip", labels=whole), *ray) is None


def test_voxels_without_a_number_are_transparent():
    voxels = np.full((SIDE,) * 3, 1000.0, np.float32)
    voxels[:, :, :10] = np.nan
    found = find_surface(scene_of(Volume(voxels, np.eye(4))), (-40.0, 10.2, 9.6), (1.0, 0.0, 0.0))
    assert found.index[0] == pytest.approx(10.0, abs=0.5) and found.value == 1000.0


def test_a_large_volume_is_read_along_the_ray_only(monkeypatch):
    """On a diagonal of 256 voxels a side: four samples for each voxel of its way."""
    voxels = np.random.default_rng(1).integers(0, 400, (256, 256, 256), dtype=np.int16)
    scene = scene_of(Volume(voxels, np.eye(4)))
    read = []
    name = "rle_splat.pipeline.first_surface.values_at"
    monkeypatch.setattr(name, lambda volume, at: read.append(len(at)) or values_at(volume, at))
    assert find_surface(scene, (-10.0, -9.0, -11.0), (1.0, 1.0, 1.0)) is None
    assert sum(read) <= 4 * 255 * math.sqrt(3.0) + 2


def test_a_point_along_a_ray_has_its_value_whether_visible_or_not():
    affine = np.diag((*SPACING, 1.0))
    clear = Scene(sphere(affine), function((0.0, 0.0), (1000.0, 0.0)), Camera())
    found = point_along(clear, (11.0, 18.0, -5.0), (0.0, 0.0, 3.0), 27.0)  # 11 voxels up
    assert found.value == 1000.0
    np.testing.assert_allclose(found.index, (11.0, 12.0, 11.0))
    np.testing.assert_allclose(found.world, (11.0, 18.0, 22.0))
    for outside in (4.9, 5.0 + 2.0 * (SIDE - 1) + 0.1, -27.0):
        assert point_along(clear, (11.0, 18.0, -5.0), (0.0, 0.0, 3.0), outside) is None
