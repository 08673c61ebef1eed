"""Normals at a scale: kernels against numpy, and numpy against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from rle_splat.runtime.steps import drain
from rle_splat.shade.sample_light import ONE
from rle_splat.shade.surface_normals import LEAST, automatic_sigma, gaussian, noise_of_gradient, surface_steps
from rle_splat.volume.volume import Volume
from tests.ways import both


def lists(kept):
    """Row starts and columns of the voxels of a mask (nz, ny, nx)."""
    counts = kept.reshape(-1, kept.shape[2]).sum(axis=1)
    return np.concatenate(([0], np.cumsum(counts))), np.nonzero(kept)[2].astype(np.uint16)


def found(voxels, spacing=(1.0, 1.0, 1.0), sigma=1.0, kept=None, threads=1, **more):
    kept = np.ones(voxels.shape, bool) if kept is None else kept
    volume = Volume(voxels, np.diag((*spacing, 1.0)), **more)
    return drain(surface_steps(volume, *lists(kept), sigma, threads=threads)), kept


def ball(dtype=np.int16, side=24, edge=1.5, inside=1000.0):
    at = np.indices((side,) * 3) - 0.5 * (side - 1.0)
    radius = np.sqrt((at**2).sum(axis=0))
    values = inside / (1.0 + np.exp((radius - 0.3 * side) / edge))
    return values.astype(dtype), at[::-1] / np.maximum(radius, 1e-9), radius


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.uint16, np.float32, np.float64, np.int32])
@pytest.mark.parametrize("sigma, spacing", [(0.0, (1.0, 1.0, 1.0)), (1.0, (0.5, 0.7, 2.0))])
def test_kernels_are_as_numpy(dtype, sigma, spacing):
    rng = np.random.default_rng(3)
    voxels = (ball(np.float64, inside=200.0)[0] + rng.uniform(0.0, 5.0, (24, 24, 24)))[:, :19].astype(dtype)
    kept = rng.uniform(size=voxels.shape) < 0.3
    kept[5:9], kept[:, 4] = False, False
    ours, theirs = both(lambda: found(voxels, spacing, sigma, kept)[0])
    np.testing.assert_allclose(ours.vectors, theirs.vectors, atol=8.0)
    np.testing.assert_allclose(ours.steepness, theirs.steepness, rtol=2e-4, atol=1e-3)


def test_any_number_of_threads_and_planes_at_once_gives_the_same_bits(monkeypatch):
    voxels, _, _ = ball()
    one, _ = found(voxels, threads=1)
    monkeypatch.setattr("rle_splat.shade.surface_normals.SMOOTHED_AT_ONCE", 5 * 24 * 24)
    for threads in (1, 2, 4):
        other, _ = found(voxels, threads=threads)
        np.testing.assert_array_equal(one.vectors, other.vectors)
        np.testing.assert_array_equal(one.steepness, other.steepness)


def test_a_balls_normals_are_radial_and_long():
    voxels, radial, radius = ball()
    surfaces, _ = found(voxels)
    shell = np.abs(radius - 0.3 * 24) < 1.0
    m = surfaces.vectors.reshape(*voxels.shape, 3)[shell] / ONE
    away = np.moveaxis(radial, 0, -1)[shell]
    size = np.linalg.norm(m, axis=1)
    assert size.min() > 0.9
    assert np.degrees(np.arccos(np.clip(-(m * away).sum(axis=1) / size, -1.0, 1.0))).max() < 1.0


def test_a_ramps_steepness_is_its_slope_per_millimeter():
    voxels = np.broadcast_to(np.arange(20, dtype=np.int16)[:, None, None] * 30, (20, 12, 12)).copy()
    surfaces, _ = found(voxels, spacing=(0.5, 0.5, 2.0), sigma=2.0)
    inner = surfaces.steepness.reshape(voxels.shape)[4:-4, 3:-3, 3:-3]
    np.testing.assert_allclose(inner, 15.0, rtol=1e-4)


def test_the_middle_of_a_wall_has_next_to_no_normal_and_its_sides_point_apart():
    voxels = np.zeros((16, 16, 15), np.int16)
    voxels[:, :, 7] = 1000
    surfaces, _ = found(voxels, sigma=1.0)
    m = surfaces.vectors.reshape(*voxels.shape, 3)[8, 8, :, 0] / ONE
    assert abs(m[7] - LEAST) < 0.01 and m[6] > 0.5 and m[8] < -0.5


def test_noise_of_one_step_is_hardly_trusted():
    rng = np.random.default_rng(5)
    voxels = (100.0 + rng.uniform(-0.5, 0.5, (20, 20, 20))).round().astype(np.int16)
    surfaces, _ = found(voxels + rng.integers(0, 2, voxels.shape, dtype=np.int16), sigma=1.0)
    assert np.linalg.norm(surfaces.vectors, axis=1).max() < 0.2 * ONE


def test_a_constant_has_no_normals_even_beside_holes():
    voxels = np.full((9, 9, 9), 3.7, np.float32)
    voxels[4, 4, 4], voxels[0, 0, 0], voxels[8, :, 8] = np.nan, np.inf, -np.inf
    surfaces, _ = found(voxels, sigma=2.0)
    assert np.abs(surfaces.vectors).max() <= 1
    surfaces, _ = found(voxels, sigma=0.0)
    assert np.abs(surfaces.vectors).max() == 0


def test_a_hole_has_no_normal_itself():
    voxels = ball(np.float32)[0]
    voxels[8, 12, 12] = np.nan
    surfaces, _ = found(voxels)
    m = surfaces.vectors.reshape(*voxels.shape, 3)
    assert not m[8, 12, 12].any() and np.linalg.norm(m[8, 12, 13]) > 0.5 * ONE


@pytest.mark.parametrize("factor", [1e-30, 1e30])
def test_normals_do_not_depend_on_the_scale_of_values(factor):
    voxels, _, _ = ball(np.float32)
    one, _ = found(voxels)
    other, _ = found(voxels * np.float32(factor))
    np.testing.assert_allclose(one.vectors, other.vectors, atol=2.0)
    np.testing.assert_allclose(other.steepness, one.steepness * factor, rtol=1e-4)


@pytest.mark.parametrize("shape", [(1, 6, 6), (6, 1, 6), (6, 6, 1), (1, 1, 1), (2, 2, 2)])
def test_thin_volumes_have_finite_normals(shape):
    voxels = np.arange(np.prod(shape), dtype=np.int16).reshape(shape) * 9
    surfaces, _ = found(voxels, sigma=5.0)
    assert np.isfinite(surfaces.steepness).all()


def test_a_smoothing_wider_than_the_volume_is_taken():
    surfaces, _ = found(ball()[0], sigma=500.0)
    assert np.isfinite(surfaces.steepness).all()


def test_smoothing_by_itself_is_the_largest_distance_of_slices():
    assert automatic_sigma((0.5, 0.5, 1.25)) == 1.25 and automatic_sigma((0.5, 0.5, 5.0)) == 2.0
    assert len(gaussian(0.0, 1.0)) == 1 and len(gaussian(1.0, 1.0)) == 7


def test_noise_is_what_random_errors_give():
    rng = np.random.default_rng(1)
    taps = [gaussian(1.0, 1.0)] * 3
    expected = noise_of_gradient(taps, (1.0, 1.0, 1.0))
    smoothed = rng.uniform(-0.5, 0.5, (40, 40, 40))
    for axis in range(3):
        smoothed = np.apply_along_axis(np.convolve, axis, smoothed, taps[axis], "valid")
    lengths = sum(each**2 for each in np.gradient(smoothed))[1:-1, 1:-1, 1:-1]
    np.testing.assert_allclose(np.sqrt(lengths.mean()), expected, rtol=0.05)
