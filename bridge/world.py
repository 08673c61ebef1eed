"""The world's light as plain data: one radiance from everywhere."""

from __future__ import annotations

import numpy as np

from . import versions

TOO_MUCH = (
    "The world is more than one color, which its light cannot be read from here: it is left out; give its Background "
    "a plain color and strength, or turn World Light off."
)


def read_world(scene, warn=None) -> tuple | None:
    """(r, g, b) scene-linear radiance of an evaluated scene's world; None when it has none, or is black.

    Of a world of nodes the Background at the output counts, when its color and strength are plain numbers; for any
    other world ``warn`` is called with a sentence, and None returned.
    """
    world = scene.world
    if world is None:
        return None
    if not versions.world_is_nodes(world):
        radiance = np.array(world.color, np.float64)
    else:
        radiance = _background(world.node_tree)
        if radiance is None:
            if warn is not None:
                warn(TOO_MUCH)
            return None
    return tuple(radiance.tolist()) if radiance.any() else None


def _background(tree) -> np.ndarray | None:
    """(3,) radiance of the plain Background that the active output shows, zeros where it shows nothing, else None."""
    output = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    links = output.inputs["Surface"].links if output is not None else ()
    if not links:
        return np.zeros(3)
    node = links[0].from_node
    if node.type != "BACKGROUND" or node.inputs["Color"].is_linked or node.inputs["Strength"].is_linked:
        return None
    color = np.array(node.inputs["Color"].default_value[:3], np.float64)
    return np.maximum(color * node.inputs["Strength"].default_value, 0.0)
