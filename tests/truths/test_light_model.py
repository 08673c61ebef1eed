"""Proves the reference of light on scenes with closed forms: normals of planes and balls, transmittance of slabs, light
along a lit surface, plates, a gap, haze, and volumes without normals."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.accuracy import light_transport
from rle_splat.accuracy.clips import Clipping
from rle_splat.accuracy.integrate import integrate
from rle_splat.accuracy.light_model import ROUNDING, PostLight, find_sides, spread, voxel_width, wrap
from rle_splat.accuracy.light_normals import (
    NormalField,
    automatic_sigma,
    gaussian,
    noise_of_gradient,
    normals_of,
    smooth,
    smoothstep,
)
from rle_splat.accuracy.light_transport import Tracer
from rle_splat.accuracy.lighting import shading_of
from rle_splat.accuracy.medium import ClassifiedField
from rle_splat.accuracy.rays import WorldRays
from rle_splat.accuracy.truths import truth, world_opacity_distance
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.lighting import scene_lighting
from rle_splat.pipeline.render import render
from rle_splat.scene import Camera, Clip, Light, Quality, Scene
from rle_splat.shade.environment import panorama_moments
from rle_splat.shade.sample_light import light_of_samples, sample_light
from rle_splat.volume.volume import Volume

MATT = Shade(ambient=0.0, diffuse=1.0, specular=0.0)
# Opacities of one voxel over the value: a ramp between two values, and a step.
RAMP = ((0.3, 0.0), (0.7, 0.8))
STEP = ((0.5, 0.0), (0.5, 0.8))
TURN = np.radians(35.0)


def transfer(opacity, shade=MATT):
    return TransferFunction(name="gray", opacity=opacity, color=((0.0, 1.0, 1.0, 1.0),), opacity_unit_distance=1.0,
                            shade=shade)  # fmt: skip


def looking_along(towards, aim, **fields):
    """A parallel camera, or the matrix of a sun, whose backward axis is ``towards``."""
    back = np.asarray(towards, dtype=np.float64) / np.linalg.norm(towards)
    right = np.cross((0.3, 0.8, 0.52), back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack((right, np.cross(back, right), back), axis=1)
    matrix[:3, 3] = np.asarray(aim) + 100.0 * back
    return matrix


def scene_of(field, opacity, towards_sun, towards_eye, shade=MATT, affine=None, **more):
    """A scene with one sun of unit radiance on a surface that faces it."""
    field = np.asarray(field, dtype=np.float32)
    affine = np.eye(4) if affine is None else affine
    middle = affine[:3, :3] @ ((np.array(field.shape[::-1]) - 1.0) / 2.0)
    sun = Light("SUN", energy=np.pi, matrix_world=looking_along(towards_sun, middle))
    camera = Camera(looking_along(towards_eye, middle), type="ORTHO", ortho_scale=20.0, clip_end=1000.0)
    usual = dict(lights=(sun,), headlight=False, volume_shadows=True)
    return Scene(Volume(field, affine), transfer(opacity, shade), camera, 16, 16, **usual | more)


def trust(vector):
    return smoothstep(0.0, 0.3, np.linalg.norm(vector, axis=-1))


def positions(shape):
    """x, y, z of all voxels of an array (nz, ny, nx)."""
    return np.indices(shape, dtype=np.float64)[::-1]


def ball(count=24, radius=8.0, blur=4.0):
    """Falls from 1 to 0 over ``blur`` voxels around the radius; the distance from the center in the ramp."""
    middle = (count - 1) / 2.0
    distance = np.sqrt(sum((axis - middle) ** 2 for axis in positions((count,) * 3)))
    return np.clip(0.5 - (distance - radius) / blur, 0.0, 1.0), middle


def plane(count, phase, normal, blur=4.0):
    """The same for a plane through the middle, moved by ``phase`` voxels along its normal."""
    middle = (count - 1) / 2.0
    along = sum(n * (axis - middle) for n, axis in zip(normal, positions((count,) * 3))) - phase
    return np.clip(0.5 - along / blur, 0.0, 1.0)


def seen(scene, columns, rows):
    """(N,) red over alpha of rays, and alpha."""
    found = truth(scene, "T2", pixels=(np.asarray(columns), np.asarray(rows)), tolerance=1e-4,
                  **shading_of(scene, "T2"))[0]  # fmt: skip
    return found[:, 0] / np.maximum(found[:, 3], 1e-9), found[:, 3]


def light_at(scene, index):
    """L (N, 3) at voxel indices, and the highlights."""
    light = PostLight(scene, world_opacity_distance(scene))
    index = np.asarray(index, dtype=np.float64)
    most = np.array(scene.volume.voxels.shape[::-1]) - 1
    cell, planes = np.clip(np.floor(index), 0, np.maximum(most - 1, 0)).astype(np.int64), 0.0
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(corner, index - cell, 1.0 - (index - cell)).prod(axis=1)
        planes = planes + weight[:, None] * light.planes(*np.minimum(cell + corner, most).T[::-1])
    return light.at(index, planes)


def share_of(scene, index, number=0):
    """(N,) share of a lamp that arrives at voxel indices."""
    return Tracer(scene, world_opacity_distance(scene)).towards(scene.lights[number], np.asarray(index, float))


# ---- Formulas


def test_wrap_is_the_averaged_maximum():
    cosines = np.linspace(-0.2, 0.2, 41)
    around = np.linspace(-ROUNDING, ROUNDING, 20001)
    averaged = np.maximum(cosines[:, None] + around, 0.0).mean(axis=1)
    assert np.abs(wrap(cosines) - averaged).max() < 1e-5
    assert abs(wrap(0.5) - 0.5) < 1e-15 and wrap(-0.5) == 0.0 and abs(wrap(0.0) - ROUNDING / 4) < 1e-15


def test_all_nodes_around_a_point_one_width_outside_a_plane_are_outside():
    matrix = np.eye(4)
    matrix[:3, :3] = ((0.8, 0.2, 0.0), (0.0, 1.1, 0.3), (0.0, 0.0, 1.5))
    random = np.random.default_rng(5)
    normal = random.normal(size=(50, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    corners = (np.array(list(np.ndindex(2, 2, 2))) - random.uniform(size=(50, 1, 3))) @ matrix[:3, :3].T
    reach = np.einsum("nci,ni->nc", corners, normal)
    width = voxel_width(normal, matrix)
    assert (reach >= -width[:, None]).all() and np.allclose(np.ptp(reach, axis=1), width)


def test_sides_of_values():
    tent = ((1.0, 0.0), (2.0, 1.0), (4.0, 0.0))
    side, distance = find_sides(tent, np.array((0.5, 1.0, 1.25, 3.75, 4.0, 4.5)))
    assert (side == (1.0, 1.0, 1.0, -1.0, -1.0, -1.0)).all() and np.allclose(distance, (0.0, 0.0, 0.25, 0.25, 0.0, 0.0))
    side, distance = find_sides(tent, np.array((2.5, 2.2, 2.8)))
    assert abs(side[0]) < 1e-12 and 0.0 < side[1] < 1.0 and -1.0 < side[2] < 0.0 and np.allclose(distance[1:], 1.2)
    side, distance = find_sides(STEP, np.array((0.4, 0.5, 0.8)))
    assert (side == 1.0).all() and np.allclose(distance, (0.0, 0.0, 0.3))
    falling = find_sides(((0.2, 0.9), (0.6, 0.0)), np.array((0.1, 0.5, 0.7)))
    assert (falling[0] == -1.0).all() and np.allclose(falling[1], (0.5, 0.1, 0.0))
    gap = ((0.0, 0.5), (1.0, 0.0), (2.0, 0.0), (3.0, 0.5))
    assert np.allclose(find_sides(gap, np.array((1.0, 1.5, 2.0)))[0], (-1.0, 0.0, 1.0))
    everywhere = find_sides(((0.0, 0.5),), np.array((1.0,)))
    assert everywhere[0] == 1.0 and everywhere[1] == 0.0


# ---- Normals


@pytest.mark.parametrize("sigma", (0.0, 1.0, 2.0))
def test_noise_of_the_gradient_is_that_of_rounding(sigma):
    noise = np.random.default_rng(3).uniform(-0.5, 0.5, (32, 32, 32))
    spacing = np.array((1.0, 1.0, 2.0))
    slope = normals_of(noise, np.diag((*spacing, 1.0)), sigma)[1][7:-7, 7:-7, 7:-7]
    measured = np.sqrt((slope**2).mean())
    assert abs(measured / noise_of_gradient(sigma, spacing) - 1.0) < 0.06


def test_noise_without_smoothing_in_closed_form():
    assert abs(noise_of_gradient(0.0, (1.0, 1.0, 1.0)) - np.sqrt(1.0 / 8.0)) < 1e-15


def test_gaussian_is_cut_at_three_sigmas():
    weights = gaussian(1.0, 0.5)
    assert len(weights) == 13 and abs(weights.sum() - 1.0) < 1e-15
    assert abs(weights[6] / weights[8] - np.exp(0.5)) < 1e-12 and (gaussian(0.2, 1.0) == 1.0).all()


def test_normals_of_a_plane_are_exact_in_a_sheared_volume():
    """A linear field has the same gradient whatever the voxels' axes, off the reach of the faces.  All gradients are
    the same, so m has the length 1 but for the errors that stored floats may have."""
    affine = np.eye(4)
    affine[:3, :3] = ((0.8, 0.2, 0.0), (0.0, 1.1, 0.3), (0.0, 0.0, 1.5))
    wanted = np.array((0.3, -1.2, 0.7))
    field = np.einsum("iabc,i->abc", positions((18, 18, 18)), wanted @ affine[:3, :3])
    vector, slope = (part[8:-8, 8:-8, 8:-8] for part in normals_of(field, affine, 1.5))
    assert np.abs(slope - np.linalg.norm(wanted)).max() < 1e-12
    length = np.linalg.norm(vector, axis=-1)
    assert np.abs(vector / length[..., None] - wanted / np.linalg.norm(wanted)).max() < 1e-12
    assert np.abs(length - 1.0).max() < 1e-8


def test_normals_of_a_ball_point_to_its_center():
    field, middle = ball()
    vector = normals_of(field, np.eye(4), 1.0)[0]
    away = np.moveaxis(positions(field.shape), 0, -1) - middle
    radius = np.linalg.norm(away, axis=-1)
    shell = np.abs(radius - 8.0) < 2.0
    cosine = -(vector * away).sum(axis=-1)[shell] / (np.linalg.norm(vector, axis=-1) * radius)[shell]
    assert np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).max() < 1.5
    assert (trust(vector)[shell] == 1.0).all()


@pytest.mark.parametrize("sigma", (0.0, 1.0))
def test_rounding_has_no_normal_and_a_surface_in_whole_numbers_has_one(sigma):
    """A toss of a coin for each voxel errs by the square root of 3 times as much as rounding."""
    noise = np.random.default_rng(4).integers(0, 2, (20, 20, 20)).astype(np.uint8)
    assert trust(normals_of(noise, np.eye(4), sigma)[0]).mean() < 0.1
    steep = np.round(20.0 * ball()[0]).astype(np.uint8)
    shell = np.abs(np.linalg.norm(np.moveaxis(positions(steep.shape), 0, -1) - 11.5, axis=-1) - 8.0) < 1.0
    assert trust(normals_of(steep, np.eye(4), sigma)[0])[shell].min() > 0.9


def test_bricks_are_parts_of_the_whole():
    random = np.random.default_rng(6)
    voxels = random.random((70, 5, 40)).astype(np.float32)
    affine = np.diag((1.0, 0.7, 0.5, 1.0))
    z, y, x = (random.integers(0, count, 60) for count in voxels.shape)
    vector, slope = normals_of(voxels, affine, 1.0)
    found = NormalField(voxels, affine, 1.0).at(z, y, x)
    assert np.abs(found[:, :3] - vector[z, y, x]).max() < 1e-12 and np.abs(found[:, 3] - slope[z, y, x]).max() < 1e-12


def test_a_constant_has_no_gradient_beside_nan_or_a_face():
    field = np.full((7, 8, 9), 3.7, np.float32)
    field[3, 4, 5] = np.nan
    for sigma in (0.0, 1.0, 50.0):
        vector, slope = normals_of(field, np.eye(4), sigma)
        assert np.isfinite(slope).all() and np.linalg.norm(vector, axis=-1).max() < 1e-2


def test_a_smoothness_larger_than_the_volume_is_a_mean():
    field = np.random.default_rng(1).random((4, 5, 6))
    assert np.abs(smooth(field, 1e4, np.ones(3)) - field.mean()).max() < 1e-6
    assert automatic_sigma(np.diag((0.5, 0.5, 5.0, 1.0))) == 2.0
    assert automatic_sigma(np.diag((0.5, 0.5, 1.25, 1.0))) == 1.25


# ---- Shadows


def slab(alpha=0.3, first=6, last=10, count=16):
    """Plates between the planes z = first and z = last that end between two voxels."""
    field = np.zeros((count,) * 3)
    field[first : last + 1] = alpha
    return field


def test_transmittance_of_a_slab_in_closed_form():
    """Constant extinction within the slab; beside it the extinction falls linearly over a voxel."""
    alpha = 0.3
    towards = np.array((np.sin(TURN), 0.0, np.cos(TURN)))
    scene = scene_of(slab(alpha), ((0.0, 0.0), (1.0, 1.0)), towards, (0.0, 0.0, 1.0))
    inside = -np.log(1.0 - alpha)
    below = np.array(((5.0, 7.0, 3.0), (4.0, 7.0, 7.0), (4.0, 7.0, 11.5)))
    exact = np.exp(-np.array((5.0 * inside, 3.5 * inside, 0.0)) / np.cos(TURN))
    assert np.abs(share_of(scene, below) - exact).max() < 1e-7


def test_scattered_light_of_a_slab_in_closed_form():
    alpha, towards = 0.9, np.array((np.sin(TURN), 0.0, np.cos(TURN)))
    scene = scene_of(slab(alpha), ((0.0, 0.0), (1.0, 1.0)), towards, (0.0, 0.0, 1.0))
    index = np.array(((5.0, 7.0, 3.0), (4.0, 7.0, 7.0), (4.0, 7.0, 11.5)))
    depth = -np.log(1.0 - alpha) * np.array((5.0, 3.5, 0.0)) / np.cos(TURN)
    assert depth[0] > 10.0  # of which T keeps nothing
    found = Tracer(scene, world_opacity_distance(scene)).scattered(scene.lights[0], index)
    assert np.abs(found - (0.5 * np.exp(-depth / 2.0) + 0.25 * np.exp(-depth / 4.0)) / 0.75).max() < 1e-6


def test_transmittance_is_that_of_the_integral_along_rays():
    """The same as the alpha of the classified medium, in a sheared volume, past a clip object, to a sun and a lamp."""
    random = np.random.default_rng(7)
    field = random.uniform(0.0, 1.0, (9, 11, 10)) * (random.uniform(size=(9, 11, 10)) < 0.4)
    field[[0, -1]], field[:, [0, -1]], field[..., [0, -1]] = 0.0, 0.0, 0.0  # T1 reaches a voxel further
    affine = np.eye(4)
    affine[:3] = ((0.8, 0.2, 0.0, 1.0), (0.0, 1.1, 0.3, -2.0), (0.0, 0.0, 1.5, 0.5))
    at = np.eye(4)
    at[:3, 3] = affine[:3] @ (4.0, 5.0, 7.2, 1.0)
    clip = np.diag((1.5, 1.5, 1.5, 1.0))
    clip[:3, 3] = affine[:3] @ (4.0, 5.0, 4.0, 1.0)
    for clips in ((), (Clip("box", clip, keep="outside"),)):
        scene = scene_of(field, ((0.2, 0.0), (1.0, 0.4)), (0.4, 0.3, 1.0), (0, 0, 1), affine=affine, clips=clips)
        scene = replace(scene, lights=(*scene.lights, Light("POINT", matrix_world=at)))
        index = random.uniform(0.0, 8.0, (40, 3))
        world = index @ affine[:3, :3].T + affine[:3, 3]
        medium = ClassifiedField.of_scalars(field, np.asarray, scene.transfer_function, world_opacity_distance(scene))
        towards = scene.lights[0].matrix_world[:3, 2]
        for number, direction in enumerate((np.broadcast_to(towards, world.shape), at[:3, 3] - world)):
            length = np.linalg.norm(direction, axis=1)
            rays = WorldRays(world, direction / length[:, None], np.ones(len(world)))
            clipping = Clipping(clips, rays) if clips else None
            far = np.inf if number == 0 else length
            alpha = integrate(medium, rays, scene.index_to_world, 0.0, far, 1e-9, clipping)[0][:, 3]
            found = share_of(scene, index, number)
            assert np.ptp(alpha) > 0.3 and np.abs(found - (1.0 - alpha)).max() < 1e-6


def test_meshes_block_light():
    triangle = np.array((((2.0, 2.0, 10.0), (9.0, 2.0, 10.0), (2.0, 9.0, 10.0)),))
    scene = scene_of(np.zeros((12, 12, 12)), RAMP, (0, 0, 1), (0, 0, 1), triangles=triangle)
    index = np.random.default_rng(8).uniform(0.0, 11.0, (2000, 3))
    x, y, z = index.T
    inside = (x > 2.0) & (y > 2.0) & (x + y < 11.0) & (z < 10.0)
    assert (share_of(scene, index) == ~inside).all()
    at = np.eye(4)
    at[:3, 3] = 3.0, 3.0, 20.0
    scene = replace(scene, lights=(Light("POINT", matrix_world=at),))
    x, y = (3.0 + (part - 3.0) * (10.0 / (20.0 - z)) for part in (x, y))
    assert (share_of(scene, index) == ~((x > 2.0) & (y > 2.0) & (x + y < 11.0) & (z < 10.0))).all()


def test_a_lamp_within_the_volume_lights_what_it_sees():
    lamp_at = np.eye(4)
    lamp_at[:3, 3] = (7.0, 7.0, 8.0)
    lamp = Light("POINT", energy=100.0, matrix_world=lamp_at)
    scene = scene_of(slab(), ((0.0, 0.0), (1.0, 1.0)), (0, 0, 1), (0, 0, 1), lights=(lamp,))
    found = share_of(scene, ((7.0, 7.0, 8.0), (7.0, 7.0, 10.0), (7.0, 7.0, 6.0)))
    assert np.abs(found - (1.0, 0.49, 0.49)).max() < 2e-6
    matt, glossy = light_at(scene, ((7.0, 7.0, 8.0), (7.0, 7.0, 10.4)))
    assert np.isfinite(matt).all() and np.isfinite(glossy).all()


def test_what_is_cut_away_casts_no_shadow():
    matrix = np.eye(4)
    matrix[2, 3] = 8.0
    scene = scene_of(slab(), ((0.0, 0.0), (1.0, 1.0)), (0, 0, 1), (0, 0, 1), clips=(Clip("plane", matrix),))
    found = share_of(scene, ((7.0, 7.0, 8.0), (7.0, 7.0, 7.0)))
    assert np.abs(found - (1.0, 0.7)).max() < 2e-6


def test_the_sky_is_nearly_that_of_many_directions(monkeypatch):
    """Above a slab, at its face and within it."""
    scene = scene_of(slab(), ((0.0, 0.0), (1.0, 1.0)), (0, 0, 1), (0, 0, 1), ambient_occlusion=1.0)
    tracer, places = Tracer(scene, 1.0), np.array(((7.0, 7.0, 15.0), (7.0, 7.0, 11.0), (7.0, 7.0, 8.0)))
    few, anywhere = tracer.openness(places), np.random.default_rng(6).normal(size=(20000, 3))
    monkeypatch.setattr(light_transport, "SKY", anywhere / np.linalg.norm(anywhere, axis=1, keepdims=True))
    np.testing.assert_allclose(few, tracer.openness(places), atol=0.01)


# ---- Light of points


@pytest.mark.parametrize("kind", ("SUN", "POINT", "SPOT", "AREA"))
@pytest.mark.parametrize("two_sided", (False, True))
@pytest.mark.parametrize("camera", ("ORTHO", "PERSP"))
@pytest.mark.parametrize("indirect", (0.0, 0.7))
def test_light_of_points_is_the_renderers_formula(kind, two_sided, camera, indirect):
    """Both are written apart, of the same planes."""
    random = np.random.default_rng(5)
    mean, environment = panorama_moments(random.uniform(0.0, 2.0, (8, 16, 3)), np.eye(3))
    shade = Shade(0.2, 0.7, 0.4, 9.0, two_sided)
    field = random.uniform(size=(8, 8, 8))
    scene = scene_of(field, RAMP, (0.3, 0.2, 1.0), (0.5, -0.4, 1.0), shade, ambient_occlusion=0.6, world=mean,
                     environment=environment, headlight=True, indirect_light=indirect)  # fmt: skip
    lamp = replace(scene.lights[0], type=kind, energy=3e4 if kind != "SUN" else 3.0, spot_size=0.05, radius=0.5)
    scene = replace(scene, lights=(lamp, replace(lamp, casts_shadow=False)),
                    camera=replace(scene.camera, type=camera))  # fmt: skip
    index, planes = random.uniform(0.0, 7.0, (200, 3)), random.uniform(0.0, 1.0, (200, 5 + (indirect > 0.0)))
    planes[:, :3] = random.normal(size=(200, 3)) * random.uniform(0.0, 0.4, (200, 1))
    ours = PostLight(scene, 1.0).at(index, planes)
    falling = scene_lighting(scene, scene.index_to_world)
    eye = falling.eye[:3] - index * falling.eye[3]
    eye = eye / np.linalg.norm(eye, axis=1, keepdims=True) * np.ones((200, 1))
    theirs = light_of_samples(sample_light(falling, (8, 8, 8), (0,), True, indirect), planes, eye, index)
    assert np.ptp(ours[0]) > 0.5 and np.ptp(ours[1]) > 0.1
    np.testing.assert_allclose(ours[0], theirs[0], atol=1e-9)
    np.testing.assert_allclose(ours[1], theirs[1], atol=1e-9)


def test_haze_is_lit_as_a_cloud():
    """No gradient: L is diffuse times the transmittance to the sun, in closed form, whatever the sun's direction."""
    scene = scene_of(np.full((12, 12, 12), 0.05), ((0.0, 0.0), (1.0, 1.0)), (0, 0, 1), (0, 0, 1))
    index = np.array(((5.0, 6.0, 3.0), (6.0, 5.0, 8.0)))
    found = light_at(scene, index)[0]
    assert np.abs(found - (0.95 ** (11.0 - index[:, 2:]))).max() < 1e-5


def test_haze_has_the_sum_of_octaves():
    """In closed form; it is never brighter than without anything before it, and where nothing is, as bright."""
    density = 0.3
    scene = scene_of(np.full((12, 12, 12), density), ((0.0, 0.0), (1.0, 1.0)), (0, 0, 1), (0, 0, 1), indirect_light=1.0)
    index = np.array(((5.0, 6.0, 3.0), (6.0, 5.0, 8.0)))
    depth = -np.log(1.0 - density) * (11.0 - index[:, 2:])
    octaves = sum(0.5**n * np.exp(-(0.5**n) * depth) for n in range(3)) / sum(0.5**n for n in range(3))
    assert np.abs(light_at(scene, index)[0] - octaves).max() < 1e-5
    half = light_at(replace(scene, indirect_light=0.5), index)[0]
    assert np.abs(half - 0.5 * (octaves + np.exp(-depth))).max() < 1e-5


def test_indirect_light_counts_what_is_seen_of_a_half_space():
    """Both octaves, integrated over the depth at which the eye sees them; at most all of it, and all that comes
    straight."""
    cosine, depth = np.linspace(0.1, 1.0, 10), (np.arange(200000) + 0.5) * 1e-4
    seen = [
        np.array([(np.exp(-s * depth / c) * np.exp(-depth)).sum() for c in cosine]) for s in (0.5, 0.25)
    ]  # fmt: skip
    wanted = sum(weight * part / part[-1] for weight, part in zip((2.0 / 3.0, 1.0 / 3.0), seen))
    assert np.abs(spread(cosine) - wanted).max() < 0.006
    every = spread(np.linspace(-1.0, 1.0, 2001))
    assert every.min() >= 0.0 and every.max() < 1.0 + 1e-12 and abs(spread(1.0) - 1.0) < 1e-12 and spread(-1.0) == 1.0
    assert np.abs(np.diff(every)).max() < 5e-3


def test_the_face_of_a_constant_cube_is_a_plane():
    shade = Shade(ambient=0.0, diffuse=1.0, specular=0.0)
    towards = np.array((np.sin(TURN), 0.0, np.cos(TURN)))
    scene = scene_of(np.full((12, 12, 12), 0.5), ((0.0, 0.0), (1.0, 1.0)), towards, towards, shade)
    found = light_at(scene, ((6.0, 6.0, 11.0), (6.0, 6.0, 10.999)))[0]
    assert np.abs(found - np.cos(TURN)).max() < 0.01


def test_the_face_of_a_cut_is_a_plane_within_noise():
    noise = np.random.default_rng(2).uniform(0.4, 0.6, (16, 16, 16))
    matrix = np.eye(4)
    matrix[2, 3] = 8.0
    towards = np.array((np.sin(TURN), 0.0, np.cos(TURN)))
    scene = scene_of(noise, ((0.0, 0.0), (1.0, 1.0)), towards, towards, clips=(Clip("plane", matrix),))
    index = np.random.default_rng(3).uniform(5.0, 10.0, (20, 3))
    index[:, 2] = 8.0
    assert np.abs(light_at(scene, index)[0] - np.cos(TURN)).max() < 1e-6


def test_light_is_continuous_along_a_line():
    field, middle = ball()
    scene = scene_of(field, RAMP, (0.5, 0.4, 1.0), (0, 0, 1), shade=Shade(), ambient_occlusion=0.5)
    line = np.linspace(0.0, 1.0, 400)[:, None] * (5.0, 0.5, 6.0) + (middle + 1.0, middle, middle + 1.0)
    coarse = np.abs(np.diff(sum(light_at(scene, line[::2])), axis=0)).max()
    fine = np.abs(np.diff(sum(light_at(scene, line)), axis=0)).max()
    assert fine < 0.65 * coarse  # a step would stay as it is


def test_volumes_of_one_voxel_and_nan_are_finite():
    thin = np.full((1, 8, 8), 0.5)
    scene = scene_of(thin, STEP, (0, 0, 1), (0, 0, 1))
    assert np.isfinite(sum(light_at(scene, ((3.0, 3.0, 0.0),)))).all()
    assert (truth(scene, "T2", tolerance=1e-3, **shading_of(scene, "T2"))[0] == 0.0).all()
    field, _ = ball(16, 5.0)
    field[:, :, 12:] = np.nan
    scene = scene_of(field, RAMP, (0, 0, 1), (0, 0, 1))
    brightness, alpha = seen(scene, (8.0, 7.0), (8.0, 8.0))
    assert np.isfinite(brightness).all() and alpha.max() > 0.9


# ---- Light of surfaces


@pytest.mark.parametrize("opacity", (RAMP, STEP), ids=("ramp", "step"))
def test_light_of_a_plane_does_not_depend_on_its_phase(opacity):
    """Ripple over the phase of the surface between voxels, and the mean over the light without shadows."""
    normal = np.array((0.0, 0.0, 1.0))
    lit, plain = [], []
    for phase in np.linspace(0.0, 1.0, 6)[:-1]:
        field = plane(16, phase, normal)
        shadowed = scene_of(field, opacity, (np.sin(TURN), 0.0, np.cos(TURN)), normal)
        lit.append(seen(shadowed, (8.0,), (8.0,))[0][0])
        open_ = scene_of(field, opacity, (np.sin(TURN), 0.0, np.cos(TURN)), normal, volume_shadows=False)
        plain.append(seen(open_, (8.0,), (8.0,))[0][0])
    assert np.abs(np.array(plain) - np.cos(TURN)).max() < 1e-3
    assert np.ptp(lit) / np.mean(lit) < 0.009 and np.mean(lit) > 0.95 * np.mean(plain)


@pytest.mark.parametrize("opacity", (RAMP, STEP), ids=("ramp", "step"))
def test_light_of_a_ball_is_that_of_its_normals(opacity):
    field, _ = ball()
    towards = np.array((0.2, 0.3, 1.0)) / np.linalg.norm((0.2, 0.3, 1.0))
    where = np.linspace(-4.0, 4.0, 9)
    columns, rows = where * 0.8 + 8.0, where * 0.3 + 8.0
    ratio = (seen(scene_of(field, opacity, towards, towards), columns, rows)[0]
             / seen(scene_of(field, opacity, towards, towards, volume_shadows=False), columns, rows)[0])  # fmt: skip
    assert np.ptp(ratio) < 0.01 and ratio.mean() > 0.95


@pytest.mark.parametrize("thickness", (1, 2, 4))
def test_light_leaks_through_plates_as_they_transmit(thickness):
    """A plate between the sun and the eye.  Its near side faces away from the sun, so only light as of a cloud is left.

    Its far half, which faces the sun, lit without its own shade would show at most exp(-tau / 2)."""
    field = np.zeros((20, 20, 20))
    field[8 : 8 + thickness] = 1.0
    scene = scene_of(field, ((0.3, 0.0), (0.7, 0.95)), (0, 0, 1), (0, 0, -1))
    brightness, alpha = seen(scene, (8.0,), (8.0,))
    depth = -np.log1p(-alpha)
    assert brightness[0] < np.exp(-depth[0] / 2.0) + 2e-3


@pytest.mark.parametrize("quality", ("truth", "draft", "standard", "strict"))
def test_a_thin_wall_is_not_shaded_by_its_own_far_side(quality):
    """An oblique wall that is seen through: under a sun before it, shadows change next to nothing."""
    z, y, x = np.indices((24, 40, 40)) - 0.5 * (np.array((24, 40, 40)) - 1.0)[:, None, None, None]
    normal = np.array((0.25, 0.45, 0.86)) / np.linalg.norm((0.25, 0.45, 0.86))
    field = np.exp(-0.5 * ((x * normal[0] + y * normal[1] + z * normal[2]) / 1.1) ** 2)
    found = []
    for shadows in (True, False):
        given = normal + (0.5, -0.2, 0.0), normal + (-0.3, 0.2, 0.1)
        scene = scene_of(field, ((0.45, 0.0), (0.8, 0.9)), *given, volume_shadows=shadows)
        scene = replace(scene, width=100, height=100, camera=replace(scene.camera, ortho_scale=20.0))
        if quality == "truth":
            where = np.linspace(20.0, 80.0, 13)
            light = shading_of(scene, "T2")["light"]
            found.append(truth(scene, "T2", pixels=(where, where), light=light)[0][:, 0])
        else:
            found.append(render(scene, Quality.preset(quality)).rgba[15:85, 15:85, 0])
    assert found[1].min() > 0.2
    np.testing.assert_allclose(*found, rtol=0.025)


def test_a_gap_of_two_voxels_is_dark():
    field = np.zeros((20, 20, 20))
    field[4:8], field[10:14] = 1.0, 1.0
    scene = scene_of(field, ((0.3, 0.0), (0.7, 0.95)), (0, 0, 1), (0, 0, 1))
    assert light_at(scene, ((9.5, 9.5, 7.3),))[0].max() < 0.02


def test_a_plate_before_a_lamp_is_translucent():
    """Its dark side has the octaves of the light that comes through, and a thick one stays dark."""
    found = []
    for thickness in (2, 10):
        field = np.zeros((20, 20, 20))
        field[8 : 8 + thickness] = 1.0
        scene = scene_of(field, ((0.3, 0.0), (0.7, 0.9)), (0, 0, 1), (0, 0, -1))
        plain, lit = (seen(replace(scene, indirect_light=amount), (8.0,), (8.0,))[0][0] for amount in (0.0, 1.0))
        found.append((plain, lit))
    assert found[0][1] > 2.0 * found[0][0] and found[0][1] > 0.05 and found[1][1] < 0.01
