"""The world's light as plain data: one radiance from all directions."""

from __future__ import annotations

import numpy as np

from . import versions

TOO_MUCH = (
    "The world has more than one color, so its light is left out; give its Background a plain color and strength, or "
    "turn World Light off."
)


def read_world(scene, warn=None) -> tuple | None:
    """The radiance of a scene's world.

    With nodes, the world's output must be a Background with a plain color and strength.

    Parameters
    ----------
    scene : bpy.types.Scene
        The evaluated scene.
    warn : callable, optional
        Called with one sentence if the nodes are anything else.

    Returns
    -------
    tuple of float or None
        Scene-linear red, green and blue; None without a world, for black, and after a warning.
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
    """(3,) radiance of the plain Background at the active output; zeros for an unlinked output; else None."""
    output = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    links = output.inputs["Surface"].links if output is not None else ()
    if not links:
        return np.zeros(3)
    node = links[0].from_node
    if node.type != "BACKGROUND" or node.inputs["Color"].is_linked or node.inputs["Strength"].is_linked:
        return None
    color = np.array(node.inputs["Color"].default_value[:3], np.float64)
    return np.maximum(color * node.inputs["Strength"].default_value, 0.0)
