"""Renders of every kind: other engines, Freestyle, scene strips, several scenes, and compositors of the user's own.

The cube's middle is red at an opacity that all engines must show alike, for none of them draws it.
"""

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

MIDDLE = 1.0 - 0.7**6  # opacity of six units of the cube


@pytest.fixture
def owner(addon, tmp_path):
    return scenes.cube_scene(tmp_path)


def holds_the_cube(picture, moved=(0.0, 0.0)):
    """Assert that a render shows the red cube, moved by so many columns and rows."""
    np.testing.assert_allclose(scenes.shown_at(picture), np.array((12.0, 12.0)) + moved, atol=0.1)
    column, row = (12 + int(shift) for shift in moved)
    np.testing.assert_allclose(picture[row, column], (*(MIDDLE * np.array(scenes.RED)), MIDDLE), atol=0.01)


def without_noise(engine):
    """Choose an engine of those that draw on the graphics card, with one sample."""
    scenes.skip_without_graphics()
    scene = bpy.context.scene
    scene.render.engine = engine
    scene.eevee.taa_render_samples = 1
    scene.display.render_aa = "OFF"


@pytest.mark.deep  # it compiles shaders for a quarter of a minute in each Blender; the newest has it in every run
def test_B86_eevee(owner, tmp_path):
    without_noise("BLENDER_EEVEE" if bpy.app.version >= (5, 0) else "BLENDER_EEVEE_NEXT")
    bpy.ops.rle_splat.show_in_renders()
    holds_the_cube(scenes.rendered(tmp_path / "out.exr"))


def test_B87_workbench(owner, tmp_path):
    without_noise("BLENDER_WORKBENCH")
    bpy.ops.rle_splat.show_in_renders()
    holds_the_cube(scenes.rendered(tmp_path / "out.exr"))


def test_B88_freestyle(owner, tmp_path):
    scene, layer = bpy.context.scene, bpy.context.view_layer
    scenes.add_mesh([(7.5, -2, 0), (8.5, -2, 0), (8.5, 8, 0), (7.5, 8, 0)], [(0, 1, 2, 3)], (0.0, 1.0, 0.0))
    bpy.ops.rle_splat.show_in_renders()
    plain = scenes.rendered(tmp_path / "plain.exr")
    scene.render.use_freestyle = layer.use_freestyle = True
    lines = layer.freestyle_settings.linesets.new("lines")
    lines.linestyle = bpy.data.linestyles.new("blue")
    lines.linestyle.color, lines.linestyle.thickness = (0.0, 0.0, 1.0), 2.0
    lined = scenes.rendered(tmp_path / "lined.exr")
    assert lined[:, 19:, 2].max() > 0.5 and plain[:, 19:, 2].max() < 0.1
    np.testing.assert_allclose(lined[:, :19], plain[:, :19], atol=1e-5)
    assert scene.rle_splat.message == ""


def second_scene(owner, shift):
    """Another scene with a copy of the volume, moved by so many units, and its own camera; composited."""
    first = bpy.context.scene
    second = bpy.data.scenes.new("second")
    copy = owner.copy()
    copy.location.x += shift
    camera = first.camera.copy()
    for one in (copy, camera):
        second.collection.objects.link(one)
    second.camera = camera
    second.rle_splat.scene_scale, second.rle_splat.quality = 1.0, "standard"
    for scene in (first, second):
        with scenes.in_scene(scene):
            scenes.use_cycles((24, 24))
            scenes.activate(next(one for one in scene.objects if one.rle_splat.is_volume))
            assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    return first, second


def rendered_scene(scene, path):
    with scenes.in_scene(scene):
        return scenes.rendered(path, scene=scene.name)


def test_B89_scene_strips(owner, tmp_path):
    first, second = second_scene(owner, 1.0)
    edit = bpy.data.scenes.new("edit")
    edit.frame_start, edit.frame_end = 1, 2
    for number, scene in enumerate((first, second), start=1):
        scene.frame_start = scene.frame_end = 1
        edit.sequence_editor_create().strips.new_scene(scene.name, scene, channel=1, frame_start=number)
    with scenes.in_scene(edit):
        scenes.use_cycles((24, 24))
    for frame, shift in ((1, 0.0), (2, 2.0)):
        edit.frame_set(frame)
        picture = rendered_scene(edit, tmp_path / f"{frame}.exr")
        np.testing.assert_allclose(scenes.shown_at(picture), (12.0 + shift, 12.0), atol=0.1)


def test_B90_two_scenes_in_turn(owner, tmp_path):
    first, second = second_scene(owner, 1.0)
    for scene, shift in ((first, 0.0), (second, 2.0), (first, 0.0)):
        holds_the_cube(rendered_scene(scene, tmp_path / "out.exr"), (shift, 0.0))
        assert scene.rle_splat.message == ""
    assert first.rle_splat.composite_image != second.rle_splat.composite_image


def test_B94_a_render_of_another_scene_than_the_windows(owner, tmp_path):
    first, second = second_scene(owner, 1.0)
    with scenes.in_scene(second):
        scenes.write_exr(tmp_path / "second.exr")
    assert bpy.context.scene == first
    bpy.ops.render.render(write_still=True, scene="second")
    holds_the_cube(scenes.load_pixels(tmp_path / "second.exr"), (2.0, 0.0))


OUTPUT = "NodeGroupOutput" if bpy.app.version >= (5, 0) else "CompositorNodeComposite"


def users_tree(scene):
    """A compositor of the user's: Render Layers, doubled, into the output; (tree, its output)."""
    if bpy.app.version >= (5, 0):
        tree = bpy.data.node_groups.new("user's", "CompositorNodeTree")
        tree.interface.new_socket(name="Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        scene.compositing_node_group = tree
    else:
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
    layers, output = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new(OUTPUT)
    layers.scene = scene
    doubled = insert(tree, layers.outputs["Image"], 1.0)
    tree.links.new(doubled.outputs[0], output.inputs[0])
    return tree, output


def insert(tree, source, exposure):
    """A new Exposure node after a socket."""
    node = tree.nodes.new("CompositorNodeExposure")
    node.inputs["Exposure"].default_value = exposure
    tree.links.new(source, node.inputs[0])
    return node


def links_of(tree):
    return sorted((link.from_node.name, link.to_node.name) for link in tree.links)


def test_B91_nodes_after_ours(owner, tmp_path):
    """The user's nodes double, and between ours and the output halve, render and volume alike."""
    scenes.add_mesh([(-9, -9, -5), (15, -9, -5), (15, 15, -5), (-9, 15, -5)], [(0, 1, 2, 3)], (0.2, 0.2, 0.2))
    tree, output = users_tree(bpy.context.scene)
    bpy.ops.rle_splat.show_in_renders()
    halved = insert(tree, output.inputs[0].links[0].from_socket, -1.0)
    tree.links.new(halved.outputs[0], output.inputs[0])
    before = links_of(tree)
    bpy.ops.rle_splat.show_in_renders()
    assert links_of(tree) == before
    picture = scenes.rendered(tmp_path / "out.exr")
    expected = MIDDLE * np.array(scenes.RED) + (1.0 - MIDDLE) * 0.2
    np.testing.assert_allclose(picture[12, 12, :3], expected, atol=0.01)
    np.testing.assert_allclose(picture[1, 1, :3], 0.2, atol=0.01)
    assert bpy.context.scene.rle_splat.message == ""
    assert bpy.ops.rle_splat.remove_from_renders() == {"FINISHED"}
    np.testing.assert_allclose(scenes.rendered(tmp_path / "out.exr")[12, 12, :3], 0.2, atol=0.01)


def test_B92_another_scenes_render_layers(owner, tmp_path):
    """The first scene's compositor also renders the second scene, which lays its own volume over its own renders."""
    first, second = second_scene(owner, 1.0)
    tree = first.compositing_node_group if bpy.app.version >= (5, 0) else first.node_tree
    layers = tree.nodes.new("CompositorNodeRLayers")
    layers.scene = second
    holds_the_cube(rendered_scene(first, tmp_path / "out.exr"))
    assert first.rle_splat.message == "" and second.rle_splat.message == ""
    holds_the_cube(rendered_scene(second, tmp_path / "out.exr"), (2.0, 0.0))


def test_B93_a_compositor_shared_or_switched_off(owner, tmp_path):
    first = bpy.context.scene
    tree, _ = users_tree(first)
    before = links_of(tree)
    if bpy.app.version >= (5, 0):
        other = bpy.data.scenes.new("other")
        other.compositing_node_group = tree
    else:
        first.use_nodes = False
    bpy.ops.rle_splat.show_in_renders()
    holds_the_cube(scenes.rendered(tmp_path / "out.exr") * (0.5, 0.5, 0.5, 1.0))  # the user's nodes double colors
    if bpy.app.version >= (5, 0):
        assert other.compositing_node_group == tree and links_of(tree) == before
    bpy.ops.rle_splat.remove_from_renders()
    assert links_of(tree) == before
    assert bpy.app.version >= (5, 0) or not first.use_nodes
