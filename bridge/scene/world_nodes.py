"""The light of a world as its nodes tell it: a Background of one color, or of the image of an environment texture."""

import bpy
import numpy as np
from mathutils import Euler

from ...rle_splat.shade.environment import panorama_moments
from .. import versions
from ..loop import store
from . import image_changes

MOST_NUMBERS = 2**25  # in the pixels of an image; a larger one would take too long and is rendered instead
LINEAR = ("Linear Rec.709", "Linear", "Non-Color")  # color spaces whose numbers are scene-linear as they are


def surface_of(tree):
    """The node at the Surface of a world's active output; None where nothing is linked."""
    output = _output_of(tree)
    links = output.inputs["Surface"].links if output is not None else ()
    return links[0].from_node if links else None


def _output_of(tree):
    """A world's active output; None without one."""
    return tree.get_output_node("CYCLES") or tree.get_output_node("ALL")


def plain_color(world) -> tuple | None:
    """The scene-linear radiance of a world of one color; None for any other.

    Black where nothing is linked to its output.
    """
    if not versions.world_is_nodes(world):
        return tuple(np.array(world.color, np.float64).tolist())
    node = surface_of(world.node_tree)
    if node is None:
        return (0.0, 0.0, 0.0)
    if not _is_background(node) or node.inputs["Color"].is_linked:
        return None
    color = np.array(node.inputs["Color"].default_value[:3], np.float64)
    return tuple(np.maximum(color * node.inputs["Strength"].default_value, 0.0).tolist())


def seen_as(world, gray: float):
    """A copy of a world, or a new one without light, of which the camera sees a gray instead; light of it stays."""
    copy = bpy.data.worlds.new("RLE Splat Background") if world is None else world.copy()
    copy.color = (gray,) * 3
    if not versions.world_is_nodes(copy):
        copy.use_nodes = True
        own = (0.0, 0.0, 0.0) if world is None else tuple(world.color)
        surface_of(copy.node_tree).inputs["Color"].default_value = (*own, 1.0)
    tree = copy.node_tree
    output = _output_of(tree) or tree.nodes.new("ShaderNodeOutputWorld")
    mix, path, plain = (tree.nodes.new(f"ShaderNode{name}") for name in ("MixShader", "LightPath", "Background"))
    plain.inputs["Color"].default_value = (gray, gray, gray, 1.0)
    for link in output.inputs["Surface"].links:
        tree.links.new(link.from_socket, mix.inputs[1])
    tree.links.new(path.outputs["Is Camera Ray"], mix.inputs[0])
    tree.links.new(plain.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    return copy


def light_of(world) -> tuple | None:
    """The light of a world.

    Returns
    -------
    (tuple of float, Environment) or None
        Mean radiance and environment; None for any world but a Background of fixed strength with an equirectangular
        texture of 32-bit floats, turned by at most one Mapping node.
    """
    found = _image_of(world)
    if found is None:
        return None
    image, strength, turn = found
    key = image.session_uid, image_changes.state_of(image), image_changes.events_of(world), strength, turn.tobytes()
    found = store.find(key)
    if found is None:
        found = panorama_moments(_pixels_of(image) * np.float32(strength), turn.T)
        store.put(store.Wish(world.original.session_uid, store.ANY, "light"), key, found)
    return found


def has_image(world) -> bool:
    """Whether ``light_of`` reads the light of an image; the image is not read."""
    return _image_of(world) is not None


def _image_of(world) -> tuple | None:
    """Image, strength and (3, 3) turn of a world as ``light_of`` takes it; None for any other."""
    if not versions.world_is_nodes(world):
        return None
    node = surface_of(world.node_tree)
    if node is None or not _is_background(node):
        return None
    texture = _before(node.inputs["Color"])
    if texture is None or texture.type != "TEX_ENVIRONMENT" or not _is_readable(texture):
        return None
    turn = _turn_of(texture.inputs["Vector"])
    if turn is None:
        return None
    return texture.image.original, max(node.inputs["Strength"].default_value, 0.0), turn


def _is_background(node) -> bool:
    """Whether a node is a Background of fixed strength."""
    return node.type == "BACKGROUND" and not node.mute and not node.inputs["Strength"].is_linked


def _before(socket):
    """The node linked to an input; None without one."""
    return socket.links[0].from_node if socket.is_linked else None


def _is_readable(texture) -> bool:
    image, moved, colored = texture.image, texture.texture_mapping, texture.color_mapping
    if texture.mute or image is None or image.source not in ("FILE", "GENERATED"):
        return False
    if texture.projection != "EQUIRECTANGULAR":
        return False
    if any((*moved.rotation, *moved.translation)) or tuple(moved.scale) != (1.0, 1.0, 1.0):
        return False
    if (colored.brightness, colored.contrast, colored.saturation, colored.use_color_ramp) != (1.0, 1.0, 1.0, False):
        return False
    width, height = image.original.size
    numbers = width * height * image.original.channels
    return image.is_float and image.colorspace_settings.name in LINEAR and 0 < numbers <= MOST_NUMBERS


def _turn_of(socket) -> np.ndarray | None:
    """(3, 3) float64 rotation from a direction of the world to one of the image; None for anything else."""
    node = _before(socket)
    if node is not None and node.type == "MAPPING":
        vector, *others = node.inputs
        if node.mute or any(one.is_linked for one in others):
            return None
        values = {one.name: tuple(one.default_value) for one in others if not one.is_unavailable}
        moved = any(values.get("Location", ())) or values["Scale"] != (1.0, 1.0, 1.0)
        if moved or node.vector_type not in ("POINT", "TEXTURE", "VECTOR"):
            return None
        turn = np.array(Euler(values["Rotation"]).to_matrix(), np.float64)
        before = _before(vector)
        is_direction = before is not None and before.type == "TEX_COORD"
        if not (is_direction and vector.links[0].from_socket.name == "Generated"):
            return None
        return turn.T if node.vector_type == "TEXTURE" else turn
    is_direction = node is None or (node.type == "TEX_COORD" and socket.links[0].from_socket.name == "Generated")
    return np.eye(3) if is_direction else None


def _pixels_of(image) -> np.ndarray:
    """(H, W, 3) float32, row 0 on top."""
    width, height = image.size
    pixels = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(height, width, image.channels)[::-1]
    return pixels[..., :3] if image.channels >= 3 else np.repeat(pixels[..., :1], 3, axis=2)
