"""Glass in Blender: which materials let the volume be seen, and by how much it is tinted, in all pictures."""

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

GREEN = (0.3, 0.9, 0.5)


@pytest.fixture
def volume(addon, tmp_path):
    """A ball seen from above."""
    scenes.use_cycles((24, 24))
    return scenes.ball_scene(tmp_path)


def material(kind="ShaderNodeBsdfGlass", **values):
    """A material of one shader; ``values``: of its sockets."""
    made = bpy.data.materials.new("glass")
    if made.node_tree is None:  # always there from 5.0 on
        made.use_nodes = True
    tree = made.node_tree
    shader = tree.nodes.new(kind)
    for name, value in values.items():
        shader.inputs[name.replace("_", " ")].default_value = value
    tree.links.new(shader.outputs[0], tree.get_output_node("ALL").inputs["Surface"])
    return made


def glass(color=GREEN):
    return material(Color=(*color, 1.0))


def add_lid(surface, name="lid"):
    """A plane before the volume that covers all of it."""
    lid = scenes.add_mesh([(-50, -50, 20), (50, -50, 20), (50, 50, 20), (-50, 50, 20)], [(0, 1, 2, 3)], name=name)
    lid.data.materials.append(surface)
    return lid


@pytest.mark.parametrize(
    ("kind", "values", "share"),
    [
        ("Glass", {"Color": (*GREEN, 1.0)}, (*GREEN, 1.0)),
        ("Refraction", {"Color": (*GREEN, 1.0)}, (*GREEN, 1.0)),
        ("Transparent", {"Color": (*GREEN, 1.0)}, (*GREEN, 1.0)),
        ("Diffuse", {}, None),
        ("Principled", {}, None),
        ("Principled", {"Transmission_Weight": 1.0, "Base_Color": (*GREEN, 1.0)}, (*GREEN, 1.0)),
        ("Principled", {"Transmission_Weight": 0.5, "Base_Color": (*GREEN, 1.0)}, (0.15, 0.45, 0.25, 0.5)),
        ("Principled", {"Transmission_Weight": 1.0, "Metallic": 1.0}, None),
        ("Principled", {"Alpha": 0.25}, (0.75, 0.75, 0.75, 0.75)),
    ],
)  # fmt: skip
def test_the_share_of_a_material(addon, bridge, kind, values, share):
    found = bridge("scene.meshes").share_of(material(f"ShaderNodeBsdf{kind}", **values))
    if share is None:
        assert found is None
    else:
        np.testing.assert_allclose(found, share, atol=1e-6)


def test_mixed_shaders_and_what_a_texture_decides(addon, bridge):
    share_of = bridge("scene.meshes").share_of
    made = glass((1.0, 1.0, 1.0))
    tree = made.node_tree
    mix, diffuse = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBsdfDiffuse")
    shader = next(node for node in tree.nodes if node.type == "BSDF_GLASS")
    mix.inputs[0].default_value = 0.25
    tree.links.new(shader.outputs[0], mix.inputs[1])
    tree.links.new(diffuse.outputs[0], mix.inputs[2])
    output = tree.get_output_node("ALL").inputs["Surface"]
    tree.links.new(mix.outputs[0], output)
    np.testing.assert_allclose(share_of(made), (0.75,) * 4)
    tree.links.new(tree.nodes.new("ShaderNodeFresnel").outputs[0], mix.inputs[0])
    np.testing.assert_allclose(share_of(made), (0.5,) * 4)
    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs["Color"], shader.inputs["Color"])
    np.testing.assert_allclose(share_of(made), (0.5,) * 4)
    tree.links.remove(output.links[0])
    assert share_of(made) is None and share_of(None) is None


def test_glass_and_opaque_faces_of_one_mesh_are_told_apart(volume, bridge):
    faces = scenes.add_mesh(
        [(0, 0, 0), (1, 0, 0), (0, 1, 0), (5, 0, 0), (6, 0, 0), (5, 1, 0), (9, 0, 0), (9, 1, 0), (8, 0, 0)],
        [(0, 1, 2), (3, 4, 5), (6, 7, 8)], name="faces",
    )  # fmt: skip
    for surface in (material("ShaderNodeBsdfDiffuse"), glass()):
        faces.data.materials.append(surface)
    faces.data.polygons.foreach_set("material_index", (0, 1, 7))  # Blender draws the last by the last slot
    scenes.update()
    found = bridge("scene.meshes").read_surfaces(bpy.context.evaluated_depsgraph_get())
    assert found.triangles[..., 0].max() == 1.0 and found.panes.shape == (2, 3, 3)
    assert found.panes[0, :, 0].min() == 5.0 and found.panes[1, :, 0].min() == 8.0
    np.testing.assert_allclose(found.pane_shares, np.tile((*GREEN, 1.0), (2, 1)), atol=1e-6)
    faces.material_slots[1].link = "OBJECT"
    faces.material_slots[1].material = material("ShaderNodeBsdfDiffuse")
    scenes.update()
    assert bridge("scene.meshes").read_surfaces(bpy.context.evaluated_depsgraph_get()).panes is None


def test_a_lid_of_glass_tints_every_picture(volume, tmp_path):
    alone = scenes.picture()
    lid = add_lid(glass())
    np.testing.assert_allclose(scenes.picture(), alone * (*GREEN, 1.0), atol=1e-6)
    assert bpy.ops.rle_splat.list_effects() == {"FINISHED"}
    rows = bpy.context.scene.rle_splat.effect_rows
    assert rows["glass"].on and not rows["mesh occlusion"].on
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    scenes.rendered(tmp_path / "frame.exr")
    settings = bpy.context.scene.rle_splat
    np.testing.assert_allclose(scenes.image_pixels(settings.composite_image), alone * (*GREEN, 1.0), atol=1e-6)
    lid.data.materials[0] = material("ShaderNodeBsdfDiffuse")
    scenes.update()
    assert scenes.picture()[..., 3].max() == 0.0
    settings.meshes_occlude = False
    np.testing.assert_array_equal(scenes.picture(), alone)


def test_a_maximum_error_is_kept_through_glass(volume):
    settings = bpy.context.scene.rle_splat
    settings.use_tolerance = True
    alone = scenes.picture()
    add_lid(glass())
    np.testing.assert_allclose(scenes.picture(), alone * (*GREEN, 1.0), atol=2.0 / 255.0)
