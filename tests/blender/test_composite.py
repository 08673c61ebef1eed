"""Show in Renders, through Cycles: predicted pixels with meshes before, inside and behind a volume whose
light is known in closed form, and a compositor that keeps what its owner put there.

The volume is a uniform cube of N voxels at unit spacing.  Zero-padded, as its truth says, each voxel's tent adds
one unit of length, so a ray along an axis meets N units in all, and from the top face down to height z in the
medium (0 <= z <= N - 1) it meets N - 1/2 - z: half a unit in the ramp above the face, the rest below it.
"""

import json
import shutil
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy", "classified_first")

N = 9
ALPHA = 0.08  # per world unit
COLOR = (0.9, 0.5, 0.2)
VIEW = 12.0  # world units across the picture
TOLERANCE = 1.0 / 255.0


@pytest.fixture
def volume(tmp_path):
    owner = scenes.even_cube(tmp_path, N, ALPHA, COLOR)
    scenes.use_cycles()
    middle = (N - 1) / 2
    scenes.add_camera((middle, middle, 30.0), type="ORTHO", ortho_scale=VIEW)
    settings = bpy.context.scene.rle_splat
    settings.quality = "fine"
    return owner


def column_of(x):
    """The column that holds world x: 64 pixels over VIEW units about the middle of the volume."""
    return int((x - (N - 1) / 2) / VIEW * 64 + 32)


def over(length, below=(0.0, 0.0, 0.0), below_alpha=0.0):
    """RGBA of ``length`` units of the medium over what is below."""
    alpha = 1.0 - (1.0 - ALPHA) ** length
    rgb = alpha * np.array(COLOR) + (1.0 - alpha) * np.array(below)
    return np.array((*rgb, alpha + (1.0 - alpha) * below_alpha))


def strip(x0, x1, z, color, y0=-2.0, y1=10.0):
    """A rectangle at height z that emits ``color``."""
    return scenes.add_mesh(
        [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], [(0, 1, 2, 3)], color, name=f"strip at {z}"
    )


def color_inputs(node):
    return [socket for socket in node.inputs if socket.type == "RGBA"]


def links_of(tree):
    return sorted((link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier)
                  for link in tree.links)  # fmt: skip


def make_user_tree(versions):
    """A compositor that multiplies the render by two; returns the tree and its links."""
    scene = bpy.context.scene
    tree = versions.switch_on_compositor(scene)
    versions.add_output_socket(tree)
    layers = tree.nodes.new("CompositorNodeRLayers")
    layers.scene = scene
    exposure = tree.nodes.new("CompositorNodeExposure")
    exposure.inputs["Exposure"].default_value = 1.0
    output = tree.nodes.new(versions.OUTPUT_NODE)
    tree.links.new(layers.outputs["Image"], exposure.inputs[0])
    tree.links.new(exposure.outputs[0], color_inputs(output)[0])
    return tree, links_of(tree)


def test_meshes_in_front_inside_and_behind(volume, tmp_path):
    front, inside, cut, behind = (1.0, 0.1, 0.1), (0.1, 1.0, 0.1), (0.6, 0.6, 0.1), (0.1, 0.1, 1.0)
    strip(0.0, 1.5, 15.0, front)
    strip(2.0, 3.5, 4.0, inside)
    strip(4.0, 5.5, 2.3, cut)  # between two slices: a fractional last slab
    strip(6.0, 7.0, -5.0, behind)
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    picture = scenes.rendered(tmp_path / "out.exr")

    expected = {0.8: over(0.0, front, 1.0), 2.8: over(N - 0.5 - 4.0, inside, 1.0),
                4.8: over(N - 0.5 - 2.3, cut, 1.0), 6.5: over(N, behind, 1.0), 7.5: over(N)}  # fmt: skip
    for x, rgba in expected.items():
        np.testing.assert_allclose(picture[32, column_of(x)], rgba, atol=TOLERANCE, err_msg=f"at x = {x}")
    assert np.abs(picture[2, 2]).max() == 0.0  # beside the volume


def test_holdouts_hide_the_volume_behind_them_and_show_nothing_of_themselves(volume, tmp_path):
    """An object that is a holdout, and one in a collection that the view layer holds out."""
    own = strip(2.0, 3.5, 4.0, (0.1, 1.0, 0.1))
    own.is_holdout = True
    by_layer = strip(4.0, 5.5, 2.3, (0.6, 0.6, 0.1))
    collection = bpy.data.collections.new("held out")
    bpy.context.scene.collection.children.link(collection)
    bpy.context.scene.collection.objects.unlink(by_layer)
    collection.objects.link(by_layer)
    bpy.context.view_layer.layer_collection.children["held out"].holdout = True
    strip(-2.0, 10.0, -5.0, (0.1, 0.1, 1.0))  # behind all
    bpy.ops.rle_splat.show_in_renders()
    picture = scenes.rendered(tmp_path / "out.exr")
    for x, rgba in {2.8: over(N - 0.5 - 4.0), 4.8: over(N - 0.5 - 2.3), 7.5: over(N, (0.1, 0.1, 1.0), 1.0)}.items():
        np.testing.assert_allclose(picture[32, column_of(x)], rgba, atol=TOLERANCE, err_msg=f"at x = {x}")


def test_a_silhouette_inside_the_volume_is_antialiased(volume, tmp_path):
    pixel = VIEW / 64
    covered = 6 / 16  # of column 40
    strip(0.0, 4.0 + (40 + covered - 32) * pixel, 4.0, (0.0, 0.0, 0.0))
    bpy.ops.rle_splat.show_in_renders()
    scenes.rendered(tmp_path / "out.exr")
    alpha = scenes.image_pixels(bpy.context.scene.rle_splat.composite_image)[32, :, 3]
    near, far = over(N - 0.5 - 4.0)[3], over(N)[3]
    np.testing.assert_allclose(alpha[39], near, atol=TOLERANCE)
    np.testing.assert_allclose(alpha[41], far, atol=TOLERANCE)
    np.testing.assert_allclose(alpha[40], covered * near + (1 - covered) * far, atol=TOLERANCE)


def test_hidden_and_instanced_meshes(volume, tmp_path):
    """Only what the render shows cuts the volume: instances do, objects hidden from renders or the camera do not."""
    hidden = strip(0.0, 2.0, 4.0, (1.0, 1.0, 1.0))
    hidden.hide_render = True
    unseen = strip(2.0, 4.0, 4.0, (1.0, 1.0, 1.0))
    unseen.visible_camera = False
    source = strip(-1.5, 0.5, 0.0, (0.0, 0.0, 1.0))
    collection = bpy.data.collections.new("instanced")
    collection.objects.link(source)
    bpy.context.scene.collection.objects.unlink(source)
    instancer = bpy.data.objects.new("instancer", None)
    instancer.instance_type, instancer.instance_collection = "COLLECTION", collection
    instancer.location = (6.0, 0.0, 3.0)
    bpy.context.scene.collection.objects.link(instancer)
    bpy.ops.rle_splat.show_in_renders()
    picture = scenes.rendered(tmp_path / "out.exr")
    np.testing.assert_allclose(picture[32, column_of(1.0)], over(N), atol=TOLERANCE)
    np.testing.assert_allclose(picture[32, column_of(3.0)], over(N), atol=TOLERANCE)
    np.testing.assert_allclose(picture[32, column_of(5.5)], over(N - 0.5 - 3.0, (0.0, 0.0, 1.0), 1.0), atol=TOLERANCE)


def test_render_settings_of_modifiers_count(volume, tmp_path):
    """The mesh that is met is the render's own: here a modifier that only renders moves it."""
    mesh_object = strip(0.0, 8.0, 20.0, (0.0, 1.0, 0.0))
    modifier = mesh_object.modifiers.new("down", "DISPLACE")
    modifier.direction, modifier.mid_level, modifier.strength = "Z", 0.0, -16.0
    modifier.show_viewport, modifier.show_render = False, True
    bpy.ops.rle_splat.show_in_renders()
    picture = scenes.rendered(tmp_path / "out.exr")
    np.testing.assert_allclose(picture[32, 32], over(N - 0.5 - 4.0, (0.0, 1.0, 0.0), 1.0), atol=TOLERANCE)


def test_the_users_nodes_stay(volume, bridge, tmp_path):
    tree, before = make_user_tree(bridge("versions"))
    names = sorted(node.name for node in tree.nodes)
    strip(-2.0, 10.0, -5.0, (0.2, 0.2, 0.2), -4.0, 12.0)

    bpy.ops.rle_splat.show_in_renders()
    once = links_of(tree)
    bpy.ops.rle_splat.show_in_renders()
    assert links_of(tree) == once and len(tree.nodes) == len(names) + 2
    picture = scenes.rendered(tmp_path / "out.exr")
    expected = np.array((2.0, 2.0, 2.0, 1.0)) * over(N, (0.2, 0.2, 0.2), 1.0)
    np.testing.assert_allclose(picture[32, 32], expected, atol=2.0 * TOLERANCE)

    assert bpy.ops.rle_splat.remove_from_renders() == {"FINISHED"}
    assert links_of(tree) == before and sorted(node.name for node in tree.nodes) == names
    assert bridge("versions").compositor_tree(bpy.context.scene) == tree
    np.testing.assert_allclose(scenes.rendered(tmp_path / "out.exr")[32, 32], (0.4, 0.4, 0.4, 1.0), atol=1e-5)


def add_file_output(tree, folder):
    """A File Output node with one color, written to ``folder`` as 32-bit EXR; returns its input."""
    node = tree.nodes.new("CompositorNodeOutputFile")
    if bpy.app.version >= (5, 0):
        node.directory, node.file_name = str(folder), "file"
        node.file_output_items.new("RGBA", "Image")
        node.format.media_type = "IMAGE"
    else:
        node.base_path = str(folder)
    node.format.file_format, node.format.color_mode, node.format.color_depth = "OPEN_EXR", "RGBA", "32"
    return color_inputs(node)[0]


def test_the_volume_alone_is_a_layer_for_a_file_output(volume, bridge, tmp_path):
    """What the Image node holds in a render: the volume without what meshes hide, premultiplied; grading it by a node
    before Alpha Over leaves the meshes alone."""
    strip(-2.0, (N - 1) / 2, 20.0, (0.2, 0.2, 0.2), -4.0, 12.0)
    bpy.ops.rle_splat.show_in_renders()
    tree = bridge("versions").compositor_tree(bpy.context.scene)
    alone = next(node for node in tree.nodes if node.label == "RLE Splat")
    behind = alone.outputs["Image"].links[0].to_socket
    (tmp_path / "layer").mkdir()
    tree.links.new(alone.outputs["Image"], add_file_output(tree, tmp_path / "layer"))
    brighter = tree.nodes.new("CompositorNodeExposure")
    brighter.inputs["Exposure"].default_value = 1.0
    tree.links.new(alone.outputs["Image"], brighter.inputs["Image"])
    tree.links.new(brighter.outputs[0], behind)
    picture = scenes.rendered(tmp_path / "out.exr")
    (file,) = (tmp_path / "layer").glob("*.exr")
    layer = scenes.load_pixels(file)
    hidden, seen = column_of(1.0), column_of(N - 2.0)
    np.testing.assert_allclose(layer[32, hidden], 0.0, atol=1e-5)
    np.testing.assert_allclose(layer[32, seen], over(N), atol=2.0 * TOLERANCE)
    np.testing.assert_allclose(picture[32, hidden, :3], 0.2, atol=1e-3)
    np.testing.assert_allclose(picture[32, seen, :3], 2.0 * over(N)[:3], atol=4.0 * TOLERANCE)


@pytest.mark.parametrize("wired", ("before", "after", "after, by a script", "after, with a muted link"))
@pytest.mark.parametrize("way", ("directly", "through Invert", "from another node"))
def test_all_outputs_that_show_the_render_show_the_volume(volume, bridge, tmp_path, wired, way):
    """Outputs that are wired to the Render Layers before and after the volume is included; removing restores them."""
    versions, scene = bridge("versions"), bpy.context.scene
    tree, links = make_user_tree(versions)
    layers = next(node for node in tree.nodes if node.bl_idname == "CompositorNodeRLayers")
    invert, viewer = tree.nodes.new("CompositorNodeInvert"), tree.nodes.new("CompositorNodeViewer")
    target = add_file_output(tree, tmp_path)

    def wire():
        earlier, source = links_of(tree), layers.outputs["Image"]
        if way == "from another node":
            another = tree.nodes.new("CompositorNodeRLayers")
            another.scene = scene
            source = another.outputs["Image"]
        if way == "through Invert":
            tree.links.new(source, color_inputs(invert)[0])
            source = invert.outputs[0]
        first = tree.links.new(source, target)
        first.is_muted = wired.endswith("muted link")
        tree.links.new(source, viewer.inputs[0])
        links.extend(one for one in links_of(tree) if one not in earlier)
        if first.is_muted:
            bpy.context.view_layer.update()  # a link that carries nothing stays
            first.is_muted = False

    if wired == "before":
        wire()
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    if wired != "before":
        wire()
    if wired != "after, by a script":
        bpy.context.view_layer.update()
        shown = bridge("render.compositor_paths").feeding([viewer.inputs[0]])
        assert [node for node, _output, _holders in shown if node.bl_idname == "CompositorNodeImage"]
    for _ in range(2):
        scenes.rendered(tmp_path / "out.exr")
        (found,) = [path for path in tmp_path.glob("*.exr") if path.name != "out.exr"]
        np.testing.assert_allclose(scenes.load_pixels(found)[32, 32, 3], over(N)[3], atol=TOLERANCE)
        assert scene.rle_splat.render_problem == ""
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    assert bpy.ops.rle_splat.remove_from_renders() == {"FINISHED"}
    assert links_of(tree) == sorted(links)


def test_the_picture_comes_after_nodes_that_mix_passes(volume, bridge, tmp_path):
    """Set Alpha takes the alpha of the Render Layers, which knows nothing of the volume."""
    tree, _ = make_user_tree(bridge("versions"))
    layers, exposure = (next(node for node in tree.nodes if node.bl_idname == f"CompositorNode{kind}")
                        for kind in ("RLayers", "Exposure"))  # fmt: skip
    mixed = tree.nodes.new("CompositorNodeSetAlpha")
    tree.links.new(layers.outputs["Image"], mixed.inputs["Image"])
    tree.links.new(layers.outputs["Alpha"], mixed.inputs["Alpha"])
    tree.links.new(mixed.outputs[0], exposure.inputs[0])
    before = links_of(tree)
    bpy.ops.rle_splat.show_in_renders()
    np.testing.assert_allclose(scenes.rendered(tmp_path / "out.exr")[32, 32, 3], over(N)[3], atol=TOLERANCE)
    bpy.ops.rle_splat.remove_from_renders()
    assert links_of(tree) == before


def test_an_output_that_lacks_the_volume_is_said(volume, bridge, tmp_path):
    """A node before ours that the user put there, and that feeds a file, too."""
    tree, _ = make_user_tree(bridge("versions"))
    bpy.ops.rle_splat.show_in_renders()
    exposure, over_node = (next(node for node in tree.nodes if node.bl_idname == f"CompositorNode{kind}")
                           for kind in ("Exposure", "AlphaOver"))  # fmt: skip
    target, source = exposure.outputs[0].links[0].to_socket, color_inputs(over_node)[0].links[0].from_socket
    tree.links.new(exposure.outputs[0], color_inputs(over_node)[0])
    tree.links.new(over_node.outputs[0], target)
    tree.links.new(source, exposure.inputs[0])
    tree.links.new(exposure.outputs[0], add_file_output(tree, tmp_path))
    scenes.rendered(tmp_path / "out.exr")
    assert bpy.context.scene.rle_splat.render_problem == (
        "The compositor's node 'File Output' shows the render without the volume; turn Show in Renders off and on."
    )
    bpy.ops.rle_splat.show_in_renders()
    scenes.rendered(tmp_path / "out.exr")
    (found,) = [path for path in tmp_path.glob("*.exr") if path.name != "out.exr"]
    assert bpy.context.scene.rle_splat.render_problem == ""
    np.testing.assert_allclose(scenes.load_pixels(found)[32, 32, 3], over(N)[3], atol=TOLERANCE)


def test_torn_nodes_are_mended(volume, bridge, tmp_path):
    tree, before = make_user_tree(bridge("versions"))
    bpy.ops.rle_splat.show_in_renders()
    whole = links_of(tree)
    picture_node = next(node for node in tree.nodes if node.bl_idname == "CompositorNodeImage")
    tree.nodes.remove(picture_node)
    bpy.ops.rle_splat.show_in_renders()
    assert len(links_of(tree)) == len(whole)
    expected = np.array((2.0, 2.0, 2.0, 1.0)) * over(N)
    np.testing.assert_allclose(scenes.rendered(tmp_path / "out.exr")[32, 32], expected, atol=2.0 * TOLERANCE)
    bpy.ops.rle_splat.remove_from_renders()
    assert links_of(tree) == before


def test_without_a_compositor_one_is_made_and_taken_away(volume, bridge):
    versions, scene = bridge("versions"), bpy.context.scene
    scene.render.use_lock_interface = False
    assert versions.compositor_tree(scene) is None
    bpy.ops.rle_splat.show_in_renders()
    assert versions.compositor_tree(scene) is not None
    assert scene.render.use_lock_interface
    bpy.ops.rle_splat.remove_from_renders()
    assert versions.compositor_tree(scene) is None
    assert not scene.render.use_lock_interface
    assert not bpy.ops.rle_splat.remove_from_renders.poll()


def test_an_unlinked_output_keeps_its_color(volume, bridge, tmp_path):
    versions, scene = bridge("versions"), bpy.context.scene
    tree = versions.switch_on_compositor(scene)
    versions.add_output_socket(tree)
    output = tree.nodes.new(versions.OUTPUT_NODE)
    color_inputs(output)[0].default_value = (0.0, 0.3, 0.0, 1.0)
    bpy.ops.rle_splat.show_in_renders()
    over_node = next(node for node in tree.nodes if node.bl_idname == "CompositorNodeAlphaOver")
    assert tuple(color_inputs(over_node)[0].default_value) == pytest.approx((0.0, 0.3, 0.0, 1.0))
    bpy.ops.rle_splat.remove_from_renders()
    assert tuple(color_inputs(output)[0].default_value) == pytest.approx((0.0, 0.3, 0.0, 1.0))


@pytest.mark.skipif(bpy.app.version < (5, 0, 0), reason="compositors can be shared from 5.0 on")
def test_a_compositor_shared_with_another_scene_is_copied(volume, bridge):
    tree, before = make_user_tree(bridge("versions"))
    other = bpy.data.scenes.new("other")
    other.compositing_node_group = tree
    bpy.ops.rle_splat.show_in_renders()
    assert other.compositing_node_group == tree and links_of(tree) == before
    assert bpy.context.scene.compositing_node_group != tree


@pytest.mark.skipif(bpy.app.version < (5, 3, 0), reason="a scene has one compositor tree")
def test_of_several_effects_the_first_gets_the_picture(volume, bridge):
    """Those behind it change the picture with the render; an effect that is off for renders is left alone."""
    versions, effects = bridge("versions"), bpy.context.scene.compositor_effects
    off, first, second = (effects.new(name=name) for name in ("off", "first", "second"))
    off.enable_for_render = False
    trees = {}
    for effect in (off, first, second):
        tree = trees[effect.name] = effect.node_group = bpy.data.node_groups.new(effect.name, "CompositorNodeTree")
        versions.add_output_socket(tree)
        tree.interface.new_socket(name="Image", in_out="INPUT", socket_type="NodeSocketColor")
        begin = tree.nodes.new("NodeGroupInput" if effect == second else "CompositorNodeRLayers")
        tree.links.new(begin.outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])
    counts = {name: len(tree.nodes) for name, tree in trees.items()}
    bpy.ops.rle_splat.show_in_renders()
    assert {name for name, tree in trees.items() if len(tree.nodes) > counts[name]} == {"first"}
    bpy.ops.rle_splat.remove_from_renders()
    assert {name: len(tree.nodes) for name, tree in trees.items()} == counts


@pytest.mark.skipif(bpy.app.version < (5, 3, 0), reason="a scene has one compositor tree")
def test_where_all_effects_are_off_one_is_made_and_taken_away(volume):
    effects = bpy.context.scene.compositor_effects
    off = effects.new(name="off")
    off.node_group, off.enable_for_render = bpy.data.node_groups.new("off", "CompositorNodeTree"), False
    groups = set(bpy.data.node_groups)
    bpy.ops.rle_splat.show_in_renders()
    assert [effect.name for effect in effects] == ["off", "RLE Splat"] and not off.node_group.nodes
    bpy.ops.rle_splat.remove_from_renders()
    assert [effect.name for effect in effects] == ["off"] and set(bpy.data.node_groups) == groups


def test_the_picture_follows_the_render_size_and_region(volume, tmp_path):
    strip(2.0, 3.5, 4.0, (0.1, 1.0, 0.1))
    bpy.ops.rle_splat.show_in_renders()
    render = bpy.context.scene.render
    whole = scenes.rendered(tmp_path / "whole.exr")
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x = 16 / 64, 56 / 64
    render.border_min_y, render.border_max_y = 8 / 64, 40 / 64
    part = scenes.rendered(tmp_path / "part.exr")
    assert part.shape == (32, 40, 4)
    np.testing.assert_allclose(part, whole[24:56, 16:56], atol=1e-5)
    render.use_border = False
    render.resolution_percentage = 50
    half = scenes.rendered(tmp_path / "half.exr")
    assert half.shape == (32, 32, 4)
    np.testing.assert_allclose(half[16, column_of(7.5) // 2], over(N), atol=TOLERANCE)


def test_a_cropped_render_region_is_splatted_alone_and_to_the_bit(volume):
    """The picture that is laid over the render: the same pixels as of the whole frame, from a part of the sheets."""
    bpy.ops.rle_splat.show_in_renders()
    scene = bpy.context.scene
    render, settings = scene.render, scene.rle_splat

    def splatted():
        bpy.ops.render.render()
        width, height = settings.composite_image.size
        pixels = np.empty(4 * width * height, np.float32)
        settings.composite_image.pixels.foreach_get(pixels)
        return pixels.reshape(height, width, 4)[::-1], json.loads(settings.last_report_json)

    strip(2.0, 3.5, 4.0, (0.1, 1.0, 0.1))
    whole, report = splatted()
    assert "crop" not in report["image"] and whole[..., 3].max() > 0.3
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x = 20 / 64, 50 / 64
    render.border_min_y, render.border_max_y = 30 / 64, 41 / 64
    part, cropped = splatted()
    np.testing.assert_array_equal(part, whole[23:34, 20:50])
    assert cropped["image"]["crop"] == [20, 23, 50, 34] and cropped["image"]["full_width"] == 64
    rows = [sum(plane["height"] for plane in r["plan"]["base_planes"]) for r in (report, cropped)]
    assert rows[1] < rows[0]


def test_a_render_region_that_is_not_cropped(volume, tmp_path):
    bpy.ops.rle_splat.show_in_renders()
    render = bpy.context.scene.render
    render.use_border, render.use_crop_to_border = True, False
    render.border_min_x, render.border_max_x = 16 / 64, 56 / 64
    render.border_min_y, render.border_max_y = 8 / 64, 40 / 64
    picture = scenes.rendered(tmp_path / "part.exr")
    assert picture.shape == (64, 64, 4)
    np.testing.assert_allclose(picture[32, 40], over(N), atol=TOLERANCE)


def test_a_hidden_volume_is_not_composited(volume, tmp_path):
    bpy.ops.rle_splat.show_in_renders()
    assert scenes.rendered(tmp_path / "seen.exr")[32, 32, 3] > 0.3
    volume.hide_render = True
    assert np.abs(scenes.rendered(tmp_path / "hidden.exr")).max() == 0.0


def test_removing_a_composite_leaves_no_picture_behind(volume, bridge):
    def pictures():
        return [image for image in bpy.data.images if bridge("pictures.images").MARK in image]

    for _ in range(3):
        bpy.ops.rle_splat.show_in_renders()
        assert len(pictures()) == 1
        bpy.ops.rle_splat.remove_from_renders()
        assert pictures() == []


def test_without_a_composite_renders_are_left_alone(volume, tmp_path):
    strip(-2.0, 10.0, -5.0, (0.2, 0.3, 0.4), -4.0, 12.0)
    np.testing.assert_allclose(scenes.rendered(tmp_path / "out.exr")[32, 32], (0.2, 0.3, 0.4, 1.0), atol=1e-5)
    assert bpy.context.scene.rle_splat.last_report_json == ""


def test_over_a_world(volume, tmp_path):
    scenes.use_cycles(transparent=False)
    scenes.gray_world(0.5)
    bpy.ops.rle_splat.show_in_renders()
    picture = scenes.rendered(tmp_path / "out.exr")
    np.testing.assert_allclose(picture[32, 32], over(N, (0.5, 0.5, 0.5), 1.0), atol=TOLERANCE)


def test_a_compositor_saved_by_version_0_1_0_goes_on(bridge, tmp_path):
    """Its picture is found through its node and drawn, and Composite makes no other."""
    shutil.copytree(Path(__file__).parent / "data", tmp_path / "data")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "data/saved_by_0_1_0.blend"))
    scene = scenes.use_cycles((16, 16))
    tree, image = bridge("versions").compositor_tree(scene), scene.rle_splat.composite_image
    before = scenes.rendered(tmp_path / "out.exr")
    assert scene.rle_splat.message == "" and 0.0 < before[..., 3].max() <= 1.0
    np.testing.assert_allclose(scenes.image_pixels(image), before, atol=1e-6)
    nodes = len(tree.nodes)
    bpy.context.view_layer.objects.active = scene.rle_splat.composite_object
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    assert len(tree.nodes) == nodes and scene.rle_splat.composite_image == image
    np.testing.assert_array_equal(scenes.rendered(tmp_path / "out.exr"), before)
    assert bpy.ops.rle_splat.remove_from_renders() == {"FINISHED"} and not bridge("render.compositor").is_inserted(
        scene
    )
