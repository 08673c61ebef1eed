"""The scale of a view: how long a pixel is in the volume, and round lengths for a scale bar."""

import math

import numpy as np

from ..scene import RleSplatError, Scene
from ..view.projection import depth_row, world_to_camera, world_to_pixel
from .plan import CENTER

MM_PER_UNIT = {"um": 1e-3, "µm": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0}  # metric units of volumes
EVEN = 1e-6  # largest relative difference of a matrix's scales that counts as the same scale
SHARE = 0.3  # of a picture's width that a scale bar of a round length fills at most
ROUND = (5.0, 2.0, 1.0)
UM, M = 1.0, 1000.0  # mm from which lengths are written in mm, and in m
NO_SCALE = (
    "A perspective view has one scale at one depth only; give the depth at which the scale bar is true (or 'center'), "
    "use an orthographic view, or turn the scale bar off."
)


def length_per_pixel(scene: Scene, depth: float | str | None = None) -> float:
    """The length that one pixel of a picture covers in the volume, in mm, or its own unit if that is no metric one.

    Parameters
    ----------
    depth : float, "center" or None
        For a perspective view: planar distance from the camera in world units; "center" is the middle of the volume.

    Raises
    ------
    RleSplatError
        If the volume is stretched unevenly, or for a perspective view without a depth.
    """
    unit = MM_PER_UNIT.get(scene.volume.unit, 1.0)
    return unit / (pixels_per_world_unit(scene, depth) * world_units_per_length(scene))


def world_units_per_length(scene: Scene) -> float:
    """World units per unit of the volume: the scale of its object; RleSplatError if that is not the same all ways."""
    scales = np.linalg.svd(scene.volume_matrix[:3, :3], compute_uv=False)
    if scales[0] - scales[-1] > EVEN * scales[0]:
        raise RleSplatError(
            "The volume's object is stretched more along one axis than along another, so no scale bar is true; give it "
            "the same scale on all axes, or turn the scale bar off."
        )
    return float(scales.mean()) * scene.scene_scale


def pixels_per_world_unit(scene: Scene, depth: float | str | None) -> float:
    """Pixels that a world unit across the view covers; ``depth`` as for ``length_per_pixel``."""
    to_pixel = world_to_pixel(scene.camera, scene.width, scene.height)
    across = float(to_pixel[0, :3] @ world_to_camera(scene.camera)[0, :3])
    if scene.camera.type == "ORTHO":
        return across
    if depth is None:
        raise RleSplatError(NO_SCALE)
    return across / depth_of(scene, depth)


def depth_of(scene: Scene, depth: float | str) -> float:
    """A depth in world units: the number itself, or that of the middle of the volume for "center"."""
    if depth != CENTER:
        return float(depth)
    middle = 0.5 * (np.array(scene.volume.shape_xyz) - 1.0)
    found = float(depth_row(scene.camera) @ scene.index_to_world @ (*middle, 1.0))
    if found <= 0.0:
        raise RleSplatError(
            "The middle of the volume is behind the camera; give the depth of the scale bar as a number."
        )
    return found


def round_length(longest: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is at most ``longest``."""
    power = 10.0 ** math.floor(math.log10(longest))
    steps = (float(f"{times * power:.12g}") for times in ROUND)
    return next((step for step in steps if step <= longest * (1.0 + 1e-9)), 0.5 * power)


def length_text(length: float, unit: str) -> str:
    """A length for people: ``length`` in mm for a metric ``unit``, else in that unit."""
    if unit not in MM_PER_UNIT:
        return f"{length:.6g} {'units' if unit == 'world' else unit}".strip()
    if length < UM:
        return f"{length * 1e3:.6g} µm"
    return f"{length:.6g} mm" if length < M else f"{length / M:.6g} m"
