"""The world's mist as plain data, where the scene's own switch asks for it: a view layer's Mist pass is a pass."""

from __future__ import annotations

from ..rle_splat.scene import LEAST_LENGTH, Mist
from .decimals import typed
from .world import read_world


def read_mist(depsgraph) -> Mist | None:
    """The mist of the scene's world if Mist is on in ``scene.rle_splat``: what mixing the world's color in by the
    Mist pass would make of the volume, sheet by sheet.  None otherwise.  A world that is more than one color counts as
    black."""
    world = depsgraph.scene_eval.world
    if world is None or not depsgraph.scene_eval.rle_splat.use_mist:
        return None
    settings = world.mist_settings
    color = read_world(depsgraph.scene_eval) or (0.0, 0.0, 0.0)
    return Mist(typed(settings.start), max(typed(settings.depth), LEAST_LENGTH), settings.falloff, color)
