"""The world's mist as plain data.  It is switched on by the scene's own property; the Mist pass of a view layer is a
render pass and changes no picture."""

from __future__ import annotations

from ...rle_splat.scene import LEAST_LENGTH, Mist
from ..data.decimals import typed
from .world_nodes import plain_color


def read_mist(depsgraph) -> Mist | None:
    """The mist of the scene's world; a world with more than one color counts as black.

    Returns
    -------
    Mist or None
        Start and depth in world units, falloff and scene-linear color; None if Mist is off in ``scene.rle_splat``.
    """
    world = depsgraph.scene_eval.world
    if world is None or not depsgraph.scene_eval.rle_splat.use_mist:
        return None
    settings = world.mist_settings
    color = plain_color(world) or (0.0, 0.0, 0.0)
    return Mist(typed(settings.start), max(typed(settings.depth), LEAST_LENGTH), settings.falloff, color)
