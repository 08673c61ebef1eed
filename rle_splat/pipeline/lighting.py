"""Light on the voxels of a source: what falls on them, what shadows leave of it, and the keys that name both."""

from dataclasses import replace

import numpy as np

from ..effects.shadows import Occluders
from ..runtime.steps import announce
from ..scene import Scene
from ..shade.lighting import Lighting, lighting
from ..view.projection import world_to_camera
from .shadows import shadow_count, shadow_steps
from .source import Work, array_key


def scene_lighting(scene: Scene, matrix) -> Lighting | None:
    """What falls on the voxels of a scene; None where nothing shades or nothing shines.

    Parameters
    ----------
    matrix : (4, 4) float64
        Voxel index to world.
    """
    headlight = -world_to_camera(scene.camera)[2, :3] if scene.headlight else None
    shade, eye = scene.transfer_function.shade, eye_of(scene.camera)
    return lighting(
        matrix, shade, scene.lights, headlight_direction=headlight, eye=eye, world=scene.world,
        environment=scene.environment,
    )  # fmt: skip


def eye_of(camera) -> np.ndarray:
    """(4,) homogeneous eye of a camera in the world; see ``shade.lighting.lighting``."""
    if camera.type == "PERSP":
        return np.array([*camera.matrix_world[:3, 3].tolist(), 1.0])
    return np.array([*world_to_camera(camera)[2, :3].tolist(), 0.0])


def lighting_key(scene: Scene, matrix, falling: Lighting) -> tuple:
    """All that the light on a voxel depends on beside its normal; the eye only where there are highlights."""
    seen_from = array_key(falling.eye) if falling.has_highlights else None
    shade = tuple(vars(scene.transfer_function.shade).values())
    return (array_key(matrix), shade, array_key(falling.rows, falling.material), seen_from)


def shadow_lighting_steps(scene: Scene, falling: Lighting | None, work: Work, occluders: Occluders):
    """Generator of Progress: the lighting with what shadows leave of each light, and a key of that.

    The lighting itself and an empty key where the scene has no shadows.
    """
    if falling is None or not shadow_count(scene):
        return falling, ()
    steps = shadow_steps(scene, occluders, work.job, work.clock)
    shadows, key = yield from announce(steps, 0.1, 0.1, "Casting shadows")
    return replace(falling, shadows=shadows), key
