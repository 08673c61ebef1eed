"""Mesh depth per ray, against plain ray-triangle intersection (Moeller and Trumbore)."""

from functools import partial

import numpy as np
import pytest

from rle_splat.accuracy.rays import camera_rays
from rle_splat.effects import depth_layers, mesh_occlusion
from rle_splat.effects.depth_layers import HALO, REACH, depth_layers_steps
from rle_splat.effects.mesh_depth import SAMPLE_COLUMNS, SAMPLE_ROWS, mesh_depth
from rle_splat.runtime.steps import drain
from rle_splat.scene import Camera
from rle_splat.view.base_plane import base_plane
from rle_splat.view.eye import index_view
from rle_splat.view.principal_axis import candidate_pyramids
from rle_splat.view.ray_intervals import ray_intervals
from tests.ways import both


def layers_of(*arguments, **named):
    return drain(depth_layers_steps(*arguments, **named))


def intersect(origins, directions, triangles, ahead):
    """Planar depth along ``ahead`` of the first triangle on each ray; inf for none."""
    best = np.full(len(origins), np.inf)
    for a, b, c in triangles:
        p = np.cross(directions, c - a)
        determinant = p @ (b - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = origins - a
            u = (s * p).sum(axis=1) / determinant
            q = np.cross(s, b - a)
            v = (directions * q).sum(axis=1) / determinant
            t = q @ (c - a) / determinant
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        best = np.where(hit, np.minimum(best, t * (directions @ ahead)), best)
    return best


def camera(kind):
    placed = np.eye(4)
    placed[:3, 3] = (0.3, -0.2, 5.0)
    return Camera(placed, kind, ortho_scale=4.0, lens=30.0, shift_x=0.1, clip_start=0.1, clip_end=50.0)


TRIANGLES = np.array([
    [(-1.5, -1, 0), (1.5, -1, 0.5), (0, 1.4, -1)],
    [(-1, -1, 1.0), (0.2, 0.1, 2.0), (-0.5, 1.0, 1.5)],
    [(-2, 0, 8.0), (2, 0.3, 8.0), (0, -0.4, 1.0)],  # reaches behind the perspective camera
])  # fmt: skip


def has_silhouettes(layers) -> bool:
    """Whether any pixel has two depths."""
    return bool((layers.near != layers.far).any())


@pytest.mark.parametrize("kind", ["ORTHO", "PERSP"])
def test_depth_is_the_ray_intersection(kind, way):
    width, height = 24, 18
    eye = camera(kind)
    depth = mesh_depth(TRIANGLES, eye, width, height)
    s = 6
    column, row = np.meshgrid(np.arange(width) + SAMPLE_COLUMNS[s], np.arange(height) + SAMPLE_ROWS[s])
    rays = camera_rays(eye, width, height, column, row)
    expected = intersect(rays.origin, rays.direction, TRIANGLES, np.array((0, 0, -1.0)))
    expected = np.where(expected < eye.clip_start, np.inf, expected).reshape(height, width)
    if kind == "ORTHO":  # the triangle behind the camera plane is clipped
        expected = np.where(expected <= 0, np.inf, expected)
    both = np.isfinite(expected) & np.isfinite(depth[..., s])
    assert (np.isfinite(expected) == np.isfinite(depth[..., s])).mean() > 0.995, "samples on an edge may differ"
    assert both.sum() > 30
    np.testing.assert_allclose(depth[..., s][both], expected[both], rtol=2e-6)


def test_kernels_agree_with_their_references():
    for kind in ("ORTHO", "PERSP"):
        one, two = both(partial(mesh_depth, TRIANGLES, camera(kind), 20, 31))
        np.testing.assert_array_equal(np.isfinite(one), np.isfinite(two))
        np.testing.assert_allclose(one[np.isfinite(one)], two[np.isfinite(two)], rtol=1e-6)


def test_neighboring_triangles_leave_no_crack():
    rng = np.random.default_rng(4)
    corners = np.array([(-2, -2, 0), (2, -2, 0.1), (2, 2, 0), (-2, 2, -0.1)], float)
    middle = np.array((*rng.uniform(-0.5, 0.5, 2), 0.05))
    fan = np.array([[corners[i], corners[(i + 1) % 4], middle] for i in range(4)])
    placed = np.eye(4)
    placed[:3, 3] = (0, 0, 5)
    eye = Camera(matrix_world=placed, type="ORTHO", ortho_scale=2.0)
    assert np.isfinite(mesh_depth(fan, eye, 64, 64)).all()


def test_silhouette_pixels_hold_both_depths_and_the_covered_part():
    samples = np.full((9, 9, 16), 7.0)
    samples[:, :4] = 3.0
    samples[:, 4, :5] = 3.0  # the silhouette: 5 of 16 samples on the near surface
    layers = layers_of(samples, 0.5)
    assert has_silhouettes(layers)
    np.testing.assert_allclose(layers.near[:, 4], 3.0)
    np.testing.assert_allclose(layers.far[:, 4], 7.0)
    np.testing.assert_allclose(layers.coverage[:, 4], 5 / 16)
    # Carried past the silhouette, without weight there.
    np.testing.assert_allclose(layers.near[:, 4 : 4 + REACH + 1], 3.0)
    np.testing.assert_allclose(layers.coverage[:, 5:9], 0.0)
    np.testing.assert_allclose(layers.far[:, :4], 7.0)
    np.testing.assert_allclose(layers.coverage[:, :4], 1.0)


def test_a_slanted_surface_is_one_surface():
    slope = np.linspace(2.0, 2.3, 16)
    layers = layers_of(np.broadcast_to(slope, (5, 5, 16)), 0.5)
    assert not has_silhouettes(layers)
    np.testing.assert_allclose(layers.near, slope.mean(), rtol=1e-6)


@pytest.mark.parametrize("slope", [0.3, 0.6])
def test_each_pixel_of_a_slanted_line_keeps_its_own_depth(slope, way):
    """One ray a pixel, as of a viewport's depth; neighbors along the line are less or more than a step apart."""
    samples = np.full((9, 40, 1), np.inf, np.float32)
    columns = np.arange(40)
    samples[columns // 5, columns, 0] = 10.0 + slope * columns
    layers = layers_of(samples, 0.5)
    shown = np.where(layers.coverage > 0.5, layers.near, layers.far)
    np.testing.assert_array_equal(shown, samples[..., 0])


def test_no_mesh_at_all():
    layers = layers_of(np.full((4, 4, 16), np.inf), 0.5)
    assert not has_silhouettes(layers) and np.isinf(layers.near).all() and (layers.coverage == 1).all()


def test_bands_of_rows_give_the_layers_of_the_whole(monkeypatch, way):
    samples = torn_surfaces(np.random.default_rng(8), 90, 30)
    whole = layers_of(samples, 0.3)
    monkeypatch.setattr(depth_layers, "PIXELS_A_STEP", 1)
    assert len(list(depth_layers_steps(samples, 0.3))) == -(-90 // (4 * HALO)) > 1
    banded = layers_of(samples, 0.3)
    for name in ("near", "far", "coverage"):
        np.testing.assert_array_equal(getattr(banded, name), getattr(whole, name))


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_a_part_of_the_picture_has_the_depths_and_the_layers_of_the_whole(kind, way):
    left, top, right, bottom = region = (9, 5, 47, 39)
    whole = mesh_depth(TRIANGLES, camera(kind), 60, 44)
    part = mesh_depth(TRIANGLES, camera(kind), 60, 44, region=region)
    np.testing.assert_array_equal(part, whole[top:bottom, left:right])
    one, two = layers_of(whole, 0.1), layers_of(part, 0.1, first_pixel=(left, top))
    assert has_silhouettes(one) and has_silhouettes(two)
    inner = (left + HALO, top + HALO, right - HALO, bottom - HALO)
    np.testing.assert_array_equal(two.coverage_of(inner), one.coverage_of(inner))
    inside = np.s_[inner[1] : inner[3], inner[0] : inner[2]]
    for name in ("near", "far"):
        np.testing.assert_array_equal(getattr(two, name)[HALO:-HALO, HALO:-HALO], getattr(one, name)[inside])


def test_a_silhouette_along_the_side_of_the_picture_ends_the_rays_beside_it():
    """Mesh in the first column of pixels only: the sheet's pixels out there end at it, those farther in nowhere."""
    view = index_view(camera("ORTHO"), np.eye(4), 40, 40)
    plane = base_plane(view, (6, 6, 4), 2, -1, "slice", 1.0)
    layer = np.full((40, 40), np.inf)
    layer[:, 0] = 2.5
    end = ray_intervals(plane, 0.1, 50.0, layer)[1]
    x, y = plane.points
    at_zero, per_voxel = plane.depth_along(x[None, :], y[:, None])
    depth = at_zero + end * plane.sign * per_voxel
    column = (plane.homography[0, 0] * x + plane.homography[0, 1] * y[0] + plane.homography[0, 2]) - 0.5
    assert (column < 0.4).any() and (column > 0.6).any()
    np.testing.assert_allclose(depth[:, column < 0.4], 2.5, rtol=1e-5)
    np.testing.assert_allclose(depth[:, column > 0.6], 50.0, rtol=1e-5)


def torn_surfaces(rng, rows, columns):
    """(rows, columns, 16) sample depths: patches of rough surfaces and holes, over each other, and stray samples."""
    samples = np.full((rows, columns, 16), np.inf, np.float32)
    for _ in range(8):
        row, column = rng.integers(0, rows), rng.integers(0, columns)
        part = samples[row : row + 9, column : column + 9]
        part[...] = rng.choice([2.0, 3.0, 3.2, 5.0, np.inf]) + rng.normal(0.0, 0.02, part.shape)
    stray = rng.random(samples.shape) < 0.002
    samples[stray] = rng.choice([1.0, 9.0, np.inf])
    return samples


def test_references_find_the_same_layers():
    rng = np.random.default_rng(11)
    silhouettes = 0
    for _ in range(40):
        samples = torn_surfaces(rng, *rng.integers(1, 40, 2))
        one, two = both(partial(layers_of, samples, 0.3))
        silhouettes += has_silhouettes(one)
        for name in ("near", "far", "coverage"):
            np.testing.assert_allclose(getattr(one, name), getattr(two, name), rtol=1e-6, err_msg=name)
    assert silhouettes > 30


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("with_layer", [False, True])
def test_references_end_rays_at_the_same_places_for_any_number_of_threads(kind, with_layer):
    view = index_view(camera(kind), np.eye(4), 44, 40)
    layer = None
    if with_layer:
        layer = layers_of(torn_surfaces(np.random.default_rng(3), 40, 44), 0.3).near
    for axis, sign in candidate_pyramids(view):
        plane = base_plane(view, (6, 7, 4), axis, sign, "slice", 1.5)
        if plane is None:
            continue
        one, two = both(partial(ray_intervals, plane, 0.1, 50.0, layer, threads=1))
        again = ray_intervals(plane, 0.1, 50.0, layer, threads=2)
        np.testing.assert_array_equal(one, again)
        np.testing.assert_allclose(one, two, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("near", [0, 1, 63, 199, None])
def test_one_near_triangle_of_many_is_found_wherever_it_is_listed(near):
    triangles = np.full((200, 3, 3), 9.0)
    if near is not None:
        triangles[near, 1, 2] = 2.0
    along_z = np.array([0.0, 0.0, 1.0, 0.5])
    assert mesh_occlusion._any_before(triangles, along_z, 3.0) == (near is not None)
    assert not mesh_occlusion._any_before(triangles, along_z, 2.25)
    assert not mesh_occlusion._any_before(None, along_z, 9.0)
