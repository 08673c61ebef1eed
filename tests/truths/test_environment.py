"""A world that differs by direction: its light by normal against the integral over the hemisphere, taken directly."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.accuracy.lighting import ReferenceLight, shading_of
from rle_splat.classify.transfer_function import Shade
from rle_splat.comparison.medium import scene_medium
from rle_splat.pipeline.render import render
from rle_splat.pipeline.scan_source import classify_and_shade
from rle_splat.runtime.steps import Clock
from rle_splat.scene import Environment, Light, Quality, RleSplatError
from rle_splat.shade.environment import light_by_normal, most_by_normal, panorama_moments, sphere_moments, terms_of
from tests.truths.measure import measure

HEIGHT, WIDTH = 64, 128
MATT = Shade(0.1, 0.8, 0.0, 1.0)


def directions():
    """Directions (H, W, 3) of the pixels of a panorama in Blender's order, and their solid angles (H, W)."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    latitude, longitude = (0.5 - (v + 0.5) / HEIGHT) * np.pi, (0.5 - (u + 0.5) / WIDTH) * 2.0 * np.pi
    flat = np.cos(latitude)
    towards = np.stack((flat * np.cos(longitude), flat * np.sin(longitude), np.sin(latitude)), axis=-1)
    return towards, flat * (np.pi / HEIGHT) * (2.0 * np.pi / WIDTH)


TOWARDS, ANGLES = directions()


def sky(sharpness=6.0):
    """A blue sky over a brown ground with a warm, broad sun, (H, W, 3)."""
    up = TOWARDS[..., 2:]
    found = np.where(up > 0.0, (0.3, 0.5, 0.9), (0.25, 0.15, 0.1))
    sun = np.array((0.6, -0.5, 0.62))
    return found + np.exp(sharpness * (TOWARDS @ (sun / np.linalg.norm(sun)) - 1.0))[..., None] * (4.0, 3.0, 1.5)


def received(pixels, normals):
    """Radiance of white Lambert surfaces: the integral of radiance times cosine over the hemisphere, over pi."""
    cosines = np.maximum(TOWARDS @ normals.T, 0.0) * ANGLES[..., None]
    return np.tensordot(cosines, pixels, axes=((0, 1), (0, 1))) / np.pi


def normals(count=200):
    found = np.random.default_rng(3).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def ball(stage):
    """A ball whose values grow inwards, (scene, voxel indices, gradients of its voxels by their places)."""
    z, y, x = np.mgrid[:19, :19, :19] - 9.0
    radius = np.sqrt(x**2 + y**2 + z**2)
    volume = stage.volume(np.clip(1.0 - radius / 11.0, 0.0, 1.0))
    plain = stage.before(volume, stage.looking((60.0, 10.0, 10.0), (9.0, 9.0, 9.0), ortho_scale=20.0), (32, 32))
    white = replace(plain.transfer_function, shade=MATT, color=((0.0, 1.0, 1.0, 1.0),))
    return replace(plain, transfer_function=white, headlight=False)


def test_light_by_normal_is_the_integral_over_the_hemisphere():
    mean, environment = panorama_moments(sky(), np.eye(3))
    n = normals()
    found = mean + light_by_normal(-n, terms_of(environment))
    expected = received(sky(), n)
    np.testing.assert_allclose(mean, (ANGLES[..., None] * sky()).sum(axis=(0, 1)) / (4.0 * np.pi), rtol=1e-3)
    assert np.abs(found - expected).max() < 0.02 * expected.max()  # what lies beyond order 2
    assert np.ptp(expected, axis=0).min() > 0.5 * expected.max(axis=0).min()
    bound = np.array(mean) + most_by_normal(terms_of(environment))
    assert (found <= bound + 1e-12).all() and (bound < 1.1 * found.max(axis=0)).all()


def test_light_of_a_world_within_order_two_is_exact():
    x, y, z = np.moveaxis(TOWARDS, -1, 0)
    smooth = np.stack((1.0 + x, 2.0 + y * z - 0.5 * z, 1.5 + x * y + z * z), axis=-1)
    mean, environment = panorama_moments(smooth, np.eye(3))
    found = mean + light_by_normal(-normals(), terms_of(environment))
    np.testing.assert_allclose(found, received(smooth, normals()), atol=2e-3)


def test_a_turned_panorama_lights_turned_normals():
    angle = 0.7
    turn = np.array(((np.cos(angle), -np.sin(angle), 0), (np.sin(angle), np.cos(angle), 0), (0, 0, 1)))
    turn = turn @ np.array(((1, 0, 0), (0, 0.6, -0.8), (0, 0.8, 0.6)))
    mean, environment = panorama_moments(sky(), np.eye(3))
    turned_mean, turned = panorama_moments(sky(), turn)
    assert turned_mean == mean
    np.testing.assert_allclose(
        light_by_normal(normals() @ turn.T, terms_of(turned)), light_by_normal(normals(), terms_of(environment)),
        atol=1e-12,
    )  # fmt: skip


def test_the_environment_behind_the_light_on_a_sphere():
    mean, environment = panorama_moments(sky(), np.eye(3))
    n = TOWARDS.reshape(-1, 3)
    light = mean + light_by_normal(-n, terms_of(environment))
    found_mean, found = sphere_moments(n, light, ANGLES.ravel())
    np.testing.assert_allclose(found_mean, mean, atol=1e-9)
    np.testing.assert_allclose(found.first, environment.first, atol=1e-9)
    np.testing.assert_allclose(found.second, environment.second, atol=1e-9)


def test_a_ball_has_the_light_of_the_hemisphere_outside_it(ball, way):
    mean, environment = panorama_moments(sky(), np.eye(3))
    lit = replace(ball, world=mean, environment=environment)
    indices = scene_medium(lit, Quality(classification="pre")).indices
    colors = classify_and_shade(lit, Quality(), Clock())[1]
    np.testing.assert_allclose(ReferenceLight(lit).color(indices), colors, atol=2e-5)  # written apart, in float64
    place = np.stack(indices[::-1], axis=1) - 9.0
    radius = np.linalg.norm(place, axis=1)
    even = np.flatnonzero((radius > 4.0) & (radius < 8.0))[::12]
    expected = 0.1 + 0.8 * received(sky(), place[even] / radius[even, None])
    assert len(even) > 100 and np.ptp(expected) > 0.5
    np.testing.assert_allclose(colors[even], expected, atol=0.02 * expected.max())


@pytest.mark.parametrize("classification", ("post", "pre"))
def test_pictures_under_a_sky_have_the_light_of_their_truth(ball, classification):
    gray = sky().mean(axis=-1, keepdims=True).repeat(3, axis=-1)  # one channel of light
    mean, environment = panorama_moments(gray, np.eye(3))
    lit = replace(ball, world=mean, environment=environment)
    picture = render(lit, Quality(classification=classification)).rgba
    name = {"pre": "T1", "post": "T2"}[classification]
    found = measure(lit, picture, name, 8.0, count=200, **shading_of(lit, name))
    even = replace(lit, environment=None)
    usual = measure(even, render(even, Quality(classification=classification)).rgba, name, 8.0, count=200,
                    **shading_of(even, name))  # fmt: skip
    other = measure(even, picture, name, 8.0, count=200, **shading_of(even, name))
    assert found["random"]["rmse"] < min(1.1 * usual["random"]["rmse"], 0.3 * other["random"]["rmse"])


def test_a_small_sun_darkens_nothing_below_black(ball):
    """Order 2 swings below zero opposite a small bright sun; light is not taken away there."""
    _mean, environment = panorama_moments(sky(400.0) - sky(6.0).min() + 1e-3, np.eye(3))
    lit = replace(ball, world=(1e-3,) * 3, environment=environment)
    colors = classify_and_shade(lit, Quality(), Clock())[1]
    assert colors.min() >= np.float32(0.1)
    sun = Light("SUN", energy=2.0)
    both = classify_and_shade(replace(lit, lights=(sun,)), Quality(), Clock())[1]
    assert (both >= colors - 1e-6).all() and (both > colors + 0.1).any()


def test_environments_that_are_none():
    with pytest.raises(RleSplatError, match="first moment"):
        Environment(np.zeros(3), np.zeros((3, 3, 3)))
    with pytest.raises(RleSplatError, match="second moment"):
        Environment(np.zeros((3, 3)), np.full((3, 3, 3), np.nan))


def test_an_environment_needs_its_mean(ball):
    with pytest.raises(RleSplatError, match="mean radiance"):
        replace(ball, environment=Environment(np.zeros((3, 3)), np.zeros((3, 3, 3))))
