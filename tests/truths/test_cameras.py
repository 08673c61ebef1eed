"""Proves that the picture follows the camera and the volume's matrix, whatever they are: random affines (sheared,
mirrored, 1:1:3), shift, pixel aspect, sensor fits, wide angles, an eye between the slices beside the volume."""

import numpy as np
import pytest

from benchmarks.phantoms import blobs
from rle_splat.accuracy.rays import camera_rays
from rle_splat.pipeline.render import render_steps
from rle_splat.scene import SENSOR_FITS, Camera, Quality, RleSplatError
from rle_splat.view.turntable import turntable
from tests.truths.other_rays import turntable_rays

# No stray division: a warning here is a slice in the eye, or a ray that never meets its plane.
pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")


def rotation(random):
    q, r = np.linalg.qr(random.standard_normal((3, 3)))
    return q * np.sign(np.diag(r))


def placed(linear, middle_index, at):
    """The affine with this linear part that puts the voxel index ``middle_index`` at a world point."""
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    matrix[:3, 3] = at - linear @ middle_index
    return matrix


@pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
def test_turntable_sees_what_its_words_say(stage, perspective):
    """Rays of the camera that the turntable returns, in voxel indices, are the lines that the interface describes;
    a rotated affine changes nothing."""
    spacing, shape = (0.7, 1.1, 2.0), (20, 30, 10)
    turned = np.eye(4)
    turned[:3, :3] = rotation(np.random.default_rng(5))
    for affine in (np.diag((*spacing, 1.0)), turned @ np.diag((*spacing, 1.0))):
        volume = stage.volume(np.zeros(shape[::-1]), affine)
        for azimuth, elevation, fit, fov in ((0, 0, 1.25, 40), (35, 25, 1.0, 60), (-130, -80, 2.0, 15)):
            camera, matrix = turntable(volume, azimuth, elevation, fit, perspective, fov)
            scene = stage.before(volume, camera, (30, 20), volume_matrix=matrix)
            rays = camera_rays(camera, 30, 20)
            words, words_matrix = turntable_rays(shape, spacing, azimuth, elevation, fit, perspective, fov, 30, 20)
            to_words = words_matrix @ np.linalg.inv(scene.index_to_world)
            start = rays.origin @ to_words[:3, :3].T + to_words[:3, 3]
            step = rays.step @ to_words[:3, :3].T
            step /= np.linalg.norm(step, axis=1)[:, None]
            assert np.abs(step - words.direction).max() < 1e-10
            assert np.abs(np.cross(start - words.origin, words.direction)).max() < 1e-8


@pytest.mark.parametrize("seed", range(12))
def test_random_volume_matrix_and_camera(stage, seed):
    random = np.random.default_rng(seed)
    shape = tuple(int(n) for n in random.integers(14, 30, 3))
    linear = rotation(random) @ np.diag(((1.0, 1.0, 1.0), (1.0, 1.0, 3.0), (0.4, 1.0, 1.3))[seed % 3])
    linear = linear @ (np.eye(3) + np.triu(random.uniform(-0.5, 0.5, (3, 3)), 1))  # shear
    if seed % 2:
        linear[:, 0] *= -1.0
    middle, aim = 0.5 * (np.array(shape) - 1.0), random.uniform(-50.0, 50.0, 3)
    affine = placed(linear, middle, np.zeros(3))
    volume_matrix = placed(rotation(random) * 0.5, np.zeros(3), aim)
    corners = np.array(list(np.ndindex(2, 2, 2))) * (np.array(shape) + 1.0) - 1.0 - middle
    radius = 0.5 * np.linalg.norm(corners @ linear.T, axis=1).max()
    perspective, fit = seed % 4 != 3, SENSOR_FITS[seed % 3]
    eye = aim + rotation(random)[0] * radius * random.uniform(1.6, 4.0)
    distance = np.linalg.norm(eye - aim)
    size = ((72, 48), (44, 64), (56, 56))[seed % 3]
    camera = stage.looking(
        eye, aim + random.uniform(-0.1, 0.1, 3) * radius, up=random.standard_normal(3),
        type="PERSP" if perspective else "ORTHO", sensor_fit=fit, sensor_width=32.0, sensor_height=20.0,
        lens=13.0 * distance / radius, ortho_scale=1.6 * radius, clip_start=1e-3 * radius, clip_end=100.0 * radius,
        shift_x=random.uniform(-0.15, 0.15), shift_y=random.uniform(-0.15, 0.15),
        pixel_aspect=((1.0, 1.0), (1.0, 1.5), (2.0, 1.0))[(seed // 3) % 3],
    )  # fmt: skip
    scene = stage.before(stage.volume(blobs(shape, seed), affine), camera, size, volume_matrix=volume_matrix)
    true = stage.truth(scene)[0]
    assert true[..., 3].max() > 0.2
    # So dense that what is left is the depth rule: some of these volumes have several voxels to a pixel.
    found = stage.error(scene, true, sheet_density=6.0)
    assert found.rmse < 0.1 and found.largest < 1.5


@pytest.mark.parametrize("azimuth, elevation", ((0.0, 0.0), (40.0, 20.0)))
def test_wide_angle_corners_leave_the_45_degree_cone(stage, azimuth, elevation):
    """100 degrees across: corner rays lean more than 45 degrees, so more than one principal axis is needed."""
    field = blobs((24, 24, 24), 3, count=10, width=(2.0, 3.0))
    a, e = np.radians(azimuth), np.radians(elevation)
    ahead = np.array((-np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), -np.sin(e)))
    eye = 11.5 - ahead * (11.5 + 6.0) * np.abs(ahead).sum()
    camera = stage.looking(eye, (11.5,) * 3, lens=18.0 / np.tan(np.radians(50.0)), clip_start=0.01)
    scene = stage.before(stage.volume(field), camera, (72, 72))
    slopes = np.abs(camera_rays(camera, 72, 72).step)
    assert len(set(slopes.argmax(axis=1))) > 1  # the premise: rays of several principal axes
    found = stage.error(scene, sheet_density=3.0)
    assert found.rmse < 0.1 and found.largest < 1.5


@pytest.mark.parametrize("height", (7.0, 7.5, 7.31, 7.0 + 1e-9))
def test_eye_between_the_slices_beside_the_volume(stage, height):
    """130 degrees wide from among the planes of the slices, in one of them, or a hair beside it: some slices lie
    above the eye, some below, and both are seen."""
    field = blobs((20, 20, 16), 8, count=8, width=(2.0, 3.0))
    camera = stage.looking((-5.0, 9.5, height), (9.5, 9.5, 7.5), lens=18.0 / np.tan(np.radians(65.0)), clip_start=0.01)
    scene = stage.before(stage.volume(field), camera, (64, 64))
    found = stage.error(scene, sheet_density=3.0)
    assert found.rmse < 0.06 and found.largest < 1.5
    axes = {plane["principal_axis"] for plane in stage.render(scene).report["plan"]["base_planes"]}
    assert {"+x", "+z", "-z"} <= axes  # the premise


def test_scaled_camera_is_an_unscaled_camera(stage):
    camera = stage.looking((40.0, -25.0, 20.0), (9.5, 9.5, 9.5))
    matrix = np.array(camera.matrix_world)
    matrix[:3, :3] = matrix[:3, :3] * (3.0, 0.2, 7.0)
    volume = stage.volume(blobs((20, 20, 20), 1))
    pictures = [stage.render(stage.before(volume, c, (40, 40))).rgba for c in (camera, Camera(matrix))]
    assert np.abs(pictures[0] - pictures[1]).max() < 1e-6 and pictures[0].max() > 0.2


def test_nothing_ahead_is_refused_or_an_empty_picture(stage):
    volume = stage.volume(blobs((12, 12, 12), 1))
    away = stage.looking((40.0, 5.0, 5.0), (80.0, 5.0, 5.0))
    with pytest.raises(RleSplatError, match="does not see the volume"):
        stage.render(stage.before(volume, away, (16, 16)))
    steps = render_steps(stage.before(volume, away, (16, 16)), Quality(), refuse_empty_view=False)
    picture = None
    while picture is None:
        try:
            next(steps)
        except StopIteration as finished:
            picture = finished.value
    assert not picture.rgba.any() and (picture.depth == np.float32(1e10)).all()


@pytest.mark.parametrize("shape", ((1, 1, 1), (1, 9, 9), (9, 1, 9), (9, 9, 1), (2, 2, 2), (13, 1, 1)))
def test_thin_volumes(stage, shape):
    """One voxel along an axis is still a medium two voxels across, ramps and all; here a voxel is up to fifty pixels
    wide, so the depth rule's error on the kinked ramps is seen in full."""
    field = np.full(shape[::-1], 0.4)
    for perspective in (False, True):
        scene = stage.on_turntable(field, 35.0, 25.0, perspective, size=(64, 64))
        found = stage.error(scene, sheet_density=2.0)
        assert found.rmse < 1.6 and found.largest < 11.0


@pytest.mark.parametrize("eye", ((11.7, 9.2, 12.4), (11.5, 11.5, 11.5), (11.0, 11.0, 11.0), (8.0, 13.5, 10.0)))
def test_eye_inside_the_medium(stage, eye):
    """120 degrees wide from among, between and exactly at the voxels: the cell round the eye counts in part."""
    field = blobs((24, 24, 24), 3, count=10, width=(2.0, 3.0))
    camera = stage.looking(eye, (20.0, 17.0, 13.0), lens=18.0 / np.tan(np.radians(60.0)), clip_start=1e-4)
    found = stage.error(stage.before(stage.volume(field), camera, (64, 64)), sheet_density=3.0)
    assert found.rmse < 0.12 and found.largest < 1.2
