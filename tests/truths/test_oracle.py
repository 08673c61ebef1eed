"""Proves the truth before pictures are held against it: the ray integrator against closed forms and brute force, its
camera against the words of the interface, its transfer function against values worked out by hand."""

import numpy as np
import pytest

from benchmarks.phantoms import FIELDS, radius_from_center
from rle_splat.accuracy.integrate import integrate
from rle_splat.accuracy.medium import ClassifiedField, ScalarField
from rle_splat.accuracy.metrics import difference
from rle_splat.accuracy.probes import draw_pixels, steep_pixels
from rle_splat.accuracy.rays import WorldRays, camera_rays
from rle_splat.accuracy.transfer import TAU_CAP, extinction_and_color, piecewise_linear
from rle_splat.scene import Camera
from tests.truths import closed_forms
from tests.truths.other_rays import turntable_rays

VIEWS = ((0.0, 0.0, False), (35.0, 25.0, False), (-110.0, -40.0, True), (35.0, 25.0, True))


class Points:
    """Transfer-function points without the renderer's own class."""

    def __init__(self, opacity, color=((0.0, 1.0, 0.5, 0.25),)):
        self.opacity, self.color = opacity, color


def view(shape_xyz, azimuth, elevation, perspective, spacing=(1.0, 1.0, 1.0), pixels=24):
    return turntable_rays(shape_xyz, spacing, azimuth, elevation, 1.25, perspective, 40.0, pixels, pixels)


def index_lines(rays, index_to_world):
    inverse = np.linalg.inv(index_to_world)
    return rays.origin @ inverse[:3, :3].T + inverse[:3, 3], rays.step @ inverse[:3, :3].T


@pytest.mark.parametrize("azimuth, elevation, perspective", VIEWS)
def test_homogeneous_box_where_rays_cross_the_two_z_faces(azimuth, elevation, perspective):
    """Between the ramps a ray that meets only the z faces crosses exactly nz slices' worth of the medium."""
    azimuth, elevation = azimuth, 90.0 - abs(elevation)
    nz, spacing, sigma = 6, (0.5, 0.7, 1.3), 0.31
    medium = ClassifiedField(np.full((nz, 40, 40), sigma), np.full((nz, 40, 40, 3), (0.2, 0.5, 1.0)))
    rays, index_to_world = view((40, 40, nz), azimuth, elevation, perspective, spacing)
    start, step = index_lines(rays, index_to_world)
    ends = [start + step * ((z - start[:, 2:]) / step[:, 2:]) for z in (-1.0, nz)]
    inside = np.all([(e[:, :2] >= 0).all(1) & (e[:, :2] <= 39).all(1) for e in ends], axis=0)
    assert inside.sum() > 30
    length = closed_forms.box_length(rays, index_to_world, (-1e9, -1e9, -0.5), (1e9, 1e9, nz - 0.5))
    expected = closed_forms.composed(sigma * length, (0.2, 0.5, 1.0))
    rgba, _ = integrate(medium, rays, index_to_world)
    assert np.abs(rgba - expected)[inside].max() < 1e-10


@pytest.mark.parametrize("azimuth, elevation, perspective", VIEWS)
def test_color_never_depends_on_order_when_it_is_constant(azimuth, elevation, perspective):
    field = np.random.default_rng(1).random((9, 11, 13)) * 2.0
    medium = ClassifiedField(field, np.full((9, 11, 13, 3), (0.2, 0.5, 1.0)))
    rgba, _ = integrate(medium, *view((13, 11, 9), azimuth, elevation, perspective))
    assert np.abs(rgba[:, :3] - rgba[:, 3:] * (0.2, 0.5, 1.0)).max() < 1e-9
    assert rgba[:, 3].max() > 0.9


@pytest.mark.parametrize("azimuth, elevation, perspective", VIEWS)
def test_gaussian_blob_converges_at_second_order(azimuth, elevation, perspective):
    """G3: the optical depth of interpolated samples tends to the blob's own as the grid is refined."""
    errors = []
    for size in (17, 33):
        h = 16.0 / (size - 1)
        field = 0.4 * np.exp(-0.5 * (radius_from_center(size) * h / 2.0) ** 2)
        rays, _ = view((16,) * 3, azimuth, elevation, perspective, pixels=29)
        index_to_world = np.diag((h, h, h, 1.0))
        index_to_world[:3, 3] = -0.5
        rgba, _ = integrate(ClassifiedField(field, np.ones((size,) * 3 + (3,))), rays, index_to_world)
        tau = closed_forms.gaussian_tau(rays, (7.5, 7.5, 7.5), 0.4, 2.0)
        errors.append(np.sqrt(np.mean((-np.log1p(-rgba[:, 3]) - tau) ** 2)))
    assert 3.2 < errors[0] / errors[1] < 4.8
    assert errors[1] < 0.01


@pytest.mark.parametrize("elevation", (90.0, -90.0))
def test_two_slabs_and_their_order(elevation):
    """G7, seen from both sides, and the depth of half transmittance inside the first or the second slab."""
    field, color = np.zeros((14, 20, 20)), np.zeros((14, 20, 20, 3))
    field[2:5], color[2:5] = 0.15, (1.0, 0.1, 0.0)
    field[8:12], color[8:12] = 0.4, (0.0, 0.2, 1.0)
    low, high = closed_forms.composed([0.45], (1.0, 0.1, 0.0)), closed_forms.composed([1.6], (0.0, 0.2, 1.0))
    rays, index_to_world = view((20, 20, 14), 0.0, elevation, False, pixels=8)
    rgba, depth = integrate(ClassifiedField(field, color), rays, index_to_world)
    from_above = elevation > 0.0  # the camera stands above and looks down: high slices come first
    expected = closed_forms.over(high, low) if from_above else closed_forms.over(low, high)
    central = np.abs(index_lines(rays, index_to_world)[0][:, :2] - 9.5).max(axis=1) < 9.0
    assert np.abs(rgba[central] - expected).max() < 1e-10
    # Half transmittance, counted from the middle z = 6.5: the ramp of a slab holds half a voxel's optical depth.
    half = np.log(2.0)
    where = 11.5 - half / 0.4 if from_above else 7.5 + (half - 0.45) / 0.4
    assert np.allclose(depth[central], abs(where - 6.5) * (-1.0 if from_above else 1.0), atol=1e-9)


def test_linear_source_in_constant_extinction():
    """G5 inside the box, with near and far limits keeping the ramps out of it."""
    n = 12
    color = np.broadcast_to((0.1 + 0.05 * np.arange(n))[:, None, None, None], (n, 9, 9, 3))
    rays = WorldRays(np.array([[4.3, 4.1, -3.0]]), np.array([[0.0, 0.0, 1.0]]), np.ones(1))
    rgba, _ = integrate(ClassifiedField(np.full((n, 9, 9), 0.35), color), rays, np.eye(4), near=3.0, far=3.0 + n - 1.0)
    assert abs(rgba[0, 0] - closed_forms.linear_source(0.35, n - 1.0, 0.1, 0.05)) < 1e-12
    assert abs(rgba[0, 3] + np.expm1(-0.35 * (n - 1.0))) < 1e-12


@pytest.mark.parametrize("name", FIELDS)
def test_against_brute_force(name):
    """Fine stepping of each field, colors varying, with a far limit on half of the rays."""
    size, steps = 16, 20000
    field = -np.log1p(-FIELDS[name](size).astype(np.float64)) * 2.0
    color = np.random.default_rng(2).random((size,) * 3 + (3,))
    medium = ClassifiedField(field, color)
    rays, index_to_world = view((size,) * 3, 35.0, 25.0, True, pixels=5)
    far = np.where(np.arange(25) % 2, np.inf, 22.3)
    rgba, depth = integrate(medium, rays, index_to_world, far=far)
    padded = np.pad(np.concatenate((color * field[..., None], field[..., None]), -1), ((1, 1),) * 3 + ((0, 0),))
    for ray in range(25):
        h = min(far[ray], 60.0) / steps
        at = (np.arange(steps) + 0.5) * h
        p = np.clip((rays.origin[ray] + rays.step[ray] * at[:, None])[:, ::-1] + 1.0, 0.0, size + 1.0)
        cell = np.minimum(p.astype(int), size)
        values = 0.0
        for corner in np.ndindex(2, 2, 2):
            weight = np.prod(np.where(corner, p - cell, 1.0 - p + cell), axis=1)
            values = values + weight[:, None] * padded[tuple((cell + corner).T)]
        values = values * h * rays.length_per_depth[ray]
        tau = np.cumsum(values[:, 3])
        seen = np.exp(values[:, 3] / 2 - tau)
        assert np.abs(rgba[ray, :3] - (values[:, :3] * seen[:, None]).sum(0)).max() < 2e-6
        assert abs(rgba[ray, 3] + np.expm1(-tau[-1])) < 2e-6
        half = np.searchsorted(tau, np.log(2.0))
        assert depth[ray] == 1e10 if half == steps else abs(depth[ray] - at[half]) < 2.0 * h


def test_post_classified_truth_of_a_ramp():
    """T2: along a linear scalar the medium is the transfer function itself; a step has its exact width."""
    values = np.broadcast_to(np.arange(9.0), (3, 3, 9))
    points = Points(((2.25, 0.0), (2.25, 0.3), (4.5, 0.3), (4.5, 0.0)))
    rays = WorldRays(np.array([[-5.0, 1.2, 1.3]]), np.array([[1.0, 0.0, 0.0]]), np.ones(1))
    rgba, _ = integrate(ScalarField(values, points, 1.0), rays, np.eye(4))
    assert abs(rgba[0, 3] - (1.0 - 0.7**2.25)) < 1e-9
    assert np.abs(rgba[0, :3] - rgba[0, 3] * np.array((1.0, 0.5, 0.25))).max() < 1e-9


def test_transfer_points_by_hand():
    points = ((0.0, 0.0), (10.0, 0.5), (10.0, 0.8), (20.0, 1.0))
    assert np.allclose(piecewise_linear(points, [-5.0, 5.0, 10.0, 9.999999, 15.0, 99.0]), [0, 0.25, 0.8, 0.5, 0.9, 1.0])
    assert np.allclose(piecewise_linear(((3.0, 0.1, 0.2, 0.3),), [[-1.0, 9.0]]), (0.1, 0.2, 0.3))
    sigma, color = extinction_and_color(Points(points), np.array([5.0, 20.0, np.nan]), 2.0)
    assert np.allclose(sigma, [-np.log(0.75) / 2.0, TAU_CAP / 2.0, 0.0])
    assert np.isfinite(color).all()


def test_turntable_words_and_camera_fields_give_the_same_rays():
    """A Blender camera placed by hand where the turntable's words put the eye."""
    a, e = np.deg2rad(35.0), np.deg2rad(25.0)
    right = np.array((np.cos(a), np.sin(a), 0.0))
    up = np.array((-np.sin(a) * np.sin(e), np.cos(a) * np.sin(e), np.cos(e)))
    forward = np.array((-np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), -np.sin(e)))
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack((right, up, -forward), axis=1) * (2.0, 0.5, 3.0)  # scale must be ignored
    aim, high = np.array((9.5, 14.5, 4.5)), 1.25 * 30.0
    distance = 0.5 * high / np.tan(np.deg2rad(20.0))
    matrix[:3, 3] = aim - distance * forward
    lens = 18.0 / np.tan(np.deg2rad(20.0))
    for camera in (
        Camera(matrix, "PERSP", lens=lens, sensor_height=36.0, sensor_fit="VERTICAL"),
        Camera(matrix, "PERSP", lens=lens, sensor_width=36.0 * 1.5),
        Camera(matrix, "ORTHO", ortho_scale=high * 1.5),
        Camera(matrix, "ORTHO", ortho_scale=high, sensor_fit="VERTICAL"),
    ):
        perspective = camera.type == "PERSP"
        words, _ = turntable_rays((20, 30, 10), (1, 1, 1), 35.0, 25.0, 1.25, perspective, 40.0, 30, 20)
        rays = camera_rays(camera, 30, 20)
        assert np.abs(rays.direction - words.direction).max() < 1e-12
        between = np.cross(rays.origin - words.origin, words.direction)
        assert np.abs(between).max() < 1e-10


def test_camera_shift_and_pixel_aspect_by_hand():
    """Numbers worked out from Blender's rules for one pixel each."""
    rays = camera_rays(Camera(shift_x=0.25, shift_y=-0.1), 100, 50, [50.0], [25.0])
    assert np.allclose(rays.step[0], (0.25 * 36 / 50, -0.1 * 36 / 50, -1.0))
    rays = camera_rays(Camera(pixel_aspect=(1.0, 2.0)), 100, 80, [50.0], [0.0])  # 100 x 160 pixel widths: tall
    assert np.allclose(rays.step[0], (0.0, 0.5 * 36 / 50, -1.0))
    rays = camera_rays(Camera(sensor_fit="VERTICAL", pixel_aspect=(2.0, 1.0)), 100, 80, [0.0], [40.0])
    assert np.allclose(rays.step[0], (-0.5 * 24 / 50 * 200 / 80, 0.0, -1.0))
    rays = camera_rays(Camera(type="ORTHO", ortho_scale=8.0, shift_y=0.5), 10, 40, [10.0], [20.0])
    assert np.allclose(rays.origin[0], (1.0, 4.0, 0.0)) and np.allclose(rays.step[0], (0.0, 0.0, -1.0))


def test_metrics_and_probes():
    reference = np.zeros((10, 20, 4))
    image = reference.copy()
    image[3, 4, 1] = 2.0 / 255.0
    found = difference(image, reference)
    assert np.isclose(found.largest, 2.0) and np.isclose(found.rmse, 2.0 / np.sqrt(800.0)) and found.count == 800
    assert np.isclose(found.bias, 2.0 / 800.0) and difference(image, image).psnr == np.inf
    columns, rows = draw_pixels(640, 480, 1000)
    assert 900 <= len(columns) <= 1000 and columns.max() < 640 and rows.max() < 480
    assert len(set(zip(columns.tolist(), rows.tolist()))) == len(columns)
    assert (3, 4) in set(zip(*(a.tolist() for a in steep_pixels(image, 5)[::-1])))
