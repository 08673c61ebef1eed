"""Our picture in the user's compositor: one Image and one Alpha Over, just before the output, and out again.

Nodes of ours carry a custom property and nothing else is touched, so the user may move, mute or rewire them.
"""

from __future__ import annotations

from ..rle_splat.scene import RleSplatError
from . import versions

MARK = "rle_splat"  # custom property of our nodes: "over" or "picture"
_OVER, _PICTURE, _DEFAULT = "over", "picture", "default"


def check_editable(scene) -> None:
    """Raise a RleSplatError when the scene's compositor may not be changed."""
    tree = versions.compositor_tree(scene)
    if tree is not None and not tree.is_editable:
        raise RleSplatError(
            f"The compositor {tree.name!r} is linked from another file; make it local before compositing a volume."
        )


def insert(scene, image) -> list[str]:
    """Lay ``image`` over whatever the scene's compositor gives out; calling it again only exchanges the image.

    Creates a tree where there is none.  Returns sentences on what else was changed.
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

    over, picture = _ours(tree)
    if over is None or picture is None or not _is_whole(over, picture):
        if over is not None and "was_tree" in over:  # torn apart by hand: build anew, but remember the same past
            before = {key: over[f"was_{key}"] for key in before}
        _take_out(tree)
        over, picture = _put_in(tree, scene)
        for key, value in before.items():
            over[f"was_{key}"] = value
    picture.image = image

    if not scene.render.use_compositing:
        scene.render.use_compositing = True
        remarks.append("Compositing was switched on in the output properties.")
    if not scene.render.use_lock_interface:
        scene.render.use_lock_interface = True
        remarks.append("Render > Lock Interface is on now: the volume is splatted while Blender renders.")
    return remarks


def remove(scene) -> bool:
    """Take our nodes out and link across the gap; whether there was anything to remove."""
    tree = versions.compositor_tree(scene)
    if tree is None:
        return False
    over, picture = _ours(tree)
    if over is None and picture is None:
        return False
    before = {} if over is None else {key: over.get(f"was_{key}") for key in ("tree", "compositing", "lock")}
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
    """Whether the scene's compositor lays a picture of ours over the render."""
    tree = versions.compositor_tree(scene)
    return tree is not None and None not in _ours(tree)


def _ours(tree):
    """Our Alpha Over and our Image node; None for each that is not there."""
    found = {node.get(MARK): node for node in tree.nodes}
    return found.get(_OVER), found.get(_PICTURE)


def _colors(node):
    """The two colour inputs of an Alpha Over: background, foreground.  (Their names and places differ between
    versions, their order among the colours does not.)"""
    background, foreground = [socket for socket in node.inputs if socket.type == "RGBA"][:2]
    return background, foreground


def _is_whole(over, picture) -> bool:
    """Whether the picture still enters the Alpha Over and its result still goes somewhere."""
    foreground = _colors(over)[1]
    return any(link.from_node == picture for link in foreground.links) and over.outputs[0].is_linked


def _put_in(tree, scene):
    target = _result_socket(tree, scene)
    output = target.node
    over = tree.nodes.new("CompositorNodeAlphaOver")
    picture = tree.nodes.new("CompositorNodeImage")
    over[MARK], picture[MARK] = _OVER, _PICTURE
    over.label = "RLE Splat over Render"
    picture.label = "RLE Splat"
    over.location = (output.location.x - 20.0, output.location.y)
    picture.location = (over.location.x - 220.0, over.location.y - 220.0)
    output.location.x += 200.0

    background, foreground = _colors(over)
    if target.is_linked:
        tree.links.new(target.links[0].from_socket, background)
    else:
        background.default_value = target.default_value
    tree.links.new(picture.outputs[0], foreground)
    tree.links.new(over.outputs[0], target)
    return over, picture


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
    over, picture = _ours(tree)
    if over is not None:
        background = _colors(over)[0]
        source = background.links[0].from_socket if background.is_linked else None
        targets = [link.to_socket for link in over.outputs[0].links]
        for target in targets:
            if source is not None:
                tree.links.new(source, target)
            elif target.type == "RGBA":
                target.default_value = background.default_value
        for target in targets:
            if target.node.bl_idname == versions.OUTPUT_NODE:
                target.node.location.x -= 200.0
        tree.nodes.remove(over)
    if picture is not None:
        tree.nodes.remove(picture)
