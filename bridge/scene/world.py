"""The world's light and mist as plain data.

A Background of one color is read from its node, and an environment texture from its image.  Any other world was
rendered before, see ``world_render.py``.
"""

from typing import NamedTuple

from ...rle_splat.scene import LEAST_LENGTH, Environment, Mist
from ..data.decimals import typed
from . import world_nodes, world_render
from .lights import BY_SCENE

ONE_COLOR, FROM_IMAGE, RENDERED = "one color", "its image, by direction", "rendered, by direction"


class WorldLight(NamedTuple):
    """What arrives from all directions.

    Attributes
    ----------
    radiance : tuple of float
        Scene-linear red, green and blue; the mean over all directions.
    environment : Environment or None
        How it differs by direction; None for one color.
    origin : str
        How it was found, for people.
    """

    radiance: tuple
    environment: Environment | None
    origin: str


def read_world(scene, warn=None) -> WorldLight | None:
    """The light of a scene's world; None without a world, for black, and after a warning.

    Parameters
    ----------
    warn : callable, optional
        Called with one sentence if the light is not that of the world as it is now.
    """
    if scene.world is None:
        return None
    color = world_nodes.plain_color(scene.world)
    if color is not None:
        return WorldLight(color, None, ONE_COLOR) if any(color) else None
    read = world_nodes.light_of(scene.world)
    origin = FROM_IMAGE
    if read is None:
        read, problem = world_render.light_of(scene)
        origin = RENDERED
        if problem and warn is not None:
            warn(problem)
    return None if read is None or not any(read[0]) else WorldLight(*read, origin)


def state(scene, lighting: str = "SCENE") -> str:
    """Which light of the world is used, or why none is; for a panel, so nothing is changed, read or rendered."""
    settings, world = scene.rle_splat, scene.world
    if lighting not in BY_SCENE:
        return "World: not part of this Light Source"
    if not settings.use_world:
        return "World: turned off"
    if world is None:
        return "World: the scene has none"
    color, has_directions, origin = world_nodes.plain_color(world), False, ONE_COLOR
    if color is None and world_nodes.has_image(world):
        has_directions, origin = True, FROM_IMAGE
    elif color is None:
        light, problem = world_render.light_of(scene)
        if problem:
            return problem
        (color, environment), origin = light, RENDERED
        has_directions = environment is not None
    if color is not None and not any(color):
        return "World: black, so it gives no light"
    if not has_directions and not any(one.type == "LIGHT" and not one.hide_render for one in scene.objects):
        return "World: one color, which lights the volume if the scene has a light"
    return f"World: {origin}"


def read_mist(depsgraph) -> Mist | None:
    """The mist of the scene's world; None if it is off in ``scene.rle_splat``.  The Mist pass changes no picture.

    Start and depth are in world units, the color is scene-linear; a world with more than one color counts as black.
    """
    world = depsgraph.scene_eval.world
    if world is None or not depsgraph.scene_eval.rle_splat.use_mist:
        return None
    settings = world.mist_settings
    color = world_nodes.plain_color(world) or (0.0, 0.0, 0.0)
    return Mist(typed(settings.start), max(typed(settings.depth), LEAST_LENGTH), settings.falloff, color)
