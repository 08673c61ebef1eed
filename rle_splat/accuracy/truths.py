"""The two truths of a scene: T1 of the interpolated classified medium, T2 of the classified interpolated scalar."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..scene import RleSplatError, Scene
from .clips import Clipping
from .integrate import TOLERANCE, integrate
from .medium import ClassifiedMedium, ScalarMedium
from .rays import camera_rays, pixel_centers
from .transfer import opacity_unit_distance

TRUTHS = ("T1", "T2")
RAYS_AT_ONCE = 128  # in a step that nothing interrupts


def world_length_of_unit(scene: Scene) -> float:
    """World length of one of the volume's units: that of a cube's side after the volume's matrix."""
    return float(np.cbrt(abs(np.linalg.det(scene.volume_matrix[:3, :3]))) * scene.scene_scale)


def world_opacity_distance(scene: Scene) -> float:
    """World length of the distance the transfer function's alpha refers to."""
    return opacity_unit_distance(scene.transfer_function, scene.volume) * world_length_of_unit(scene)


def check_shown(scene: Scene, truth_name: str) -> None:
    """RleSplatError when there is no such truth of what the scene shows."""
    if scene.mode not in ("composite", "xray") or (scene.mode == "xray" and truth_name != "T2"):
        raise RleSplatError(
            f"There is no truth {truth_name} of the mode {scene.mode}; choose the mode composite, or xray with T2."
        )
    if scene.mist is not None:
        raise RleSplatError("There is no truth of a scene in mist; turn the mist off to measure the rest.")
    if scene.transfer_function.gradient_opacity is not None:
        raise RleSplatError(
            "There is no truth of a transfer function with a gradient_opacity; take it out to measure the rest."
        )


def medium_of(scene: Scene, truth_name: str, colors=None, light=None, highlight=None):
    """What T1 or T2 integrates for a scene; the arguments are those of ``truth``.  Nothing is computed yet."""
    if truth_name not in TRUTHS:
        raise RleSplatError(f"There is no truth called {truth_name!r}; choose {' or '.join(TRUTHS)}.")
    volume, transfer_function, distance = scene.volume, scene.transfer_function, world_opacity_distance(scene)
    check_shown(scene, truth_name)
    if scene.mode == "xray":  # what is absorbed is white
        transfer_function, light, highlight = replace(transfer_function, color=((0.0, 1.0, 1.0, 1.0),)), None, None
    if truth_name == "T2":
        return ScalarMedium(volume.voxels, transfer_function, distance, light, highlight, volume.physical)
    return ClassifiedMedium.of_scalars(volume.voxels, volume.physical, transfer_function, distance, colors)


def truth(scene: Scene, truth_name: str = "T1", colors=None, pixels=None, far=np.inf, tolerance=TOLERANCE,
          light=None, highlight=None):  # fmt: skip
    """Premultiplied rgba (N, 4) and depth (N,) of the scene's pixels, float64.

    ``pixels``: (columns, rows) in pixels from the left and the top, centres at + 0.5; all centres when None, row
    by row.  ``far``: planar depth at which each ray ends, beside the camera's clip distances.  Shading enters T1
    by ``colors``: (nz, ny, nx, 3) colours of the voxels in place of the transfer function's own.  It enters T2 by
    ``light`` and ``highlight``: (nz, ny, nx) or (nz, ny, nx, 3), interpolated; the colour of a point is its
    classified colour * light + highlight.  Only the voxels next to the rays are looked up, so each may be anything
    that gives such values for index arrays (z, y, x).
    """
    medium = medium_of(scene, truth_name, colors, light, highlight)
    columns, rows = pixel_centers(scene.width, scene.height) if pixels is None else pixels
    rays = camera_rays(scene.camera, scene.width, scene.height, columns, rows)
    end = np.minimum(np.asarray(far, dtype=np.float64), scene.camera.clip_end)
    clipping = Clipping(scene.clips, rays) if scene.clips else None
    return integrate(medium, rays, scene.index_to_world, scene.camera.clip_start, end, tolerance, clipping)


def truth_steps(scene: Scene, truth_name: str, columns, rows, tolerance=TOLERANCE, **shading):
    """Generator: yields the fraction done every tenth of a second or so, returns (N, 4) rgba as ``truth`` does.

    ``columns``, ``rows``: (N,) pixels from the left and the top, centres at + 0.5."""
    found = np.empty((len(columns), 4))
    for first in range(0, len(columns), RAYS_AT_ONCE):
        yield first / len(columns)
        part = slice(first, first + RAYS_AT_ONCE)
        found[part], _ = truth(scene, truth_name, pixels=(columns[part], rows[part]), tolerance=tolerance, **shading)
    return found
