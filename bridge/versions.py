"""All differences between the supported Blender versions (4.5 LTS, 5.0, 5.2 LTS, 5.3)."""

import ctypes
import sys

import bpy

from ..rle_splat.scene import RleSplatError

# From 5.0 on, the compositor of a scene is a separate node group that ends in a Group Output.  Before, it is embedded
# in the scene and ends in a Composite node.
GROUP_COMPOSITOR = bpy.app.version >= (5, 0, 0)
OUTPUT_NODE = "NodeGroupOutput" if GROUP_COMPOSITOR else "CompositorNodeComposite"

# From 5.3 on, a scene has a list of effects with a node group each, one after the other.
COMPOSITOR_EFFECTS = bpy.app.version >= (5, 3, 0)

# The index that a voxel's value is for, as Cycles places the grids of a VDB.
GRID_SAMPLE_AT = 0.5 if bpy.app.version < (5, 0) else 0.0


def _compositor_effect(scene):
    """The compositor effect that a scene's render enters, or None.

    An effect that has a Render Layers node drops what those before it have made.
    """
    effects = [effect for effect in scene.compositor_effects if effect.enable_for_render and effect.node_group]
    for effect in reversed(effects):
        if any(node.bl_idname == "CompositorNodeRLayers" for node in effect.node_group.nodes):
            return effect
    return effects[0] if effects else None


def compositor_tree(scene):
    """The compositor tree that a scene's render enters, or None."""
    if COMPOSITOR_EFFECTS:
        effect = _compositor_effect(scene)
        return None if effect is None else effect.node_group
    if GROUP_COMPOSITOR:
        return scene.compositing_node_group
    return scene.node_tree if scene.use_nodes else None


def switch_on_compositor(scene):
    """Activate a compositor tree for a scene without an active one, and return it.

    It is the user's tree if that was switched off, else a new empty one.
    """
    if GROUP_COMPOSITOR:
        tree = bpy.data.node_groups.new(f"{scene.name} Compositing", "CompositorNodeTree")
        if COMPOSITOR_EFFECTS:
            scene.compositor_effects.new(name="RLE Splat").node_group = tree
        else:
            scene.compositing_node_group = tree
        return tree
    had_tree = scene.node_tree is not None
    scene.use_nodes = True  # Blender adds default nodes to a new tree
    if not had_tree:
        scene.node_tree.nodes.clear()
    return scene.node_tree


def switch_off_compositor(scene, *, discard: bool) -> None:
    """Undo ``switch_on_compositor``; ``discard`` also deletes the nodes in the tree."""
    if GROUP_COMPOSITOR:
        tree = compositor_tree(scene)
        if COMPOSITOR_EFFECTS:
            scene.compositor_effects.remove(_compositor_effect(scene))
        else:
            scene.compositing_node_group = None
        if discard and tree.users == 0:
            bpy.data.node_groups.remove(tree)
    else:
        if discard:
            scene.node_tree.nodes.clear()
        scene.use_nodes = False


def add_output_socket(tree) -> None:
    """Add a color output to a compositor tree that has none; without it the tree has no result."""
    if GROUP_COMPOSITOR and not any(
        item.item_type == "SOCKET" and item.in_out == "OUTPUT" and item.socket_type == "NodeSocketColor"
        for item in tree.interface.items_tree
    ):
        tree.interface.new_socket(name="Image", in_out="OUTPUT", socket_type="NodeSocketColor")


def unshare_compositor(scene) -> bool:
    """Give the scene its own copy of a compositor tree that is used elsewhere too; return whether it was."""
    if not GROUP_COMPOSITOR:
        return False
    tree = compositor_tree(scene)
    if COMPOSITOR_EFFECTS:
        holder, name = _compositor_effect(scene), "node_group"
        trees = [effect.node_group for one in bpy.data.scenes for effect in one.compositor_effects]
    else:
        holder, name = scene, "compositing_node_group"
        trees = [one.compositing_node_group for one in bpy.data.scenes]
    if tree is None or trees.count(tree) < 2:
        return False
    setattr(holder, name, tree.copy())
    return True


def check_compositor_can_run(scene) -> None:
    """Check that a render with a compositor does not abort the process.

    From 5.2 on the compositor runs on the GPU by default.  On Linux without a window Blender needs libEGL for that, and
    aborts if it is missing.

    Raises
    ------
    RleSplatError
        If libEGL is missing and needed.
    """
    if not (bpy.app.background and sys.platform == "linux" and scene.render.compositor_device == "GPU"):
        return
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError:
        raise RleSplatError(
            "The compositor is set to run on the GPU, which Blender cannot use here without libEGL.so.1; install the "
            "package libegl1, or set the compositor's device to CPU in the render properties."
        ) from None


def material_tree(material):
    """The node tree of a material, which is always there from 5.0 on."""
    if material.node_tree is None:
        material.use_nodes = True
    return material.node_tree


def world_is_nodes(world) -> bool:
    """Whether a world uses its nodes (from 5.0 on always) instead of its plain color."""
    return world.node_tree is not None and (bpy.app.version >= (5, 0) or world.use_nodes)


def use_movie(render) -> None:
    """Have an animation written as an MP4 with the codec H.264 and without sound.

    Raises
    ------
    RleSplatError
        If this Blender was built without FFmpeg.
    """
    if not bpy.app.ffmpeg.supported:
        raise RleSplatError("This Blender was built without FFmpeg, so it writes no MP4 files; write pictures.")
    _choose_medium(render, "VIDEO")
    render.image_settings.file_format = "FFMPEG"
    render.image_settings.color_mode = "RGB"
    movie = render.ffmpeg
    movie.format, movie.codec, movie.audio_codec = "MPEG4", "H264", "NONE"
    movie.constant_rate_factor, movie.ffmpeg_preset = "HIGH", "GOOD"
    movie.gopsize, movie.use_max_b_frames, movie.use_autosplit = 18, False, False


def use_pictures(render, file_format: str) -> None:
    """Have an animation written as pictures with transparency.

    "PNG" has 8 bits with the view transform, "OPEN_EXR" 32 bits, scene-linear.
    """
    _choose_medium(render, "IMAGE")
    settings = render.image_settings
    settings.file_format, settings.color_mode = file_format, "RGBA"
    settings.color_depth = "8" if file_format == "PNG" else "32"


def _choose_medium(render, medium: str) -> None:
    """From 5.0 on, the formats to choose from depend on the kind of medium."""
    if hasattr(render.image_settings, "media_type"):
        render.image_settings.media_type = medium
