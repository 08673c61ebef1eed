"""Proves that the truths' own light on voxels and the renderer's, written independently, say the same of every voxel,
under every kind of light and from both kinds of camera."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.phantoms import blobs
from rle_splat.accuracy.lighting import ReferenceLight, shading_of
from rle_splat.classify.transfer_function import Shade
from rle_splat.comparison.medium import scene_medium
from rle_splat.pipeline.scan_source import classify_and_shade
from rle_splat.runtime.steps import Clock
from rle_splat.scene import Light, Quality
from tests.truths.measure import measure

SHADE = Shade(ambient=0.2, diffuse=0.7, specular=0.4, shininess=11.5)
AFFINE = np.array(((-0.9, 0.2, 0, 1), (0, 1.0, 0.3, 2), (0, 0, 1.3, 3), (0, 0, 0, 1.0)))


def lights(stage):
    matrix = stage.looking((30.0, -14.0, 20.0), (8.0, 8.0, 9.0)).matrix_world
    return {
        "sun": Light("SUN", (1.0, 0.8, 0.5), 3.0, matrix),
        "point": Light("POINT", (0.5, 0.8, 1.0), 30_000.0, matrix, radius=0.5),
        "spot": Light("SPOT", (1.0, 1.0, 1.0), 30_000.0, matrix, spot_size=0.5, spot_blend=0.4),
        "area": Light("AREA", (1.0, 0.9, 1.0), 20_000.0, matrix, size=4.0, size_y=2.0, shape="ELLIPSE"),
        "near": Light("POINT", (1.0, 1.0, 1.0), 500.0, stage.looking((-7.0, 9.0, 11.0), (0, 0, 0)).matrix_world),
    }


@pytest.fixture(scope="module")
def scene(stage):
    scalars = np.round(255.0 * blobs((18, 16, 14), 8)).astype(np.uint8)
    volume = replace(stage.volume(scalars, AFFINE), voxels=scalars, slope=1 / 255)
    camera = stage.looking((60.0, -80.0, 45.0), (-4.0, 10.0, 12.0), lens=110.0, ortho_scale=30.0)
    plain = stage.before(volume, camera, (24, 24))
    return replace(plain, transfer_function=replace(plain.transfer_function, shade=SHADE))


@pytest.mark.parametrize("kind", ("PERSP", "ORTHO"))
@pytest.mark.parametrize("name", ("sun", "point", "spot", "area", "near", "headlight"))
def test_every_voxel_has_the_renderers_color(stage, scene, name, kind):
    lit = replace(
        scene, camera=replace(scene.camera, type=kind), headlight=name == "headlight",
        lights=() if name == "headlight" else (lights(stage)[name],),
    )  # fmt: skip
    _, theirs = classify_and_shade(lit, Quality(), Clock())
    ours = ReferenceLight(lit).color(scene_medium(lit, Quality(classification="pre")).indices)
    plain = scene_medium(replace(lit, headlight=False, lights=()), Quality(classification="pre")).colors
    assert np.abs(theirs - plain).max() > 0.1 and len(ours) > 500
    np.testing.assert_allclose(ours, theirs, atol=2e-5)


@pytest.mark.parametrize("kind", ("PERSP", "ORTHO"))
@pytest.mark.parametrize("name", ("sun", "point"))
def test_surfaces_of_one_side(stage, scene, name, kind, way):
    usual = replace(scene, camera=replace(scene.camera, type=kind), lights=(lights(stage)[name],), headlight=False)
    shade = replace(SHADE, two_sided=False)
    lit = replace(usual, transfer_function=replace(usual.transfer_function, shade=shade))
    quality = Quality()
    theirs = classify_and_shade(lit, quality, Clock())[1]
    ours = ReferenceLight(lit).color(scene_medium(lit, Quality(classification="pre")).indices)
    np.testing.assert_allclose(ours, theirs, atol=2e-5)
    before = classify_and_shade(usual, quality, Clock())[1]
    darker = (theirs < before - 0.02).any(axis=1).mean()
    assert np.abs(theirs - before).max() > 0.05 and 0.2 < darker < 0.8


def test_a_sun_on_a_ball_of_one_side_lights_the_half_that_faces_it(stage):
    """Lambert's cosine towards the light, nothing but ambient light behind; values grow inwards."""
    z, y, x = np.mgrid[:21, :21, :21] - 10.0
    radius = np.sqrt(x**2 + y**2 + z**2)
    volume = stage.volume(np.clip(1.0 - radius / 12.0, 0.0, 1.0))
    plain = stage.before(volume, stage.looking((60.0, 10.0, 10.0), (10.0, 10.0, 10.0)), (8, 8))
    shade = Shade(0.25, 0.5, 0.0, 1.0, two_sided=False)
    white = replace(plain.transfer_function, shade=shade, color=((0.0, 1.0, 1.0, 1.0),))
    sun = Light("SUN", (1.0, 1.0, 1.0), np.pi, stage.looking((9.0, 0.0, 0.0), (0.0, 0.0, 0.0)).matrix_world)
    scene = replace(plain, transfer_function=white, lights=(sun,), headlight=False)
    indices = scene_medium(scene, Quality(classification="pre")).indices
    colors = classify_and_shade(scene, Quality(), Clock())[1]
    z, y, x = (place - 10.0 for place in indices)
    radius = np.sqrt(x**2 + y**2 + z**2)
    even = (radius > 4.0) & (radius < 8.0)
    expected = 0.25 + 0.5 * np.clip(x / np.maximum(radius, 1.0), 0.0, None)
    assert even.sum() > 1000
    np.testing.assert_allclose(colors[even], np.repeat(expected[even, None], 3, axis=1), atol=0.01)


def test_what_has_light_in_the_truths(scene):
    lit = replace(scene, headlight=True)
    assert shading_of(scene, "T1") == {} == shading_of(scene, "T2") == shading_of(replace(lit, mode="xray"), "T2")
    assert list(shading_of(lit, "T1")) == ["colors"] and list(shading_of(lit, "T2")) == ["light"]


def test_standard_keeps_its_promise_in_light(stage, scene):
    lit = replace(scene, headlight=True, width=64, height=64)
    picture = stage.render(lit).rgba
    found = measure(lit, picture, "T1", 4.0, count=400, **shading_of(lit, "T1"))
    assert found["kept"] and found["random"]["rmse"] < 0.5
    assert not measure(lit, picture, "T1", 4.0, count=400)["kept"]
