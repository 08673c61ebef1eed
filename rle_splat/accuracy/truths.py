"""The two truths of a scene: T1 of the interpolated classified medium, T2 of the classified interpolated scalar."""

from __future__ import annotations

import numpy as np

from ..scene import RleSplatError, Scene
from .integrate import TOLERANCE, integrate
from .medium import ClassifiedMedium, ScalarMedium
from .rays import camera_rays, pixel_centres
from .transfer import extinction_and_color, opacity_unit_distance

TRUTHS = ("T1", "T2")


def world_length_of_unit(scene: Scene) -> float:
    """World length of one of the volume's units: that of a cube's side after the volume's matrix."""
    return float(np.cbrt(abs(np.linalg.det(scene.volume_matrix[:3, :3]))) * scene.scene_scale)


def world_opacity_distance(scene: Scene) -> float:
    """World length of the distance the transfer function's alpha refers to."""
    return opacity_unit_distance(scene.transfer_function, scene.volume) * world_length_of_unit(scene)


def truth(scene: Scene, truth_name: str = "T1", colors=None, pixels=None, far=np.inf, tolerance=TOLERANCE):
    """Premultiplied rgba (N, 4) and depth (N,) of the scene's pixels, float64.

    ``pixels``: (columns, rows) in pixels from the left and the top, centres at + 0.5; all centres when None, row
    by row.  ``colors``: (nz, ny, nx, 3) colours of the voxels in place of the transfer function's own (T1 only):
    how shading enters.  ``far``: planar depth at which each ray ends, beside the camera's clip distances.
    """
    if truth_name not in TRUTHS:
        raise RleSplatError(f"There is no truth called {truth_name!r}; choose {' or '.join(TRUTHS)}.")
    volume, distance = scene.volume, world_opacity_distance(scene)
    values = volume.physical(volume.voxels)
    if truth_name == "T2":
        medium = ScalarMedium(values, scene.transfer_function, distance)
    else:
        extinction, own = extinction_and_color(scene.transfer_function, values, distance)
        medium = ClassifiedMedium(extinction, own if colors is None else colors)
    columns, rows = pixel_centres(scene.width, scene.height) if pixels is None else pixels
    rays = camera_rays(scene.camera, scene.width, scene.height, columns, rows)
    end = np.minimum(np.asarray(far, dtype=np.float64), scene.camera.clip_end)
    return integrate(medium, rays, scene.index_to_world, scene.camera.clip_start, end, tolerance)
