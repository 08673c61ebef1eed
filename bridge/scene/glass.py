"""How much light a material lets through straight: what a volume behind glass is tinted by."""

from __future__ import annotations

import bpy
import numpy as np

LEAST = 1.0 / 256.0  # of a share that shows
UNKNOWN = 0.5  # of a share that a texture or another node decides, and white for such a color
OPAQUE = np.zeros(4)


def share_of(material) -> np.ndarray | None:
    """The share of light that passes a surface.

    Known are the Principled, Glass, Refraction and Transparent BSDFs, and mixed and added shaders of them.

    Returns
    -------
    (4,) ndarray of float64 or None
        Of red, green, blue and alpha, as ``Scene.pane_shares``; None for an opaque one.
    """
    tree = None if material is None else material.node_tree
    output = None if tree is None else tree.get_output_node("ALL")
    if output is None:
        return None
    found = np.clip(_shader(output.inputs["Surface"]), 0.0, 1.0)
    return found if found.max() >= LEAST else None


def has_glass(depsgraph) -> bool:
    """Whether any object of a view layer has a material that lets light through."""
    glass = {material for material in bpy.data.materials if share_of(material) is not None}
    return bool(glass) and any(
        slot.material in glass for one in depsgraph.view_layer.objects for slot in one.material_slots
    )


def _shader(socket) -> np.ndarray:
    """What passes the shader that is linked to a socket."""
    node = socket.links[0].from_node if socket.is_linked else None
    while node is not None and node.type == "REROUTE":
        node = node.inputs[0].links[0].from_node if node.inputs[0].is_linked else None
    if node is None or node.mute:
        return OPAQUE
    if node.type == "BSDF_PRINCIPLED":
        alpha, glass = _number(node, "Alpha"), _number(node, "Transmission Weight") * (1.0 - _number(node, "Metallic"))
        return (1.0 - alpha) + alpha * glass * _color(node, "Base Color")
    if node.type in ("BSDF_GLASS", "BSDF_REFRACTION", "BSDF_TRANSPARENT"):
        return _color(node, "Color")
    if node.type == "MIX_SHADER":
        share = _number(node, 0)
        return (1.0 - share) * _shader(node.inputs[1]) + share * _shader(node.inputs[2])
    if node.type == "ADD_SHADER":
        return _shader(node.inputs[0]) + _shader(node.inputs[1])
    return OPAQUE


def _number(node, name) -> float:
    socket = node.inputs[name]
    return UNKNOWN if socket.is_linked else float(socket.default_value)


def _color(node, name: str) -> np.ndarray:
    """(4,): a color, and that nothing of the surface itself is seen."""
    socket = node.inputs[name]
    return np.array((*((1.0, 1.0, 1.0) if socket.is_linked else socket.default_value[:3]), 1.0))
