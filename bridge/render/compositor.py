"""Insert our pictures into the user's compositor, an Image and an Alpha Over node each, and remove them again.

A picture is inserted directly after the Image of a Render Layers node, so that all outputs that show the render show
the volume.  Each view layer has its own picture, because the volume may be hidden in one layer and behind other meshes
in another.  A node that combines the Image with other passes of its view layer, such as Denoise, comes before the
picture: those passes do not know of the volume.  Where the output shows no Render Layers node, what it shows counts as
the Image.

Our nodes are marked with a custom property and no other node is changed, so the user may move, mute, group or rewire
them.  Links that are drawn past them later are led through them by ``settle``.  A picture is found as the image of a
marked node, never by name.
"""

from dataclasses import dataclass

import bpy

from ...rle_splat.scene import RleSplatError
from .. import versions
from ..pictures import images
from .compositor_paths import feeding

MARK = "rle_splat"  # custom property of our nodes: "over" or "picture"
_OVER, _PICTURE, _DEFAULT = "over", "picture", "default"
_AGAIN = "turn Show in Renders off and on"


@dataclass(frozen=True)
class CompositedPicture:
    """A picture that reaches the scene's render.

    Attributes
    ----------
    layers : frozenset of str
        Names of the view layers that it is composited over; empty if it is over no view layer of the scene.
    """

    image: bpy.types.Image
    layers: frozenset[str]

    def is_of(self, layer: str) -> bool:
        """Whether the picture belongs to the view layer of this name."""
        return not self.layers or layer in self.layers


def check_editable(scene) -> None:
    """RleSplatError if the scene's compositor is linked from another file and cannot be changed."""
    tree = versions.compositor_tree(scene)
    if tree is not None and not tree.is_editable:
        raise RleSplatError(
            f"The compositor {tree.name!r} is linked from another file; make it local before compositing a volume."
        )


def insert(scene, make_image) -> list[str]:
    """Composite pictures over the output of the scene's compositor; a second call only exchanges their images.

    Parameters
    ----------
    scene : bpy.types.Scene
        The scene.  It gets a compositor tree if it has none.
    make_image : callable
        ``make_image(earlier, layer)`` returns the image of a picture.  ``earlier`` is the image that the picture had,
        or None.  ``layer`` is the name of its view layer, or None for one picture over the whole output.

    Returns
    -------
    list of str
        Sentences on what else was changed.
    """
    remarks = []
    tree = versions.compositor_tree(scene)
    render = scene.render
    before = {"was_tree": "on", "was_compositing": render.use_compositing, "was_lock": render.use_lock_interface}
    if tree is None:
        tree = versions.switch_on_compositor(scene)
        before["was_tree"] = "off" if len(tree.nodes) else "none"
        remarks.append(
            "The compositor was switched on with its nodes." if len(tree.nodes) else "A compositor was created."
        )
    elif versions.unshare_compositor(scene):
        tree = versions.compositor_tree(scene)
        remarks.append("The compositor was shared with other scenes; this scene now has its own copy.")

    earlier = images_of(scene)
    names = {node.layer for node in _layer_nodes(tree, scene)}
    if not _is_laid_out(tree, scene, names):
        # Our nodes are unlinked or muted, or the view layers have changed: rebuild them, keeping what ``remove`` needs.
        before |= _noted(tree)
        _take_out(tree)
        target = _result_socket(tree, scene)
        for layers in _layer_nodes(tree, scene):
            _put_behind(tree, layers)
        if not any(_is_over(node) for node, _output, _holders in feeding([target])):
            _lead_through(target.links[0].from_socket if target.is_linked else None, [target])
        _note(_marked(tree, _OVER), before)

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
        remarks.append(f"Each of the view layers {', '.join(sorted(names))} has its own picture.")

    if not render.use_compositing:
        render.use_compositing = True
        remarks.append("Compositing was switched on in the output properties.")
    if not render.use_lock_interface:
        render.use_lock_interface = True
        remarks.append("Render > Lock Interface is now on, because the volume is drawn while Blender renders.")
    return remarks


def settle(scene) -> None:
    """Lead links that were drawn past our nodes through them; where that needs another picture, ``problem`` says so."""
    tree = versions.compositor_tree(scene)
    if tree is None or not tree.is_editable:
        return
    before, known = _noted(tree), {}
    for node in _marked(tree, _PICTURE):
        known.update(dict.fromkeys(_layers_of(tree, node, scene), node.image))
    ready = [node for node in _layer_nodes(tree, scene) if node.layer in known and node.id_data.is_editable]
    for layers in ready if before else ():
        for picture, over in _put_behind(tree, layers):
            picture.image = known[layers.layer]
            _note([over], before)


def remove(scene) -> bool:
    """Remove our nodes, reconnect links, restore what ``insert`` changed; return whether there were nodes."""
    tree = versions.compositor_tree(scene)
    if tree is None or not (_marked(tree, _OVER) or _marked(tree, _PICTURE)):
        return False
    before = _noted(tree)
    _take_out(tree)
    if "was_compositing" in before:
        scene.render.use_compositing = bool(before["was_compositing"])
    if "was_lock" in before:
        has_slices = any(one.rle_splat.is_slice for one in scene.objects)
        scene.render.use_lock_interface = bool(before["was_lock"]) or has_slices
    if before.get("was_tree") == "off":
        versions.switch_off_compositor(scene, discard=False)
    elif before.get("was_tree") == "none" and all(node.get(MARK) == _DEFAULT for node in tree.nodes):
        versions.switch_off_compositor(scene, discard=True)
    return True


def is_inserted(scene) -> bool:
    """Whether the scene's compositor holds nodes of ours."""
    tree = versions.compositor_tree(scene)
    return tree is not None and bool(_marked(tree, _OVER) or _marked(tree, _PICTURE))


def images_of(scene) -> list:
    """The images of our nodes that belong to the scene, whether they reach the render or not."""
    tree = versions.compositor_tree(scene)
    nodes = [] if tree is None else _marked(tree, _PICTURE)
    return list(dict.fromkeys(node.image for node in nodes if _is_ours(node.image, scene)))


def exchange_images(scene, exchange) -> None:
    """Replace the pictures in the scene's compositor, including those of other scenes, by ``exchange(image)``."""
    tree = versions.compositor_tree(scene)
    nodes = [] if tree is None else [one for one in _marked(tree, _PICTURE) if one.image and images.MARK in one.image]
    new = {image: exchange(image) for image in {node.image for node in nodes}}
    for node in nodes:
        node.image = new[node.image]


def pictures(scene) -> list[CompositedPicture]:
    """The pictures that reach the scene's render."""
    tree = versions.compositor_tree(scene)
    if tree is None or not scene.render.use_compositing:
        return []
    found = {}
    for node in _reaching(_results(tree)):
        if _is_ours(node.image, scene):
            found.setdefault(node.image, set()).update(_layers_of(tree, node, scene))
    return [CompositedPicture(image, frozenset(layers)) for image, layers in found.items()]


def problem(scene) -> str | None:
    """Why one of our pictures does not reach the scene's render."""
    tree = versions.compositor_tree(scene)
    if not scene.render.use_compositing:
        return ("Compositing is switched off in the output properties, so the volume is not in the render; switch it "
                "on, or turn Show in Renders off.")  # fmt: skip
    if tree is None:
        return f"The scene's compositor is switched off, so the volume is not in the render; {_AGAIN}."
    nodes, overs, reaching = _marked(tree, _PICTURE), _marked(tree, _OVER), _reaching(_results(tree))
    if not nodes or not (overs or reaching):
        return f"The volume's nodes were removed from the compositor; {_AGAIN}."
    for node in nodes:
        if node.image is None:
            return f"The image of the compositor's node {_title(node)} was deleted or removed; {_AGAIN}."
        if not _is_ours(node.image, scene):
            return (f"The compositor's node {_title(node)} holds the image {node.image.name!r}, which is not the "
                    f"volume's picture; {_AGAIN}.")  # fmt: skip
    if {node.image for node in nodes} != {node.image for node in reaching}:
        for node in [*nodes, *overs]:
            if node.mute:
                return (f"The compositor's node {_title(node)} is muted, so the volume is not in the render; unmute "
                        "it, or turn Show in Renders off.")  # fmt: skip
        return ("The volume's picture is not linked to the compositor's output, so it is not in the render; link it, "
                f"or {_AGAIN}.")  # fmt: skip
    for over in overs:
        factor = _factor(over)
        if not factor.is_linked and factor.default_value == 0.0:
            return (f"The factor of the compositor's node {_title(over)} is 0, so the volume is not in the render; "
                    "raise it, or turn Show in Renders off.")  # fmt: skip
    for socket in _results(tree):
        if _layers_behind([socket], scene, end=_is_over):
            return f"The compositor's node {_title(socket.node)} shows the render without the volume; {_AGAIN}."
    return None


def drop(image) -> None:
    """Delete one of our images if nothing uses it any more."""
    if image.users == 0:
        bpy.data.images.remove(image)


def _is_ours(image, scene) -> bool:
    """Whether an image is a picture of this scene; pictures of version 0.1.0 name no scene and always count."""
    return image is not None and images.MARK in image and (images.OWNER not in image or images.owned_by(image, scene))


def _noted(tree) -> dict:
    """What ``insert`` has changed, as our Alpha Overs hold it for ``remove``."""
    return {key: over[key] for over in _marked(tree, _OVER) for key in over.keys() if key.startswith("was_")}


def _note(overs, before: dict) -> None:
    for over in overs:
        for key, value in before.items():
            over[key] = value


def _title(node) -> str:
    return repr(node.label or node.name)


def _trees(tree) -> list:
    """A tree and the trees of all node groups in it."""
    found = [tree]
    for one in found:
        inner = [node.node_tree for node in one.nodes if node.type == "GROUP" and node.node_tree is not None]
        found.extend(group for group in dict.fromkeys(inner) if group not in found)
    return found


def _marked(tree, kind: str) -> list:
    """Our nodes of one kind in a tree and its node groups."""
    return [node for one in _trees(tree) for node in one.nodes if node.get(MARK) == kind]


def _colors(node):
    """The background and foreground inputs of an Alpha Over, found by order: names differ between versions."""
    background, foreground = [socket for socket in node.inputs if socket.type == "RGBA"][:2]
    return background, foreground


def _factor(over):
    """The factor input of an Alpha Over."""
    return next(socket for socket in over.inputs if socket.type == "VALUE")


def _results(tree) -> list:
    """The input sockets of the compositor's results: the color of its output, and of File Output nodes."""
    ends = [one for one in tree.nodes if one.bl_idname == versions.OUTPUT_NODE and not one.mute
            and getattr(one, "is_active_output", True)]  # fmt: skip
    found = [next((socket for socket in end.inputs if socket.type == "RGBA"), None) for end in ends]
    files = [one for one in tree.nodes if one.bl_idname == "CompositorNodeOutputFile" and not one.mute]
    return [socket for socket in found if socket is not None] + [socket for one in files for socket in one.inputs]


def _ends(tree) -> list:
    """The input sockets of all that shows something: the compositor's results and its viewers."""
    return _results(tree) + [
        one.inputs[0] for one in tree.nodes if one.bl_idname == "CompositorNodeViewer" and not one.mute
    ]


def _reaching(sockets) -> set:
    """Our Image nodes that are part of what some input sockets show."""
    return {node for node, _output, _holders in feeding(sockets) if node.get(MARK) == _PICTURE}


def _is_over(node) -> bool:
    return node.get(MARK) == _OVER


def _layers_behind(sockets, scene, end=None, links=None) -> list:
    """The Render Layers nodes whose Image is part of what input sockets show; ``end``, ``links``: see ``feeding``."""
    return [node for node, output, _holders in feeding(sockets, end=end, links=links)
            if _is_layer(node, scene) and output.identifier == "Image"]  # fmt: skip


def _layers_of(tree, picture, scene) -> set[str]:
    """Names of the view layers that a picture is composited over by our Alpha Overs, or else those of the result."""
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
    """The Render Layers nodes whose Image is part of what is shown, sorted by name."""
    return sorted(set(_layers_behind(_ends(tree), scene)), key=lambda node: node.name)


def _is_laid_out(tree, scene, names: set[str]) -> bool:
    """Whether our nodes are complete: each view layer has its picture, and all outputs show them."""
    nodes, overs, ends = _marked(tree, _PICTURE), _marked(tree, _OVER), _ends(tree)
    is_torn = len(nodes) != len(overs) or set(nodes) != _reaching(ends)
    if not nodes or is_torn or _layers_behind(ends, scene, end=_is_over):
        return False
    if len(names) < 2:
        return True
    layers = [_layers_of(tree, node, scene) for node in nodes]
    return all(len(own) == 1 for own in layers) and set().union(*layers) == names


def _add_pair(tree, x: float, y: float):
    """Add an Alpha Over at (x, y) with its Image node, not linked to other nodes; returns (Image node, Alpha Over)."""
    over = tree.nodes.new("CompositorNodeAlphaOver")
    picture = tree.nodes.new("CompositorNodeImage")
    over[MARK], picture[MARK] = _OVER, _PICTURE
    over.label, picture.label = "RLE Splat over Render", "RLE Splat"
    over.location, picture.location = (x, y), (x - 220.0, y - 220.0)
    foreground = _colors(over)[1]
    foreground.default_value = (0.0, 0.0, 0.0, 0.0)  # the default is white, which shows if the picture is unlinked
    tree.links.new(picture.outputs[0], foreground)
    return picture, over


def _lead_through(source, targets: list, after=()) -> list[tuple]:
    """Lead input sockets through an Alpha Over ``after`` their source, or a new one; return the new pairs.

    ``source``: None for a single input without a link, whose color the picture is over.
    """
    tree, made = targets[0].id_data, []
    if not after:
        node = targets[0].node if source is None else source.node
        made.append(_add_pair(tree, node.location.x + node.width + 40.0, node.location.y))
        after = made[0][1:]
        if source is None:
            _colors(after[0])[0].default_value = targets[0].default_value
        else:
            tree.links.new(source, _colors(after[0])[0])
    for target in targets:
        tree.links.new(after[0].outputs[0], target)
    return made


def _put_behind(tree, layers) -> list[tuple]:
    """Lead what shows the Image of a Render Layers node without the volume through Alpha Overs with pictures.

    Returns the new pairs (Image node, Alpha Over).
    """
    bare, covered, places = set(), set(), []
    _layers_behind(_ends(tree), layers.scene, _is_over, bare)
    list(feeding([_colors(over)[0] for over in _marked(tree, _OVER)], links=covered))
    todo = [layers.outputs["Image"]]
    for source in todo:
        after = [link.to_node for link in source.links if _is_over(link.to_node)]
        links = [link for link in source.links if link in bare - covered and link.to_node not in after]
        mixing = [link.to_node for link in links if _reads_passes(link.to_node, layers)]
        todo.extend(output for node in mixing for output in node.outputs if output.type == "RGBA")
        targets = [link.to_socket for link in links if link.to_node not in mixing]
        if targets and all(over.outputs[0].is_linked for over in after):  # one that leads nowhere was unplugged
            places.append((source, targets, after))
    # A new link may take the address of one in the sets.
    return [pair for place in places for pair in _lead_through(*place)]


def _reads_passes(node, layers) -> bool:
    """Whether a node reads other passes of a Render Layers node than its Image."""
    return any(link.from_node == layers and link.from_socket.identifier != "Image"
               for entry in node.inputs for link in entry.links)  # fmt: skip


def _result_socket(tree, scene):
    """The color input of the tree's output node; a missing output is created and linked to a Render Layers node."""
    outputs = [node for node in tree.nodes if node.bl_idname == versions.OUTPUT_NODE and not node.mute]
    outputs.sort(key=lambda node: not getattr(node, "is_active_output", True))
    versions.add_output_socket(tree)
    if outputs:
        return next(socket for socket in outputs[0].inputs if socket.type == "RGBA")
    layers = tree.nodes.new("CompositorNodeRLayers")
    layers.scene = scene
    output = tree.nodes.new(versions.OUTPUT_NODE)
    output.location = (520.0, 0.0)  # beyond an Alpha Over after the Render Layers node
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
        within.nodes.remove(over)
    for picture in _marked(tree, _PICTURE):
        picture.id_data.nodes.remove(picture)
