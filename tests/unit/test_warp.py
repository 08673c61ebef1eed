"""The warp's filters: interpolation, reproduction, clamping."""

import numpy as np
import pytest

from rle_splat.warp.resample import resample
from rle_splat.warp.resample_numpy import resample_numpy
from rle_splat.warp.spline_prefilter import spline_coefficients, spline_coefficients_numpy

PREFILTERS = [spline_coefficients, spline_coefficients_numpy]
RESAMPLERS = [resample, resample_numpy]


def b_spline_at_nodes(coefficients):
    """The spline at its own nodes, from its definition: weights 1/6, 4/6, 1/6 along each axis, mirrored."""
    for axis in (0, 1):
        along = np.moveaxis(coefficients, axis, 0)
        padded = np.pad(along, [(1, 1), (0, 0), (0, 0)], mode="reflect")
        coefficients = np.moveaxis((padded[:-2] + 4 * padded[1:-1] + padded[2:]) / 6, 0, axis)
    return coefficients


@pytest.mark.parametrize("prefilter", PREFILTERS)
@pytest.mark.parametrize("shape", [(2, 2), (3, 17), (40, 31), (5, 2)])
def test_the_cubic_interpolates(prefilter, shape):
    image = np.random.default_rng(3).random((*shape, 4)).astype(np.float32)
    coefficients = image.copy()
    prefilter(coefficients)
    np.testing.assert_allclose(b_spline_at_nodes(coefficients.astype(np.float64)), image, atol=2e-6)


def run(function, pixels, to_sheet, cubic, size, half=None, most=1.0):
    rgba = np.zeros((*size, 4), np.float32)
    depth = np.full(size, 1e10, np.float32)
    half = np.full(pixels.shape[:2], np.inf, np.float32) if half is None else half
    depth_map = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 0.5]])
    function(
        np.ascontiguousarray(pixels), half, to_sheet, np.zeros((3, 3)), 2, 1, cubic, np.float32(most), depth_map, rgba,
        depth,
    )
    return rgba, depth


SHIFT = np.array([[0.7, 0.1, 4.3], [-0.1, 0.8, 5.6], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("function", RESAMPLERS)
@pytest.mark.parametrize("cubic", [False, True])
def test_a_ramp_is_reproduced(function, cubic):
    v, u = np.mgrid[0:40, 0:50].astype(np.float64)
    ramp = 0.2 + 0.005 * u + 0.004 * v
    pixels = np.stack((ramp * 0.5, ramp * 0.25, ramp, ramp), axis=-1).astype(np.float32)
    rgba, _ = run(function, pixels, SHIFT, cubic, (20, 30))  # a ramp is its own spline coefficients
    row, column = np.mgrid[0:20, 0:30] + 0.5
    expected = 0.2 + 0.005 * (0.7 * column + 0.1 * row + 4.3) + 0.004 * (-0.1 * column + 0.8 * row + 5.6)
    np.testing.assert_allclose(rgba[..., 3], expected, atol=1e-6)
    np.testing.assert_allclose(rgba[..., 0], 0.5 * expected, atol=1e-6)


@pytest.mark.parametrize("function", RESAMPLERS)
def test_overshoot_is_clamped_to_the_premultiplied_range(function):
    pixels = np.zeros((30, 30, 4), np.float32)
    pixels[:, 15:] = (0.8, 0.8, 0.8, 1.0)
    spline_coefficients_numpy(pixels)
    rgba, _ = run(function, pixels, np.array([[0.3, 0, 10.0], [0, 0.3, 5.0], [0, 0, 1]]), True, (30, 30), most=0.8)
    assert rgba[..., 3].min() >= 0 and rgba[..., 3].max() <= 1
    assert (rgba[..., :3] >= 0).all() and (rgba[..., :3] <= 0.8 * rgba[..., 3:] + 1e-7).all()


@pytest.mark.parametrize("function", RESAMPLERS)
def test_depth_is_not_interpolated_across_an_edge(function):
    pixels = np.zeros((30, 30, 4), np.float32)
    half = np.full((30, 30), 4.0, np.float32)
    half[:, 15:] = 24.0
    _, depth = run(function, pixels, np.array([[0.5, 0, 6.0], [0, 0.5, 6.0], [0, 0, 1]]), False, (30, 30), half)
    found = depth[depth < 1e9]
    assert len(found) and set(np.round(found, 4)) == {4.0, 14.0}  # 2 + 0.5 * half


def test_twins_agree():
    rng = np.random.default_rng(9)
    pixels = rng.random((33, 44, 4)).astype(np.float32)
    half = rng.choice([3.0, 3.5, 40.0, np.inf], size=(33, 44)).astype(np.float32)
    no_ties = SHIFT + np.array([[0, 0, 0.01237], [0, 0, 0.02113], [0, 0, 0]])  # nearest pixels must be clear-cut
    for cubic in (False, True):
        one, two = (run(function, pixels, no_ties, cubic, (30, 40), half) for function in RESAMPLERS)
        np.testing.assert_allclose(one[0], two[0], atol=2e-6)
        np.testing.assert_allclose(one[1], two[1], rtol=1e-6)
