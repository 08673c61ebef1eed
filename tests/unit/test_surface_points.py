"""Where surfaces face and their shadows begin: kernels against numpy, and both against plain cases."""

from __future__ import annotations

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.classify.visible import VisibleVoxels
from rle_splat.runtime.jit import use_reference
from rle_splat.runtime.steps import drain
from rle_splat.scene import Clip
from rle_splat.shade.sample_light import ONE
from rle_splat.shade.surface_normals import Surfaces
from rle_splat.shade.surface_points import STEPS, faces_of, place_steps, shown_ranges
from rle_splat.volume.volume import Volume

SHEARED = np.array([[1.0, 0.3, -0.2, 9.0], [0.1, 1.2, 0.5, -4.0], [0.0, 0.3, 1.8, 1.0], [0, 0, 0, 1.0]])


def function(*opacity):
    return TransferFunction(opacity=opacity, color=((0.0, 1.0, 1.0, 1.0),))


def everything(volume):
    """VisibleVoxels of all voxels."""
    nx, ny, nz = volume.shape_xyz
    row_start = np.arange(nz * ny + 1, dtype=np.int64) * nx
    column = np.tile(np.arange(nx, dtype=np.uint16), nz * ny)
    made = object.__new__(VisibleVoxels)
    for name, value in {
        "row_start": row_start, "column": column, "shape_xyz": volume.shape_xyz,
        "stored": np.ascontiguousarray(volume.voxels).ravel(),
    }.items():  # fmt: skip
        object.__setattr__(made, name, value)
    return made


def random_scene(seed=0, shape=(9, 10, 11), dtype=np.int16):
    rng = np.random.default_rng(seed)
    voxels = rng.integers(-50, 450, shape).astype(dtype)
    volume = Volume(voxels, np.diag((0.5, 0.6, 2.0, 1.0)), slope=-0.5, intercept=7.0)
    count = volume.voxels.size
    vectors = rng.normal(size=(count, 3))
    vectors *= rng.uniform(0.0, 1.0, (count, 1)) / np.linalg.norm(vectors, axis=1, keepdims=True)
    vectors[:5] = 0.0
    steepness = rng.uniform(0.0, 300.0, count).astype(np.float32)
    steepness[5:9] = 0.0
    return volume, Surfaces((vectors * ONE).astype(np.int16), steepness)


CLIPS = {
    "none": (),
    "plane": (Clip("plane", np.array([[1, 0, 0, 12], [0, 0.6, -0.8, 1], [0, 0.8, 0.6, 9], [0, 0, 0, 1.0]])),),
    "box": (Clip("box", np.diag((4.0, 3.0, 6.0, 1.0)) + np.eye(4)[:, 3:] * 0.0, "inside"),),
    "removed": (Clip("box", np.array([[3, 0, 0, 12], [0, 3, 1, 3], [0, 0, 4, 9], [0, 0, 0, 1.0]]), "outside"),),
}
FUNCTIONS = {
    "bone": function((-20.0, 0.0), (10.0, 0.4)),
    "air": function((-100.0, 0.4), (0.0, 0.0)),
    "bands": function((-150.0, 0.0), (-100.0, 0.2), (-60.0, 0.0), (-20.0, 0.0), (0.0, 0.5), (20.0, 0.0)),
    "touching": function((-150.0, 0.2), (-60.0, 0.0), (20.0, 0.3)),
    "everything": function((0.0, 0.3)),
    "nothing": function((0.0, 0.0)),
}


def place_surfaces(*given, **settings):
    return drain(place_steps(*given, **settings))


@pytest.mark.parametrize("clips", CLIPS)
@pytest.mark.parametrize("name", FUNCTIONS)
def test_kernels_are_as_numpy(name, clips, monkeypatch):
    volume, surfaces = random_scene()
    faces = faces_of(CLIPS[clips], SHEARED)
    arguments = surfaces, everything(volume), volume, FUNCTIONS[name], SHEARED, faces
    codes, offsets = place_surfaces(*arguments, with_points=True, threads=1)
    with use_reference():
        expected, expected_offsets = place_surfaces(*arguments, with_points=True)
    np.testing.assert_allclose(codes, expected, atol=1.0)
    np.testing.assert_allclose(offsets, expected_offsets, atol=2.0)
    monkeypatch.setattr("rle_splat.shade.surface_points.PLACED_AT_ONCE", 300)
    alone, none = place_surfaces(*arguments, with_points=False, threads=2)
    np.testing.assert_array_equal(alone, codes)
    assert none is None


def test_ranges_end_where_nothing_is_shown():
    infinity = np.inf
    assert shown_ranges(((10.0, 0.0), (20.0, 0.5))).tolist() == [[10.0, infinity]]
    assert shown_ranges(((10.0, 0.5), (20.0, 0.0))).tolist() == [[-infinity, 20.0]]
    assert shown_ranges(((0.0, 0.0), (1.0, 0.5), (2.0, 0.0), (3.0, 0.5), (4.0, 0.0))).tolist() == [[0, 2], [2, 4]]
    assert shown_ranges(((0.0, 0.0), (1.0, 0.0))).tolist() == []
    assert shown_ranges(((5.0, 0.3),)).tolist() == [[-infinity, infinity]]


def wall(values, opacity, gradient=1.0):
    """Codes and offsets of the middle voxel of a row of ``values`` along x, whose gradient points along +x."""
    voxels = np.zeros((9, 9, 9), np.float32)
    voxels[:] = np.asarray(values, np.float32)
    volume = Volume(voxels, np.eye(4))
    vectors = np.zeros((voxels.size, 3), np.int16)
    vectors[:, 0] = ONE * gradient
    surfaces = Surfaces(vectors, np.full(voxels.size, 50.0, np.float32))
    codes, offsets = place_surfaces(
        surfaces, everything(volume), volume, opacity, np.eye(4), faces_of((), np.eye(4)), with_points=True
    )
    return codes.reshape(9, 9, 9, 3)[4, 4] / ONE, offsets.reshape(9, 9, 9, 3)[4, 4] / STEPS


def test_a_normal_points_to_where_extinction_falls_and_shadows_begin_a_width_off_the_surface():
    values = np.arange(9) * 50.0
    codes, offsets = wall(values, function((150.0, 0.0), (151.0, 0.9)))
    np.testing.assert_allclose(codes[4], (-1.0, 0.0, 0.0), atol=1e-4)  # the value 200: one voxel behind the surface
    further = 9 / 8
    np.testing.assert_allclose(offsets[4], (-2.0 * further, 0.0, 0.0), atol=2e-3)
    np.testing.assert_allclose(offsets[6], (-3.0 * further, 0.0, 0.0), atol=2e-3)  # three widths at most
    np.testing.assert_allclose(offsets[2], (-1.0 * further, 0.0, 0.0), atol=2e-3)  # the transparent side: a width
    codes, offsets = wall(values, function((250.0, 0.9), (251.0, 0.0)))
    np.testing.assert_allclose(codes[4], (1.0, 0.0, 0.0), atol=1e-4)
    np.testing.assert_allclose(offsets[4], ((1.0 + 51.0 / 50.0) * further, 0.0, 0.0), atol=2e-3)


def test_a_band_is_lit_from_both_of_its_sides():
    codes, _ = wall(np.arange(9) * 50.0, function((120.0, 0.0), (130.0, 0.9), (270.0, 0.9), (280.0, 0.0)))
    assert codes[3, 0] < -0.9 and codes[5, 0] > 0.9 and abs(codes[4, 0]) < 1e-3
    assert codes[2, 0] < -0.9 and codes[6, 0] > 0.9  # outside it points away from it, too


def test_faces_of_the_box_and_of_cuts_have_the_planes_normal():
    volume, surfaces = random_scene(shape=(12, 12, 12))
    matrix = np.eye(4)
    cut = np.array([[0, 0, 1, 5.4], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])  # keeps x < 5.4
    arguments = surfaces, everything(volume), volume, FUNCTIONS["bone"], matrix
    codes, offsets = place_surfaces(*arguments, faces_of((Clip("plane", cut),), matrix), with_points=True)
    m = codes.reshape(12, 12, 12, 3) / ONE
    np.testing.assert_allclose(m[5, 5, :2], [(-1.0, 0.0, 0.0)] * 2, atol=1e-4)
    np.testing.assert_allclose(m[5, 11, 8], (0.0, 1.0, 0.0), atol=1e-4)
    np.testing.assert_allclose(m[5, 5, 5], (1.0, 0.0, 0.0), atol=1e-4)
    begins = offsets.reshape(12, 12, 12, 3)[5, 5, 5] / STEPS
    np.testing.assert_allclose(begins, (1.4 * 9 / 8, 0.0, 0.0), atol=2e-3)  # .4 to the cut, and a width
