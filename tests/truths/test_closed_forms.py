"""Proves the renderer on bodies whose picture is known on paper: box, sphere, two slabs, one voxel.

Closed forms hold for the whole line of a ray, so they are compared where the ramps of the zero-padded box do not
reach: on rays through two opposite faces only.
"""

import numpy as np
import pytest

from benchmarks.phantoms import radius_from_center
from rle_splat.accuracy.rays import camera_rays
from tests.truths import closed_forms

PROJECTIONS = pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
LEVEL = 1.0 / 255.0


def opacity(extinction):
    return -np.expm1(-np.asarray(extinction, dtype=np.float64))


def rays_and_crossings(scene, low, high):
    """World rays of all pixels, the index matrix, and where each ray meets the planes z = low and z = high."""
    rays = camera_rays(scene.camera, scene.width, scene.height)
    inverse = np.linalg.inv(scene.index_to_world)
    start, step = rays.origin @ inverse[:3, :3].T + inverse[:3, 3], rays.step @ inverse[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        meets = [start + step * ((z - start[:, 2:]) / step[:, 2:]) for z in (low, high)]
    return rays, meets


def through_z_faces(scene, margin=0.0):
    """Rays inside the voxel centers' x and y range all the way from z = -1 to z = nz."""
    nx, ny, nz = scene.volume.shape_xyz
    rays, meets = rays_and_crossings(scene, -1.0, nz)
    low, high = margin, np.array((nx, ny)) - 1.0 - margin
    return rays, np.all([((m[:, :2] >= low) & (m[:, :2] <= high)).all(axis=1) for m in meets], axis=0)


def thickness(rays, scene, low, high):
    """World length of each ray between two z planes of the index space."""
    flat = 1e9
    return closed_forms.box_length(rays, scene.index_to_world, (-flat, -flat, low), (flat, flat, high))


@PROJECTIONS
@pytest.mark.parametrize("elevation", (90.0, -65.0))
@pytest.mark.parametrize("depth_rule", ("slice", "simpson"))
def test_homogeneous_box(stage, perspective, elevation, depth_rule):
    sigma = 0.17
    field = np.full((7, 36, 36), opacity(sigma))
    scene = stage.on_turntable(field, 20.0, elevation, perspective, size=(64, 64), spacing=(1.0, 1.0, 1.5))
    rays, compared = through_z_faces(scene, margin=2.0)
    tau = sigma * thickness(rays, scene, -0.5, 6.5)  # the two ramps hold half a slice each
    color = stage.color(opacity(sigma))
    picture = stage.render(scene, depth_rule=depth_rule, termination=0.0).rgba.reshape(-1, 4)
    assert compared.sum() > 300
    error = np.abs(picture - closed_forms.composed(tau, color))[compared]
    assert error.max() < 0.05 * LEVEL


@PROJECTIONS
def test_sphere(stage, perspective):
    """Coverage sampled on the grid, so the rim, where a voxel's width matters, is left out."""
    sigma, radius, size = 0.12, 16.0, 40
    coverage = np.clip(radius - radius_from_center(size) + 0.5, 0.0, 1.0)
    scene = stage.on_turntable(opacity(sigma * coverage), 35.0, 25.0, perspective, size=(80, 80))
    rays = camera_rays(scene.camera, 80, 80)
    center = scene.index_to_world @ (19.5, 19.5, 19.5, 1.0)
    tau = sigma * closed_forms.sphere_length(rays, center[:3], radius)
    central = closed_forms.distance_to_axis(rays, center[:3]) < radius - 3.0
    outside = closed_forms.distance_to_axis(rays, center[:3]) > radius + 2.5
    alpha = stage.render(scene).rgba[..., 3].ravel()
    assert central.sum() > 800 and outside.sum() > 800
    assert np.abs(alpha + np.expm1(-tau))[central].max() < 2.0 * LEVEL
    assert abs((alpha + np.expm1(-tau))[central].mean()) < 0.2 * LEVEL
    assert np.abs(alpha[outside]).max() < 0.01 * LEVEL  # what the cubic filter leaves, 1e-5 measured


@PROJECTIONS
@pytest.mark.parametrize("elevation", (90.0, -90.0, 70.0, -70.0))
def test_two_slabs(stage, perspective, elevation):
    """Two colors one behind the other; the opposite view swaps them."""
    field = np.zeros((14, 40, 40))
    field[2:5], field[8:12] = opacity(0.2), opacity(0.5)
    scene = stage.on_turntable(field, 10.0, elevation, perspective, size=(64, 64))
    rays, compared = through_z_faces(scene, margin=2.0)
    bodies = [
        closed_forms.composed(sigma * thickness(rays, scene, low, high), stage.color(opacity(sigma)))
        for sigma, low, high in ((0.2, 1.5, 4.5), (0.5, 7.5, 11.5))
    ]
    if elevation > 0.0:  # the camera looks down: the upper slab is met first
        bodies.reverse()
    picture = stage.render(scene, termination=0.0).rgba.reshape(-1, 4)
    assert compared.sum() > 300
    assert np.abs(picture - closed_forms.over(*bodies))[compared].max() < 0.05 * LEVEL


@pytest.mark.parametrize("elevation", (90.0, 0.0))
def test_single_voxel_along_an_axis(stage, elevation):
    """The footprint itself: optical depth is a tent times a tent, at every sub-pixel offset of the image."""
    field = np.zeros((9, 9, 9))
    field[4, 5, 3] = opacity(1.1)
    scene = stage.on_turntable(field, 0.0, elevation, False, size=(97, 97))
    world = camera_rays(scene.camera, 97, 97).origin @ np.linalg.inv(scene.index_to_world)[:3, :3].T
    offset = world + np.linalg.inv(scene.index_to_world)[:3, 3] - (3.0, 5.0, 4.0)
    v = offset[:, 1] if elevation else offset[:, 2]
    tau = closed_forms.impulse_tau(offset[:, 0], v, 1.1, 1.0)
    alpha = stage.render(scene, sheet_density=3.0, termination=0.0).rgba[..., 3].ravel()
    assert np.abs(alpha + np.expm1(-tau)).max() < 3.0 * LEVEL  # the tent's kinks, resampled by the warp
    assert abs((alpha + np.expm1(-tau)).mean()) < 0.01 * LEVEL


@PROJECTIONS
@pytest.mark.parametrize("azimuth, elevation", ((35.0, 25.0), (-70.0, 55.0)))
def test_single_voxel_obliquely(stage, perspective, azimuth, elevation):
    """G8 from anywhere: the integral of three tents along each pixel's own ray."""
    field = np.zeros((7, 7, 7))
    field[3, 4, 2] = opacity(1.1)
    scene = stage.on_turntable(field, azimuth, elevation, perspective, size=(64, 64), fit=0.8, spacing=(1.0, 1.2, 0.9))
    tau = closed_forms.voxel_tau(camera_rays(scene.camera, 64, 64), scene.index_to_world, (2.0, 4.0, 3.0), 1.1)
    alpha = stage.render(scene, depth_rule="midpoint-16", sheet_density=4.0, termination=0.0).rgba[..., 3].ravel()
    assert tau.max() > 0.9 and (tau > 0.0).sum() > 300
    assert np.abs(alpha + np.expm1(-tau)).max() < 0.2 * LEVEL  # the tents' kinks, resampled by the warp
    assert abs((alpha + np.expm1(-tau)).mean()) < 0.01 * LEVEL
