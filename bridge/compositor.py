"""Our pictures in the user's compositor: an Image and an Alpha Over each, and out again.

One picture stands just before the output.  Where the output is made of several view layers of the scene, each has a
picture of its own directly behind its Render Layers node, because a volume may be hidden in one and stand behind other
meshes in the next.

Nodes of ours carry a custom property and nothing else is touched, so the user may move, mute, group or rewire them.
A picture is the image that a node of ours holds: it is never looked for by name.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy

from ..rle_splat.scene import RleSplatError
from . import images, versions
from .compositor_paths import feeding

MARK = "rle_splat"  # custom property of our nodes: "over" or "picture"
_OVER, _PICTURE, _DEFAULT = "over", "picture", "default"
_AGAIN = "press Composite into Render again"


@dataclass(frozen=True)
class Picture:
    """An image of ours that reaches the scene's render, and the names of the view layers that it is laid over; none
    where it is laid over no view layer of the scene."""

    image: bpy.types.Image
    layers: frozenset[str]

    def is_of(self, layer: str) -> bool:
        """Whether the picture shows what a view layer shows."""
        return not self.layers or layer in self.layers


def check_editable(scene) -> None:
    """Raise a RleSplatError when the scene's compositor may not be changed."""
    tree = versions.compositor_tree(scene)
    if tree is not None and not tree.is_editable:
        raise RleSplatError(
            f"The compositor {tree.name!r} is linked from another file; make it local before compositing a volume."
        )


def insert(scene, make_image) -> list[str]:
    """Lay pictures over whatever the scene's compositor gives out; calling it again only exchanges their images.

    Creates a tree where there is none.  ``make_image``: called with the image that a picture had, or None, and the name
    of its view layer, or None where one picture is laid over the whole output; returns the picture's image.  Returns
    sentences on what else was changed.
    """
    remarks = []
    tree = versions.compositor_tree(scene)
    before = {"tree": "on", "compositing": scene.render.use_compositing, "lock": scene.render.use_lock_interface}
    if tree is None:
        tree = versions.switch_on_compositor(scene)
        before["tree"] = "off" if len(tree.nodes) else "none"
        remarks.append(
            "The compositor was switched on, with the nodes it had." if len(tree.nodes) else "A compositor was made."
        )
    elif versions.unshare_compositor(scene):
        tree = versions.compositor_tree(scene)
        remarks.append("The compositor was shared with other scenes; this scene has its own copy now.")

    earlier = images_of(scene)
    layers = _layer_nodes(tree, scene)
    names = {node.layer for node in layers}
    if not _is_laid_out(tree, scene, names):
        for over in _marked(tree, _OVER):  # torn apart or muted, or of other layers: built anew, with the same past
            before = {key: over.get(f"was_{key}", value) for key, value in before.items()}
        _take_out(tree)
        for target in layers if len(names) > 1 else [None]:
            over = _put_behind(target) if target is not None else _put_before_output(tree, scene)
            for key, value in before.items():
                over[f"was_{key}"] = value

    made, spare = {}, earlier
    for node in _marked(tree, _PICTURE):
        layer = min(_layers_of(tree, node, scene), default=None) if len(names) > 1 else None
        if layer not in made:
            kept = node.image if node.image in spare else next(iter(spare), None)
            spare = [image for image in spare if image != kept]
            made[layer] = make_image(kept, layer)
        node.image = made[layer]
    for image in spare:
        drop(image)
    if len(names) > 1:
        remarks.append(f"Each of the view layers {', '.join(sorted(names))} has a picture of its own.")

    if not scene.render.use_compositing:
        scene.render.use_compositing = True
        remarks.append("Compositing was switched on in the output properties.")
    if not scene.render.use_lock_interface:
        scene.render.use_lock_interface = True
        remarks.append("Render > Lock Interface is on now: the volume is splatted while Blender renders.")
    return remarks


def remove(scene) -> bool:
    """Take our nodes out and link across the gaps; whether there was anything to remove."""
    tree = versions.compositor_tree(scene)
    if tree is None or not (_marked(tree, _OVER) or _marked(tree, _PICTURE)):
        return False
    before = {}
    for over in _marked(tree, _OVER):
        before = {key: over.get(f"was_{key}") for key in ("tree", "compositing", "lock")}
    _take_out(tree)
    if before.get("compositing") is not None:
        scene.render.use_compositing = bool(before["compositing"])
    if before.get("lock") is not None:
        scene.render.use_lock_interface = bool(before["lock"])
    if before.get("tree") == "off":
        versions.switch_off_compositor(scene, discard=False)
    elif before.get("tree") == "none" and all(node.get(MARK) == _DEFAULT for node in tree.nodes):
        versions.switch_off_compositor(scene, discard=True)
    return True


def is_inserted(scene) -> bool:
    """Whether nodes of ours are in the scene's compositor."""
    tree = versions.compositor_tree(scene)
    return tree is not None and bool(_marked(tree, _OVER) or _marked(tree, _PICTURE))


def images_of(scene) -> list:
    """Every image of the scene's that nodes of ours hold, whether it reaches the render or not."""
    tree = versions.compositor_tree(scene)
    nodes = [] if tree is None else _marked(tree, _PICTURE)
    return list(dict.fromkeys(node.image for node in nodes if _is_ours(node.image, scene)))


def exchange_images(scene, exchange) -> None:
    """Put ``exchange(image)`` in place of each picture, of whichever scene, that nodes of ours hold."""
    tree = versions.compositor_tree(scene)
    nodes = [] if tree is None else [one for one in _marked(tree, _PICTURE) if one.image and images.MARK in one.image]
    new = {image: exchange(image) for image in {node.image for node in nodes}}
    for node in nodes:
        node.image = new[node.image]


def pictures(scene) -> list[Picture]:
    """The pictures that reach the scene's render."""
    tree = versions.compositor_tree(scene)
    if tree is None or not scene.render.use_compositing:
        return []
    found = {}
    for node in _reaching(tree):
        if _is_ours(node.image, scene):
            found.setdefault(node.image, set()).update(_layers_of(tree, node, scene))
    return [Picture(image, frozenset(layers)) for image, layers in found.items()]


def problem(scene) -> str | None:
    """Why a picture of ours does not reach the scene's render: a sentence, or None where all do."""
    tree = versions.compositor_tree(scene)
    if not scene.render.use_compositing:
        return ("Compositing is switched off in the output properties, so the volume is not in the render; switch it "
                "on, or press Remove from Render.")
    if tree is None:
        return f"The scene's compositor is switched off, so the volume is not in the render; {_AGAIN}."
    nodes, overs, reaching = _marked(tree, _PICTURE), _marked(tree, _OVER), _reaching(tree)
    if not nodes or not (overs or reaching):
        return f"The volume's nodes were taken out of the compositor; {_AGAIN}."
    for node in nodes:
        if node.image is None:
            return f"The image of the compositor's node {_title(node)} was deleted or taken out; {_AGAIN}."
        if not _is_ours(node.image, scene):
            return (f"The compositor's node {_title(node)} holds the image {node.image.name!r}, which is not the "
                    f"volume's picture; {_AGAIN}.")
    if {node.image for node in nodes} != {node.image for node in reaching}:
        for node in [*nodes, *overs]:
            if node.mute:
                return (f"The compositor's node {_title(node)} is muted, so the volume is not in the render; unmute "
                        "it, or press Remove from Render.")
        return ("The volume's picture is not linked to the compositor's output, so it is not in the render; link it, "
                f"or {_AGAIN}.")
    for over in overs:
        factor = _factor(over)
        if not factor.is_linked and factor.default_value == 0.0:
            return (f"The factor of the compositor's node {_title(over)} is 0, so the volume is not in the render; "
                    "raise it, or press Remove from Render.")
    return None


def drop(image) -> None:
    """Delete an image of ours that nothing uses any more."""
    if image.users == 0:
        bpy.data.images.remove(image)


def _is_ours(image, scene) -> bool:
    """Whether an image is a picture that this extension made for the scene, or in version 0.1.0, for any."""
    return image is not None and images.MARK in image and (
        images.OWNER not in image or images.owned_by(image, scene))


def _title(node) -> str:
    return repr(node.label or node.name)


def _trees(tree) -> list:
    """A tree and those of the node groups in it."""
    found = [tree]
    for one in found:
        inner = [node.node_tree for node in one.nodes if node.type == "GROUP" and node.node_tree is not None]
        found.extend(group for group in dict.fromkeys(inner) if group not in found)
    return found


def _marked(tree, kind: str) -> list:
    """Our nodes of a kind, also in node groups."""
    return [node for one in _trees(tree) for node in one.nodes if node.get(MARK) == kind]


def _colors(node):
    """The two colour inputs of an Alpha Over: background, foreground.  (Their names and places differ between
    versions, their order among the colours does not.)"""
    background, foreground = [socket for socket in node.inputs if socket.type == "RGBA"][:2]
    return background, foreground


def _factor(over):
    """The number by which an Alpha Over fades its foreground."""
    return next(socket for socket in over.inputs if socket.type == "VALUE")


def _results(tree) -> list:
    """The inputs that leave the compositor: the colour of its output, and what goes to files."""
    ends = [one for one in tree.nodes if one.bl_idname == versions.OUTPUT_NODE and not one.mute
            and getattr(one, "is_active_output", True)]
    found = [next((socket for socket in end.inputs if socket.type == "RGBA"), None) for end in ends]
    files = [one for one in tree.nodes if one.bl_idname == "CompositorNodeOutputFile" and not one.mute]
    return [socket for socket in found if socket is not None] + [socket for one in files for socket in one.inputs]


def _reaching(tree) -> set:
    """Our Image nodes whose result leaves the compositor, through an Alpha Over or whatever the user put there."""
    return {node for node, _output, _holders in feeding(_results(tree)) if node.get(MARK) == _PICTURE}


def _layers_of(tree, picture, scene) -> set[str]:
    """The scene's view layers that a picture is laid over: those behind its Alpha Overs, or, where the user lays it
    over by other means, those of the whole result."""
    overs = [(node, holders) for node, _output, holders in feeding(_results(tree)) if node.get(MARK) == _OVER]
    beneath = []
    for over, holders in overs:
        background, foreground = _colors(over)
        if any(node == picture for node, _output, _holders in feeding([foreground], holders)):
            beneath.extend(feeding([background], holders))
    if not beneath:
        beneath = feeding(_results(tree))
    return {node.layer for node, _output, _holders in beneath if _is_layer(node, scene)}


def _is_layer(node, scene) -> bool:
    return node.bl_idname == "CompositorNodeRLayers" and node.scene == scene


def _layer_nodes(tree, scene) -> list:
    """The Render Layers nodes whose Image is part of the result, in the order of their names."""
    found = {node for node, output, _holders in feeding(_results(tree))
             if _is_layer(node, scene) and output.identifier == "Image"}
    return sorted(found, key=lambda node: node.name)


def _is_laid_out(tree, scene, names: set[str]) -> bool:
    """Whether our nodes are as they would be made: one picture, or one for each of several view layers, and all of them
    reach the result."""
    nodes, overs = _marked(tree, _PICTURE), _marked(tree, _OVER)
    if not nodes or len(nodes) != len(overs) or set(nodes) != _reaching(tree):
        return False
    if len(names) < 2:
        return len(nodes) == 1
    layers = [_layers_of(tree, node, scene) for node in nodes]
    return all(len(own) == 1 for own in layers) and set().union(*layers) == names


def _add_pair(tree, x: float, y: float):
    """A new Alpha Over at a place, with its Image; not linked to anything else."""
    over = tree.nodes.new("CompositorNodeAlphaOver")
    picture = tree.nodes.new("CompositorNodeImage")
    over[MARK], picture[MARK] = _OVER, _PICTURE
    over.label = "RLE Splat over Render"
    picture.label = "RLE Splat"
    over.location = (x, y)
    picture.location = (x - 220.0, y - 220.0)
    foreground = _colors(over)[1]
    foreground.default_value = (0.0, 0.0, 0.0, 0.0)  # or the render would be white where the picture is unlinked
    tree.links.new(picture.outputs[0], foreground)
    return over


def _put_before_output(tree, scene):
    """An Alpha Over and its picture between the output and what feeds it."""
    target = _result_socket(tree, scene)
    output = target.node
    over = _add_pair(tree, output.location.x - 20.0, output.location.y)
    output.location.x += 200.0
    over["moved_output"] = True
    background = _colors(over)[0]
    if target.is_linked:
        tree.links.new(target.links[0].from_socket, background)
    else:
        background.default_value = target.default_value
    tree.links.new(over.outputs[0], target)
    return over


def _put_behind(layers):
    """An Alpha Over and its picture between a Render Layers node's Image and all that it feeds."""
    tree, source = layers.id_data, layers.outputs["Image"]
    targets = [link.to_socket for link in source.links]
    over = _add_pair(tree, layers.location.x + layers.width + 40.0, layers.location.y)
    over["moved_output"] = False
    tree.links.new(source, _colors(over)[0])
    for target in targets:
        tree.links.new(over.outputs[0], target)
    return over


def _result_socket(tree, scene):
    """The colour input of the tree's output node; both are made when missing, fed by the Render Layers."""
    outputs = [node for node in tree.nodes if node.bl_idname == versions.OUTPUT_NODE and not node.mute]
    outputs.sort(key=lambda node: not getattr(node, "is_active_output", True))
    versions.add_output_socket(tree)
    if outputs:
        return next(socket for socket in outputs[0].inputs if socket.type == "RGBA")
    layers = tree.nodes.new("CompositorNodeRLayers")
    layers.scene = scene
    output = tree.nodes.new(versions.OUTPUT_NODE)
    output.location = (400.0, 0.0)
    layers[MARK] = output[MARK] = _DEFAULT
    target = next(socket for socket in output.inputs if socket.type == "RGBA")
    tree.links.new(layers.outputs["Image"], target)
    return target


def _take_out(tree) -> None:
    for over in _marked(tree, _OVER):
        within = over.id_data
        background = _colors(over)[0]
        source = background.links[0].from_socket if background.is_linked else None
        targets = [link.to_socket for link in over.outputs[0].links]
        for target in targets:
            if source is not None:
                within.links.new(source, target)
            elif target.type == "RGBA":
                target.default_value = background.default_value
        for target in targets:
            if target.node.bl_idname == versions.OUTPUT_NODE and over.get("moved_output", True):
                target.node.location.x -= 200.0
        within.nodes.remove(over)
    for picture in _marked(tree, _PICTURE):
        picture.id_data.nodes.remove(picture)
