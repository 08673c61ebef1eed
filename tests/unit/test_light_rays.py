"""Light traced beside voxels: kernels against numpy, and against closed forms, summed rays and the reference of light,
which share no code with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.effects.shadows import traced_light_steps
from rle_splat.runtime.jit import compiled, use_reference
from rle_splat.runtime.steps import drain
from rle_splat.scene import Camera, Clip, Light, Scene
from rle_splat.shade.light_rays import brick_steps
from rle_splat.shade.sample_light import ONE
from rle_splat.shade.surface_points import STEPS, points_for
from rle_splat.volume.volume import Volume
from tests.lamps import point, sun
from tests.light_codes import codes_and_reference
from tests.unit.test_light_nodes import (
    PLACES,
    SKEWED,
    SUNS,
    far_along,
    integrated,
    occluders_of,
    points_of,
    random_offsets,
    smooth,
    some,
)

WIDE_SUN = replace(sun((0.5, 0.3, -1)), angle=0.4)


def traced(light, occluders, offsets, scattered=False, normals=None):
    """(m,) share that arrives, or U; without ``normals`` at the offsets themselves."""
    bricks = drain(brick_steps(occluders.voxels, drain(occluders.find_extinction()), threads=occluders.threads))
    normals = np.zeros_like(offsets) if normals is None else normals
    points = points_for(light, normals, offsets, occluders.matrix)
    return drain(traced_light_steps(light, occluders, bricks, points, scattered)) / float(ONE)


def sparse(shape=(21, 18, 27), seed=5):
    """Blobs of extinction with empty bricks between them."""
    field = np.zeros(shape)
    rng = np.random.default_rng(seed)
    for _ in range(5):
        z, y, x = (rng.integers(0, n - 3) for n in shape)
        field[z : z + 3, y : y + 3, x : x + 3] = rng.uniform(0.05, 0.9, (3, 3, 3))
    return field


DENSE, SPARSE = smooth((9, 10, 13)), sparse()


@pytest.mark.parametrize(
    ("light", "field"),
    [
        (sun(SUNS[3]), DENSE), (sun(SUNS[1]), SPARSE), (point(PLACES[2]), SPARSE), (point(PLACES[3]), DENSE),
        (WIDE_SUN, SPARSE), (None, DENSE),
    ],
    ids=["sun", "sun along an axis", "lamp within", "lamp", "wide sun", "sky"],
)  # fmt: skip
def test_kernels_and_numpy_agree(light, field):
    if not compiled():
        pytest.skip("there is only numpy")
    middle = SKEWED.copy()
    middle[:3, 3] = SKEWED[:3, :3] @ (9.0, 8.0, 9.0) + SKEWED[:3, 3]
    clips = (Clip("plane", middle), Clip("box", middle @ np.diag((3.0, 4.0, 2.0, 1.0)), "outside"))
    for cut in ((), clips):
        occluders = occluders_of(field, SKEWED, clips=cut)
        offsets = random_offsets(occluders)
        normals = np.random.default_rng(2).integers(-ONE // 2, ONE // 2, offsets.shape).astype(np.int16)
        for given in ((False, normals), (light is not None, None)):
            found = traced(light, occluders, offsets, *given)
            with use_reference():
                expected = traced(light, occluders, offsets, *given)
            assert cut or found.min() < 0.9
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=2.0 / float(ONE))


@pytest.mark.parametrize(("kind", "at"), [*((sun, along) for along in SUNS), *((point, place) for place in PLACES)])
def test_rays_are_those_summed_in_small_steps_and_end_at_a_lamp(kind, at):
    field = smooth((12, 17, 26))
    occluders = occluders_of(field, SKEWED)
    offsets, few = random_offsets(occluders), some(occluders)
    begins = np.clip(points_of(occluders, offsets)[few], -1.0, occluders.voxels.shape_xyz)  # as grids of light end
    lamp = np.linalg.solve(SKEWED[:3, :3], np.array(at) - SKEWED[:3, 3])
    ends = far_along(SKEWED, begins, at) if kind is sun else np.broadcast_to(lamp, begins.shape)
    expected = integrated(field, SKEWED, begins, ends)
    np.testing.assert_allclose(traced(kind(at), occluders, offsets)[few], expected, atol=2e-3)


def test_a_uniform_medium_and_its_octaves():
    occluders = occluders_of(np.full((9, 9, 40), 0.05))
    offsets = np.zeros((9 * 9 * 40, 3), np.int16)
    left, beside = (traced(sun((-1, 0, 0)), occluders, offsets, scattered) for scattered in (False, True))
    depth = 0.05 * (39.0 - np.arange(40))
    np.testing.assert_allclose(left.reshape(9, 9, 40)[4, 4], np.exp(-depth), atol=5e-5)
    expected = (2.0 * np.exp(-depth / 2.0) + np.exp(-depth / 4.0)) / 3.0
    np.testing.assert_allclose(beside.reshape(9, 9, 40)[4, 4], expected, atol=5e-5)


def test_any_number_of_threads_gives_the_same_bits():
    field, found = smooth((12, 17, 26)), []
    for threads in (1, 2):
        occluders = occluders_of(field, SKEWED, threads=threads)
        found.append(traced(WIDE_SUN, occluders, random_offsets(occluders), scattered=True))
    np.testing.assert_array_equal(*found)


def test_a_lamp_at_the_point_and_a_medium_without_thickness_are_lit():
    occluders = occluders_of(np.full((5, 5, 5), 9.0))
    at = len(occluders.voxels) // 2
    offsets = np.zeros((len(occluders.voxels), 3), np.int16)
    assert traced(point((2.0, 2.0, 2.0)), occluders, offsets)[at] == 1.0
    flat = occluders_of(np.full((1, 5, 5), 9.0))
    assert (traced(sun((1, 0, 0)), flat, np.zeros((25, 3), np.int16)) == 1.0).all()


def test_a_mesh_blocks_the_light():
    corners = np.array([[[-50.0, -50.0, 12.0], [90.0, -50.0, 12.0], [-50.0, 90.0, 12.0]]])
    occluders = occluders_of(np.full((20, 9, 9), 1e-4), triangles=corners)
    found = traced(sun((0, 0, -1)), occluders, np.zeros((20 * 81, 3), np.int16)).reshape(20, 9, 9)
    assert (found[:11] == 0.0).all() and (found[14:] > 0.99).all()


def _scene(lights, **more):
    """A ball before a plate, unequal voxels; the sun from the side."""
    z, y, x = np.mgrid[:30, :32, :34].astype(float)
    ball = np.clip(8.0 - np.sqrt((x - 17) ** 2 + (y - 12) ** 2 + 2 * (z - 14) ** 2), 0.0, 3.0) / 3.0
    field = np.maximum(ball, np.clip(2.0 - np.abs(y - 26), 0.0, 1.0)).astype(np.float32)
    function = TransferFunction(
        opacity=((0.3, 0.0), (0.8, 0.6)), color=((0.0, 1.0, 1.0, 1.0),), opacity_unit_distance=1.0, shade=Shade()
    )
    camera_at = np.eye(4)
    camera_at[:3, 3] = 17.0, 16.0, 100.0
    camera = Camera(camera_at, type="ORTHO", ortho_scale=40.0, clip_end=1000.0)
    usual = dict(lights=lights, headlight=False, volume_shadows=True)
    return Scene(Volume(field, np.diag((1.0, 1.0, 1.5, 1.0))), function, camera, 24, 24, **usual, **more)


AREA = replace(point((30.0, -20.0, 60.0)), type="AREA", size=12.0, energy=1e4)
PLANE = np.eye(4)
PLANE[:3, 3] = 0.0, 0.0, 21.3
CASES = {
    "sun": dict(lights=(sun((0.2, 1, -0.4)),)),
    "wide sun": dict(lights=(replace(sun((0.2, 1, -0.4)), angle=0.3),)),
    "lamp": dict(lights=(replace(point((30.0, -20.0, 60.0)), radius=5.0, energy=1e4),)),
    "square": dict(lights=(AREA,)),
    "disk": dict(lights=(replace(AREA, shape="ELLIPSE", size_y=4.0),)),
    "indirect": dict(lights=(sun((0.2, 1, -0.4)),), indirect_light=1.0),
    "occlusion": dict(lights=(Light("SUN"),), ambient_occlusion=0.7),
    "cut by a plane": dict(lights=(sun((0.2, 1, -0.4)),), clips=(Clip("plane", PLANE),)),
    "cut by a box": dict(
        lights=(sun((0.2, 1, -0.4)),), clips=(Clip("box", PLANE @ np.diag((40.0, 9.7, 9.1, 1.0)), "outside"),)
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_what_arrives_is_that_of_the_reference(case, monkeypatch):
    """Planes of voxels against float64 rays of the reference, whose lamps have the same points."""
    codes, expected, _ = codes_and_reference(_scene(**CASES[case]), 11, monkeypatch)
    assert expected[:, 3:].min() < 0.5
    # An offset is off by half a STEP at most, which changes T by as much of the extinction of a voxel.
    np.testing.assert_allclose(codes / float(ONE), expected, rtol=0.0, atol=3.0 / STEPS)
