"""What meshes leave of light at voxels: kernels against numpy, and against geometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.effects.shadows import light_passes, unblocked_steps
from rle_splat.runtime.jit import use_reference
from rle_splat.runtime.steps import drain
from rle_splat.shade.light_sweep import FULL
from rle_splat.shade.sample_light import ONE
from rle_splat.shade.surface_points import STEPS, points_for
from tests.lamps import point, sun
from tests.unit.test_light_nodes import SKEWED, occluders_of, points_of, random_offsets

SLOPING = np.array([[(2.0, 0.0, 9.0), (20.0, 2.0, 6.0), (5.0, 30.0, 8.0)]])
DENSE = np.full((22, 40, 20), 0.5)


def left_of(light, occluders, offsets, normals=None, beside=False, sharp=False):
    """(m,) share that meshes leave."""
    normals = np.zeros_like(offsets) if normals is None else normals
    points = points_for(light, normals, offsets, occluders.matrix)
    found = drain(unblocked_steps(*light_passes(light, occluders, nodes=True, sharp=sharp), occluders, points, beside))
    return found / FULL


def shell(middle, half):
    """A closed cube of triangles."""
    faces = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            corners = np.array([(i, j, side) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]) * half
            corners = np.roll(corners, axis, axis=1) + middle
            faces += [corners[[0, 1, 2]], corners[[0, 2, 3]]]
    return np.array(faces)


@pytest.mark.parametrize("beside", [False, True])
@pytest.mark.parametrize(
    "light", [sun((0.5, 0.3, -1)), replace(sun((1, 0.4, -0.3)), angle=0.3), point((9.1, 8.7, 9.4)), point((9, 30, 9))]
)
def test_kernels_are_as_numpy_on_any_number_of_threads(light, beside, monkeypatch):
    monkeypatch.setattr("rle_splat.shade.mesh_light.LOOKED_UP_AT_ONCE", 500)
    normals = np.random.default_rng(4).integers(-ONE // 2, ONE // 2, (DENSE.size, 3)).astype(np.int16)
    normals[::5] = 0
    found = []
    for threads in (1, 2, 3):
        occluders = occluders_of(DENSE, SKEWED, threads, SLOPING)
        found.append(left_of(light, occluders, random_offsets(occluders), normals, beside))
    with use_reference():
        reference = left_of(light, occluders, random_offsets(occluders), normals, beside)
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])
    assert np.ptp(reference) > 0.5
    assert (np.abs(found[0] - reference) > 1e-3).mean() < 1e-3  # the edge of a mesh is a step


@pytest.mark.parametrize("place", [(9.0, 10.0, 9.0), (9.25, 10.5, 9.125)], ids=["on voxels", "between voxels"])
def test_every_voxel_is_in_one_pyramid_of_a_lamp(place):
    """All that a closed shell around a lamp hides is dark, also where pyramids meet, and no light is taken twice."""
    occluders = occluders_of(np.full((19, 21, 20), 0.5), triangles=shell(np.array(place), 3.3))
    offsets = np.zeros((len(occluders.voxels), 3), np.int16)
    left = left_of(point(place), occluders, offsets)
    away = np.abs(points_of(occluders, offsets) - place).max(axis=1)
    assert (left[away > 3.9] == 0.0).all() and (left[away < 3.2] == 1.0).all()


def test_light_is_looked_up_at_voxels_or_beside_them():
    """Two voxels below a mesh it is dark, and at points three voxels higher it is not."""
    plane = np.array([[(-90.0, -90.0, 12.3), (90.0, -90.0, 12.3), (0.0, 200.0, 12.3)]])
    occluders = occluders_of(np.full((20, 9, 9), 1e-4), triangles=plane)
    offsets = np.zeros((len(occluders.voxels), 3), np.int16)
    offsets[:, 2] = 3 * STEPS
    for beside in (False, True):
        left = left_of(sun((0, 0, -1)), occluders, offsets, beside=beside).reshape(20, 9, 9)
        assert (left[10] == beside).all()


def test_where_no_mesh_shades_nothing_is_kept():
    below = SLOPING - (0.0, 0.0, 60.0)
    for triangles in (None, np.empty((0, 3, 3)), below):
        occluders = occluders_of(DENSE, None, 1, triangles)
        assert len(left_of(sun((0, 0, -1)), occluders, random_offsets(occluders))) == 0
