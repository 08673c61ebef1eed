"""Light that is made of coded normals where a run is read: its kernel, its reference, and when it is used."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import Shade
from rle_splat.runtime.jit import compiled, kernel, use_reference
from rle_splat.scene import Light
from rle_splat.shade.lighting import Shadows, lighting
from rle_splat.shade.normal_light import ONE, SHARPEST, code_normals, normal_light
from rle_splat.splat.reference.lamps import light_of_normals
from rle_splat.splat.scalar_scanline import put_lamps
from rle_splat.splat.scalar_splat import kernel_light_planes

needs_kernels = pytest.mark.skipif(not compiled(), reason="nothing is compiled without numba")
VOXELS, LENGTH = 400, 90
SHAPE = (40, 5, 4)
MATRIX = np.array([[1.0, 0.2, 0.0, 0.5], [0.0, -1.1, 0.3, 10.0], [0.1, 0.0, 0.9, 0.0], [0, 0, 0, 1.0]])
TILTED = np.array([[1.0, 0, 0, 0], [0, 0.6, -0.8, 0], [0, 0.8, 0.6, 0], [0, 0, 0, 1]])
SUN = Light("SUN", energy=3.0, matrix_world=TILTED)
FAR_EYE, NEAR_EYE = (0.3, -0.9, 0.5, 0.0), (30.0, -20.0, 50.0, 1.0)
GLOSSY = Shade(0.1, 0.6, 0.5, 17.5)
AHEAD = (0.0, 0.6, -0.8)
CASES = {  # shading, lights, headlight, eye
    "matt": (Shade(0.2, 0.7, 0.0, 5.0), (), AHEAD, FAR_EYE),
    "glossy": (replace(GLOSSY, shininess=10.0), (), AHEAD, FAR_EYE),
    "between two whole powers": (GLOSSY, (SUN,), None, FAR_EYE),
    "one-sided": (replace(GLOSSY, two_sided=False), (SUN,), AHEAD, FAR_EYE),
    "a near eye": (GLOSSY, (SUN,), AHEAD, NEAR_EYE),
    "colored": (GLOSSY, (replace(SUN, color=(1.0, 0.3, 0.1)), SUN), None, NEAR_EYE),
    "not sharp at all": (replace(GLOSSY, shininess=0.25), (SUN,), None, FAR_EYE),
    "as sharp as can be": (replace(GLOSSY, shininess=SHARPEST), (SUN,), None, NEAR_EYE),
}


def unit_vectors(count=VOXELS, seed=0):
    """(count, 3) float32; every seventh voxel has no normal."""
    normals = np.random.default_rng(seed).normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[::7] = 0.0
    return normals.astype(np.float32)


def falling_of(name):
    shade, lights, headlight, eye = CASES[name]
    return lighting(MATRIX, shade, lights, headlight_direction=headlight, eye=eye)


@kernel
def put(line, stride, to, count, lamps, scanline, depth, weight, voxel, far_weight, far_voxel, pair, matt, gloss):
    put_lamps(
        line, stride, to, count, lamps, scanline, depth, weight, voxel, far_weight, far_voxel, pair, matt, gloss
    )


def made(light, lamps, to, count, voxel, far_voxel, weights):
    """(count, channels) light of a piece of a scanline by the kernel."""
    lights = np.empty((0, light.channels), np.uint16)
    line = np.full((1 + light.channels) * LENGTH, np.nan, np.float32)
    near, far = np.float32(weights[0]), np.float32(weights[1])
    put(
        line, LENGTH, to, count, lamps, 3, 2, near, voxel, far, far_voxel, weights[1] != 0.0,
        *kernel_light_planes(lights, False),
    )  # fmt: skip
    planes = line.reshape(-1, LENGTH)
    outside = np.delete(planes, np.s_[to : to + count], axis=1)
    assert np.isnan(outside).all() and np.isnan(planes[0]).all()  # nothing but the light of these voxels
    return planes[1:, to : to + count].T


@needs_kernels
@pytest.mark.parametrize("name", CASES)
def test_the_kernel_makes_the_light_of_the_reference(name):
    light = normal_light(falling_of(name), SHAPE)
    lamps = light.lamps(code_normals(unit_vectors()), 1)
    assert lamps.is_near == (CASES[name][3] is NEAR_EYE)
    for to, count, voxel, far_voxel, weights in (
        (0, 37, 11, 200, (1.0, 0.0)), (5, 16, 3, 120, (0.3, 0.7)), (70, 15, 31, 77, (0.75, 0.25)),
        (2, 3, 8, 300, (0.5, 0.5)), (89, 1, 13, 14, (0.5, 0.5)),
    ):  # fmt: skip
        found = made(light, lamps, to, count, voxel, far_voxel, weights)
        expected = weights[0] * light_of_normals(
            lamps, light.channels, lamps.normals[:, voxel : voxel + count], (to, 3, 2)
        )
        if weights[1]:
            far = lamps.normals[:, far_voxel : far_voxel + count]
            expected = expected + weights[1] * light_of_normals(lamps, light.channels, far, (to, 3, 3))
        np.testing.assert_allclose(found, expected, rtol=2e-5, atol=2e-5)
        assert found.std() > 0.01 or count < 4


@needs_kernels
@pytest.mark.parametrize("name", CASES)
def test_a_voxel_has_the_same_bits_in_whichever_group(name):
    light = normal_light(falling_of(name), SHAPE)
    lamps = light.lamps(code_normals(unit_vectors()), 2)
    for weights in ((1.0, 0.0), (0.3, 0.7)):
        whole = made(light, lamps, 4, 45, 20, 150, weights)
        for piece in (1, 4, 7, 16, 19):
            parts = [
                made(light, lamps, 4 + at, min(piece, 45 - at), 20 + at, 150 + at, weights)
                for at in range(0, 45, piece)
            ]
            np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_coded_normals():
    normals = unit_vectors(1001)
    codes = code_normals(normals)
    assert codes.dtype == np.int16 and codes.shape == (3, 1001)
    with use_reference():
        np.testing.assert_array_equal(codes, code_normals(normals))
    assert np.abs(codes.T / ONE - normals).max() <= 0.5 / ONE * (1.0 + 1e-4)
    np.testing.assert_array_equal(codes.any(axis=0), normals.any(axis=1))


def test_which_light_is_made_of_normals():
    assert all(normal_light(falling_of(name), SHAPE) is not None for name in CASES)
    others = {
        "a light that is near": (GLOSSY, (replace(SUN, type="POINT"),)),
        "highlights by Phong": (replace(GLOSSY, highlight="phong"), (SUN,)),
        "too sharp": (replace(GLOSSY, shininess=SHARPEST + 1.0), (SUN,)),
    }
    for shade, lights in others.values():
        assert normal_light(lighting(MATRIX, shade, lights, eye=FAR_EYE), SHAPE) is None
    shaded = replace(falling_of("glossy"), shadows=Shadows(np.zeros((1, VOXELS), np.uint16), np.array((0, -1))))
    assert normal_light(shaded, SHAPE) is None
    # Neither the kind nor the sharpness of highlights counts where there are none.
    for shade in (replace(GLOSSY, highlight="phong", specular=0.0), replace(GLOSSY, shininess=1e6, specular=0.0)):
        assert normal_light(lighting(MATRIX, shade, (SUN,), eye=FAR_EYE), SHAPE) is not None
