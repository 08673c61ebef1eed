"""Every difference between the Blender versions this extension runs in (4.5 LTS, 5.0, 5.2 LTS), and nothing else."""

import ctypes
import sys

import bpy

from ..rle_splat.scene import RleSplatError

# From 5.0 on the compositor of a scene is a node group of its own, ended by a Group Output; before, it is embedded
# in the scene and ended by a Composite node.
GROUP_COMPOSITOR = bpy.app.version >= (5, 0, 0)
OUTPUT_NODE = "NodeGroupOutput" if GROUP_COMPOSITOR else "CompositorNodeComposite"


def compositor_tree(scene):
    """The node tree that ``scene`` composites its renders with, or None."""
    if GROUP_COMPOSITOR:
        return scene.compositing_node_group
    return scene.node_tree if scene.use_nodes else None


def switch_on_compositor(scene):
    """The compositor tree of a scene that has none in force; new and empty unless the user had one switched off."""
    if GROUP_COMPOSITOR:
        tree = bpy.data.node_groups.new(f"{scene.name} Compositing", "CompositorNodeTree")
        scene.compositing_node_group = tree
        return tree
    had_tree = scene.node_tree is not None
    scene.use_nodes = True  # fills a new tree with default nodes of its own
    if not had_tree:
        scene.node_tree.nodes.clear()
    return scene.node_tree


def switch_off_compositor(scene, *, discard: bool) -> None:
    """Undo ``switch_on_compositor``; ``discard`` also drops what is in the tree."""
    if GROUP_COMPOSITOR:
        tree = scene.compositing_node_group
        scene.compositing_node_group = None
        if discard and tree.users == 0:
            bpy.data.node_groups.remove(tree)
    else:
        if discard:
            scene.node_tree.nodes.clear()
        scene.use_nodes = False


def add_output_socket(tree) -> None:
    """Give a compositor tree the color output without which it has no result."""
    if GROUP_COMPOSITOR and not any(
        item.item_type == "SOCKET" and item.in_out == "OUTPUT" and item.socket_type == "NodeSocketColor"
        for item in tree.interface.items_tree
    ):
        tree.interface.new_socket(name="Image", in_out="OUTPUT", socket_type="NodeSocketColor")


def unshare_compositor(scene) -> bool:
    """Give the scene a compositor tree of its own when other scenes use the same; whether that was needed."""
    if not GROUP_COMPOSITOR:
        return False
    tree = scene.compositing_node_group
    if tree is None or not any(s != scene and s.compositing_node_group == tree for s in bpy.data.scenes):
        return False
    scene.compositing_node_group = tree.copy()
    return True


def check_compositor_can_run(scene) -> None:
    """Raise a RleSplatError where a render with a compositor would abort the whole process.

    From 5.2 on the compositor runs on the graphics card unless told otherwise; a Linux machine without a window
    reaches it through libEGL, and Blender gives up without it.
    """
    if not (bpy.app.background and sys.platform == "linux" and scene.render.compositor_device == "GPU"):
        return
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError:
        raise RleSplatError(
            "The compositor is set to the graphics card, which Blender cannot reach without libEGL.so.1; install "
            "the package libegl1 or set the compositor's device to CPU in the render properties."
        ) from None


def world_is_nodes(world) -> bool:
    """Whether a world is what its nodes say, which from 5.0 on it always is; else it is its color."""
    return world.node_tree is not None and (bpy.app.version >= (5, 0) or world.use_nodes)
