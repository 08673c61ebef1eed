"""Shading against the formula written out voxel by voxel, and lights against what Cycles was measured to do."""

import math
from functools import partial

import numpy as np
import pytest

from rle_splat.classify.classification import classify
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.scene import Light
from rle_splat.shade.lighting import is_shaded, lighting
from rle_splat.shade.shading import shaded_colors
from rle_splat.volume.gradient import unit_normals
from rle_splat.volume.volume import Volume
from tests.lamps import pose
from tests.ways import both

WHITE = TransferFunction(opacity=((0, 0.5),), color=((0, 1, 1, 1),))
TINTED = TransferFunction(opacity=((40, 0.0), (60, 0.5)), color=((0, 0.2, 0.4, 0.8), (100, 1.5, 0.5, 0.1)))
PLACE = np.array([[0.5, 0.1, 0.0, -3.0], [0.0, 0.7, -0.2, 2.0], [0.1, 0.0, -0.6, 1.0], [0, 0, 0, 1.0]])


MATT = Shade(ambient=0, diffuse=1, specular=0, shininess=1)


def one_voxel(position, normal, lights=(), shading=MATT, color=(1, 1, 1), **kwargs):
    """Shaded color of a single small voxel at a world position with a given normal."""
    volume = Volume(np.ones((1, 1, 1), np.uint8), np.diag((1e-3, 1e-3, 1e-3, 1.0)))
    tf = TransferFunction(opacity=((0, 0.5),), color=((0, *color),))
    matrix = volume.affine.copy()
    matrix[:3, 3] = position
    classified = classify(volume, tf, matrix)
    normal = np.array([normal], np.float32)
    return shaded_colors(classified, normal, lighting(matrix, shading, lights, **kwargs))[0]


def test_measured_radiance_of_a_white_lambert_surface(way):
    here, up = (1.0, 2.0, 0.0), (0.0, 0.0, 1.0)
    above = pose((1.0, 2.0, 5.0))
    for light, radiance in (
        (Light("SUN", energy=3.0, matrix_world=above), 3.0 / math.pi),
        (Light("POINT", energy=100.0, matrix_world=above), 100.0 / (4 * math.pi**2 * 25)),
        (Light("SPOT", energy=100.0, matrix_world=above), 100.0 / (4 * math.pi**2 * 25)),
        (Light("AREA", energy=100.0, matrix_world=above, size=0.1), 100.0 / (math.pi**2 * 25)),
    ):
        got = one_voxel(here, up, (light,))
        np.testing.assert_allclose(got, radiance, rtol=1e-6)
        # Lights add up, are colored, and two-sided surfaces do not care which way the normal points.
        twice = one_voxel(here, np.negative(up), (light, light), color=(0.5, 0.25, 2.0))
        np.testing.assert_allclose(twice, 2 * radiance * np.array((0.5, 0.25, 2.0)), rtol=1e-6)
        tilted = one_voxel(here, (0.0, math.sin(1.0), math.cos(1.0)), (light,))
        np.testing.assert_allclose(tilted, radiance * math.cos(1.0), rtol=1e-6)


def test_ambient_counts_once_and_specular_is_white(way):
    lights = (Light("SUN", energy=math.pi), Light("SUN", energy=math.pi))
    got = one_voxel((0, 0, 0), (0, 0, 1), lights, Shade(0.3, 0.5, 0.25, 8.0), (0.2, 0.4, 0.6), eye=(0.0, 0.0, 1.0, 0.0))
    np.testing.assert_allclose(got, np.array((0.2, 0.4, 0.6)) * (0.3 + 2 * 0.5) + 2 * 0.25, rtol=1e-6)


def test_without_a_normal_the_color_stays(way):
    got = one_voxel((0, 0, 0), (0, 0, 0), (Light("SUN", energy=9.0),), Shade(), (0.2, 0.4, 0.6))
    np.testing.assert_array_equal(got, np.array((0.2, 0.4, 0.6), np.float32))


def test_the_spots_cone_is_a_smoothstep_of_the_cosine(way):
    angle, blend = 1.2, 0.4
    light = Light("SPOT", energy=4 * math.pi**2 * 4, matrix_world=pose((0, 0, 2)), spot_size=angle, spot_blend=blend)
    edge = math.cos(angle / 2)
    for off in (0.0, 0.2, 0.4, 0.5, 0.55, 0.59, 0.61, 1.0, 3.0):
        here = (2 * math.sin(off), 0.0, 2 - 2 * math.cos(off))
        t = min(max((math.cos(off) - edge) / ((1 - edge) * blend), 0.0), 1.0)
        facing = np.array((0, 0, 2.0)) - here
        got = one_voxel(here, facing / np.linalg.norm(facing), (light,))
        np.testing.assert_allclose(got, t * t * (3 - 2 * t), atol=2e-6)
    assert one_voxel((0, 0, -1), (0, 0, 1), (Light("SPOT", spot_blend=0.0, matrix_world=pose((0, 0, 2))),)).min() > 0


def test_an_area_light_shines_forward_by_the_cosine(way):
    light = Light("AREA", energy=math.pi**2 * 4, matrix_world=pose((0, 0, 2)), size=0.01)
    for off in (0.0, 0.7, 1.5, 1.6, 3.0):
        here = (2 * math.sin(off), 0.0, 2 - 2 * math.cos(off))
        facing = np.array((0, 0, 2.0)) - here
        got = one_voxel(here, facing / np.linalg.norm(facing), (light,))
        np.testing.assert_allclose(got, max(math.cos(off), 0.0), atol=2e-6)


def test_a14_nothing_blows_up_at_the_light(way):
    for kind in ("POINT", "SPOT", "AREA"):
        light = Light(kind, energy=10.0, radius=0.0, size=0.0)
        for here in ((0, 0, 0), (0, 0, -1e-9), (0, 0, -1e-300)):
            got = one_voxel(here, (0, 0, 1), (light,), Shade(0.1, 1.0, 1.0, 5.0), eye=(0, 0, 0, 1.0))
            assert np.isfinite(got).all()
    # No brighter than the light's own surface: P / (pi A) for an area, P / (4 pi^2 r^2) for a sphere.
    for shape, area in (("SQUARE", 4.0), ("DISK", math.pi), ("RECTANGLE", 6.0), ("ELLIPSE", 1.5 * math.pi)):
        light = Light("AREA", energy=10.0, size=2.0, size_y=3.0, shape=shape)
        np.testing.assert_allclose(one_voxel((0, 0, -1e-3), (0, 0, 1), (light,)), 10.0 / (math.pi * area), rtol=1e-6)
    scaled = Light("AREA", energy=10.0, size=1.0, matrix_world=pose(scale=2.0))
    np.testing.assert_allclose(one_voxel((0, 0, -1e-3), (0, 0, 1), (scaled,)), 10.0 / (math.pi * 4), rtol=1e-6)
    ball = Light("POINT", energy=10.0, radius=0.5)
    np.testing.assert_allclose(one_voxel((0, 0, -0.1), (0, 0, 1), (ball,)), 10.0 / (4 * math.pi**2 * 0.25), rtol=1e-6)


def written_out(classified, n, matrix, s, lights, forward, eye):
    """The formula for every voxel, with suns, points and a headlight."""
    _, ny, nz = classified.shape_xyz
    rows = np.repeat(np.arange(ny * nz), np.diff(classified.row_start))
    result = []
    for row, x, c, normal in zip(rows, classified.column, classified.color, n):
        if not normal.any():
            result.append(c)
            continue
        point = (matrix @ (int(x), row % ny, row // ny, 1.0))[:3]
        view = eye[:3] / eye[3] - point if eye[3] else eye[:3]
        view = view / np.linalg.norm(view)
        total = c * s.ambient
        for light in (*lights, None):
            if light is None:
                towards, strength = -np.asarray(forward), np.ones(3)
            elif light.type == "SUN":
                towards, strength = light.matrix_world[:3, 2], light.energy / math.pi * np.array(light.color)
            else:
                towards = light.matrix_world[:3, 3] - point
                strength = light.energy / (4 * math.pi**2 * (towards @ towards)) * np.array(light.color)
            towards = towards / np.linalg.norm(towards)
            h = (towards + view) / np.linalg.norm(towards + view)
            total = total + c * s.diffuse * abs(normal @ towards) * strength
            total = total + s.specular * abs(normal @ h) ** s.shininess * strength
        result.append(total)
    return np.array(result)


@pytest.mark.parametrize("eye", ((4.0, -20.0, 3.0, 2.0), (0.6, -0.8, 0.0, 0.0)))
@pytest.mark.parametrize("shininess", (1.0, 20.0, 7.5))
def test_a_whole_volume_is_shaded_by_the_formula(eye, shininess):
    voxels = np.random.default_rng(6).integers(0, 100, (5, 6, 7)).astype(np.uint8)
    voxels[:3, :3, :4] = 70  # some without a normal
    volume = Volume(voxels, np.eye(4))
    classified = classify(volume, TINTED, PLACE)
    lights = (
        Light("SUN", (1, 0.5, 0.2), 2.0, pose(shines_along=(1, 2, -1))),
        Light("POINT", (0.3, 1, 0.4), 90.0, pose((9, 9, 9))),
    )
    s = Shade(0.2, 0.7, 0.4, shininess)
    forward, eye = np.array((0.0, 0.6, -0.8)), np.array(eye)
    n = unit_normals(volume, classified.row_start, classified.column, PLACE)
    assert 0 < (~n.any(axis=1)).sum() < len(n)
    truth, found = written_out(classified, n.astype(float), PLACE, s, lights, forward, eye), []
    for facing in (eye, -eye):
        falling = lighting(PLACE, s, lights, headlight_direction=forward, eye=facing)
        found.append(both(partial(shaded_colors, classified, n, falling)))
    for got, flipped in zip(*found):
        assert got.dtype == np.float32
        np.testing.assert_allclose(got, truth, rtol=2e-6)
        if eye[3]:  # a homogeneous eye means the same under any factor
            np.testing.assert_array_equal(flipped, got)
    falling = lighting(PLACE, s, lights, eye=eye)
    one, two = (shaded_colors(classified, n, falling, threads=t) for t in (1, 2))
    np.testing.assert_array_equal(one, two)


def test_any_shininess_is_finite(way):
    for shininess in (0.0, 0.5, 1e6, 1e300):
        got = one_voxel((0, 0, 0), (0, 0.6, 0.8), (Light("SUN"),), Shade(0, 1, 1, shininess), eye=(0, 0, 1.0, 0))
        assert np.isfinite(got).all()


def test_shading_only_when_called_for():
    volume = Volume(np.full((2, 2, 2), 90, np.int16), np.eye(4))
    classified = classify(volume, WHITE, np.eye(4))
    sun = (Light("SUN"),)
    assert shaded_colors(classified, None, lighting(np.eye(4), None, sun)) is classified.color
    assert shaded_colors(classified, None, lighting(np.eye(4), Shade(), ())) is classified.color
    assert not is_shaded(None, sun) and not is_shaded(Shade(), ()) and is_shaded(Shade(), (), (0, 0, -1))
