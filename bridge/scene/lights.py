"""The lights of the evaluated scene as plain data."""

import math

import numpy as np

from ...rle_splat.scene import LIGHT_TYPES, Light
from ..volumes import volumes

BY_SCENE = "SCENE", "BOTH"  # items of a volume's Lighting with which the scene's lights shine on it


def is_any_lit(scene) -> bool:
    """Whether the lights of a scene shine on any of its volumes."""
    return any(one.rle_splat.lighting in BY_SCENE for one in volumes.volume_objects(scene))


def any_casts_shadows(scene) -> bool:
    """Whether a light of a scene casts shadows on one of its volumes, if renders show it."""
    return scene.rle_splat.use_shadows and is_any_lit(scene) and any(
        one.type == "LIGHT" and one.data.use_shadow and not one.hide_render for one in scene.objects)  # fmt: skip


def read_lights(depsgraph) -> tuple[Light, ...]:
    """The lights that a render would use, including instances, in the depsgraph's order.

    Exposure and color temperature are included in energy and color.  Shader nodes of a light are ignored.  Colors are
    scene-linear, energies in W, or W/m^2 for suns; the matrices lead to the world.
    """
    lights = []
    for instance in depsgraph.object_instances:
        evaluated = instance.object
        if evaluated.type != "LIGHT" or evaluated.data.type not in LIGHT_TYPES:
            continue
        if not instance.show_self or evaluated.hide_render:
            continue
        energy = evaluated.data.energy * 2.0**evaluated.data.exposure
        if energy <= 0.0:
            continue
        lights.append(_as_plain_light(evaluated.data, energy, np.array(instance.matrix_world, dtype=np.float64)))
    return tuple(lights)


def _as_plain_light(data, energy: float, matrix_world: np.ndarray) -> Light:
    color = np.array(data.color, dtype=np.float64)
    if data.use_temperature:
        color = color * np.array(data.temperature_color, dtype=np.float64)
    size = getattr(data, "size", 0.0)
    shape = getattr(data, "shape", "SQUARE")
    return Light(
        type=data.type,
        color=tuple(np.maximum(color, 0.0)),
        energy=energy if data.normalize else energy * _emitting_area(data, matrix_world),
        matrix_world=matrix_world,
        radius=getattr(data, "shadow_soft_size", 0.0),
        angle=getattr(data, "angle", 0.0),
        size=size,
        size_y=data.size_y if shape in ("RECTANGLE", "ELLIPSE") else size,
        shape=shape,
        spot_size=getattr(data, "spot_size", 0.0),
        spot_blend=getattr(data, "spot_blend", 0.0),
        casts_shadow=data.use_shadow,
    )


def _emitting_area(data, matrix_world: np.ndarray) -> float:
    """Factor on the energy of a light with Normalize off: its area in world units squared, 1 for size zero."""
    scale = np.linalg.norm(matrix_world[:3, :3], axis=0)
    if data.type == "AREA":
        width = data.size * scale[0]
        height = (data.size_y if data.shape in ("RECTANGLE", "ELLIPSE") else data.size) * scale[1]
        area = width * height * (math.pi / 4.0 if data.shape in ("DISK", "ELLIPSE") else 1.0)
    elif data.type == "SUN":
        area = math.pi * math.sin(data.angle / 2.0) ** 2
    else:
        area = 4.0 * math.pi * data.shadow_soft_size**2
    return area if area > 0.0 else 1.0
