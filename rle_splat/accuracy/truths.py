"""The two truths of a scene: T1 of the interpolated classified medium, T2 of the classified interpolated scalar."""

from dataclasses import replace

import numpy as np

from ..scene import RleSplatError, Scene
from .clips import Clipping
from .integrate import TOLERANCE, integrate
from .light_model import LitField
from .medium import ClassifiedField, ScalarField
from .rays import camera_rays, pixel_centers
from .transfer import world_opacity_distance

TRUTHS = ("T1", "T2")
# Between two steps of the generator, without light at every point and with it.
RAYS_AT_ONCE, LIT_RAYS_AT_ONCE = 128, 16


def check_shown(scene: Scene, truth_name: str) -> None:
    """Raise RleSplatError where the scene has no such truth."""
    if scene.mode not in ("composite", "xray") or (scene.mode == "xray" and truth_name != "T2"):
        raise RleSplatError(
            f"There is no reference of the mode {scene.mode}; choose the mode composite, or xray with the "
            "classification post."
        )
    if scene.mist is not None:
        raise RleSplatError("There is no reference of a scene in mist; turn the mist off to measure the rest.")
    if scene.transfer_function.gradient_opacity is not None:
        raise RleSplatError(
            "There is no reference of a transfer function with gradient opacity; take it out to measure the rest."
        )


def medium_of(scene: Scene, truth_name: str, colors=None, light=None):
    """The medium that T1 or T2 integrates for a scene, computed on demand; the arguments are those of ``truth``."""
    if truth_name not in TRUTHS:
        raise RleSplatError(f"There is no reference called {truth_name!r}; choose {' or '.join(TRUTHS)}.")
    volume, transfer_function, distance = scene.volume, scene.transfer_function, world_opacity_distance(scene)
    check_shown(scene, truth_name)
    if scene.mode == "xray":  # an X-ray shows absorption as white
        transfer_function, light = replace(transfer_function, color=((0.0, 1.0, 1.0, 1.0),)), None
    if truth_name == "T2":
        field = volume.voxels, transfer_function, distance, volume.physical
        further = [
            (one.volume.voxels, function, world_opacity_distance(scene, function), one.volume.physical)
            for one in scene.channels
            for function in (one.transfer_function,)
        ]
        return ScalarField(*field, further) if light is None else LitField(*field, light, further)
    return ClassifiedField.of_scalars(volume.voxels, volume.physical, transfer_function, distance, colors)


def truth(scene: Scene, truth_name: str = "T1", colors=None, pixels=None, far=np.inf, tolerance=TOLERANCE,
          light=None):  # fmt: skip
    """Integrate a truth of a scene along the rays of its pixels.

    Voxels are looked up next to the rays only.  So ``colors`` may be any object that gives such values for index
    arrays (z, y, x).

    Parameters
    ----------
    truth_name : str
        Of TRUTHS.
    colors : (nz, ny, nx, 3), optional
        T1: shaded colors of the voxels, in place of those of the transfer function.
    pixels : tuple of (N,) float, optional
        Columns from the left and rows from the top, pixel centers at + 0.5; all centers, row by row, by default.
    far : float or (N,) float
        Planar depth at which rays end, besides the camera's clip distances.
    tolerance : float
        As ``integrate.integrate`` takes it.
    light : light_model.PostLight, optional
        T2: light at every point; the color of a point is its classified color * light + highlight.

    Returns
    -------
    rgba : (N, 4) float64
        Premultiplied, scene-linear.
    depth : (N,) float64
        Planar depth of transmittance one half; 1e10 where there is none.
    """
    medium = medium_of(scene, truth_name, colors, light)
    columns, rows = pixel_centers(scene.width, scene.height) if pixels is None else pixels
    rays = camera_rays(scene.camera, scene.width, scene.height, columns, rows)
    end = np.minimum(np.asarray(far, dtype=np.float64), scene.camera.clip_end)
    clipping = Clipping(scene.clips, rays) if scene.clips else None
    return integrate(medium, rays, scene.index_to_world, scene.camera.clip_start, end, tolerance, clipping)


def truth_steps(scene: Scene, truth_name: str, columns, rows, tolerance=TOLERANCE, **shading):
    """Generator form of ``truth``: yields the fraction done about ten times a second, returns rgba (N, 4).

    ``columns``, ``rows``: (N,) positions from the left and the top, pixel centers at + 0.5.
    """
    found, count = np.empty((len(columns), 4)), LIT_RAYS_AT_ONCE if "light" in shading else RAYS_AT_ONCE
    for first in range(0, len(columns), count):
        yield first / len(columns)
        part = slice(first, first + count)
        found[part], _ = truth(scene, truth_name, pixels=(columns[part], rows[part]), tolerance=tolerance, **shading)
    return found
