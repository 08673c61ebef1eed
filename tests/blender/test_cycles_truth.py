"""The truth T1 against a program that is not ours (G14): Cycles marches the same grid of extinction and emission.

Cycles interpolates the grid linearly before anything else happens to it, so with a linear material its picture is
the integral of the interpolated classified medium.  It takes random steps, so a pixel is noisy; the mean is not.
"""

import bpy
import numpy as np
import pytest
from mathutils import Vector

from benchmarks.phantoms import blobs
from tests.blender import scenes
from tests.blender.grids import SIZE, march, needs_grids, volume_of

# Up to 4.5 Cycles takes a voxel's value for the middle of its cell [i, i + 1], from 5.0 on for the place i itself.
SAMPLE_AT = 0.5 if bpy.app.version < (5, 0) else 0.0
PLAIN = np.eye(4)
STRETCHED = np.array([[0.8, 0.0, 0.0, 3.0], [0.0, 1.0, 0.3, -2.0], [0.0, 0.0, 1.3, 1.0], [0.0, 0.0, 0.0, 1.0]])


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("matrix", [PLAIN, STRETCHED], ids=["plain", "stretched"])
def test_cycles_sees_the_interpolated_classified_medium(core, tmp_path, matrix, kind):
    """Mean and noise agree in every channel; a truth moved by half a voxel along any axis does not."""
    field = blobs((18, 16, 14), 4, width=(1.5, 2.6)).astype(np.float64)
    extinction = -np.log1p(-field)
    z, y, x = np.indices(extinction.shape)
    color = np.stack((x / 17.0, y / 15.0, z / 13.0), axis=-1)
    volume_of(tmp_path / "medium.vdb", extinction, color, matrix)
    middle = (matrix @ (8.5, 7.5, 6.5, 1.0))[:3]
    away = np.array((25.0, -29.5, 13.5))
    camera = scenes.add_camera(middle + away, type=kind, ortho_scale=24.0, lens=58.0)
    camera.rotation_euler = Vector(-away).to_track_quat("-Z", "Y").to_euler()
    bpy.context.view_layer.update()
    ours = core("scene").Camera(np.array(camera.matrix_world), kind, lens=58.0, ortho_scale=24.0)
    rays = core("accuracy.rays").camera_rays(ours, *SIZE)
    medium = core("accuracy.medium").ClassifiedField(extinction, color)
    picture = march(tmp_path / "marched.exr").reshape(-1, 4)
    if not picture.any():
        needs_grids(tmp_path)

    def levels(moved=(0.0, 0.0, 0.0)):
        """(N, 4) difference from the truth of a volume moved by so many voxels."""
        place = matrix.copy()
        place[:3, 3] += matrix[:3, :3] @ (SAMPLE_AT + np.array(moved))
        return 255.0 * (picture - core("accuracy.integrate").integrate(medium, rays, place, tolerance=1e-6)[0])

    error = levels()
    assert picture[:, 3].max() > 0.9
    rmse = np.sqrt((error**2).mean())
    print(f"Cycles {bpy.app.version_string}: RMSE {rmse:.2f}, bias {np.abs(error.mean(axis=0)).max():.3f} levels")
    assert rmse < 1.0 and np.abs(error.mean(axis=0)).max() < 0.15
    for axis in range(3):
        for way in (-0.5, 0.5):
            assert np.sqrt((levels(way * np.eye(3)[axis]) ** 2).mean()) > 4.0 * rmse
