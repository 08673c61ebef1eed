"""Show in Renders with several view layers, through Cycles: each has the volume, and what stands in it, as its
own visibility says.  Pixels are compared with closed forms.

The volume is the uniform cube of ``test_composite.py``: a ray along an axis meets N units of it, and from above down to
height z in it N - 1/2 - z.
"""

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy", "classified_first")

N = 9
ALPHA = 0.08
COLOR = (0.9, 0.5, 0.2)
FLOOR = (0.1, 0.3, 0.6)  # what the plane inside the volume emits
HEIGHT = 2.3  # of that plane
TOLERANCE = 1.0 / 255.0


def over(length, below=(0.0, 0.0, 0.0), below_alpha=0.0):
    """RGBA of ``length`` units of the medium over what is below."""
    alpha = 1.0 - (1.0 - ALPHA) ** length
    return np.array((*(alpha * np.array(COLOR) + (1.0 - alpha) * np.array(below)), alpha + (1.0 - alpha) * below_alpha))


def layer_pixel(volume_is_seen, plane):
    """What a view layer shows: RGBA.  ``plane``: "seen", "left out", or "held out"."""
    if not volume_is_seen:
        return over(0.0, FLOOR, 1.0) if plane == "seen" else np.zeros(4)
    if plane == "left out":
        return over(N)
    return over(N - 0.5 - HEIGHT, FLOOR if plane == "seen" else (0.0,) * 3, 1.0 if plane == "seen" else 0.0)


def mixed(first, second):
    """What ``mix_nodes`` makes of two pixels."""
    half = 0.5 * (first + second)
    return half if bpy.app.version >= (5, 2) else np.array((*half[:3], first[3]))


@pytest.fixture
def volume(tmp_path):
    """The volume and a plane inside it, each in a collection of its own."""
    owner = scenes.even_cube(tmp_path, N, ALPHA, COLOR)
    scene = scenes.use_cycles((16, 16))
    middle = (N - 1) / 2
    scenes.add_camera((middle, middle, 30.0), type="ORTHO", ortho_scale=4.0)
    scene.rle_splat.quality = "fine"
    scene.rle_splat.use_shadows = False
    plane = scenes.add_mesh(
        [(-9, -9, HEIGHT), (18, -9, HEIGHT), (18, 18, HEIGHT), (-9, 18, HEIGHT)], [(0, 1, 2, 3)], FLOOR, "plane"
    )
    move_to_collection(owner, "volumes")
    move_to_collection(plane, "planes")
    return owner


def move_to_collection(one, name):
    collection = bpy.data.collections.new(name)
    bpy.context.scene.collection.children.link(collection)
    for former in one.users_collection:
        former.objects.unlink(one)
    collection.objects.link(one)


def child(layer, name):
    return layer.layer_collection.children[name]


def add_layer(name):
    """A view layer that shows everything, whatever the others leave out."""
    layer = bpy.context.scene.view_layers.new(name)
    for one in layer.layer_collection.children:
        one.exclude = False
    return layer


def make_tree(versions, names):
    """A compositor that mixes the view layers ``names``, each half and half with those before; returns (tree, Render
    Layers nodes)."""
    scene = bpy.context.scene
    tree = versions.switch_on_compositor(scene)
    versions.add_output_socket(tree)
    nodes = []
    for name in names:
        node = tree.nodes.new("CompositorNodeRLayers")
        node.scene, node.layer = scene, name
        nodes.append(node)
    result = nodes[0].outputs["Image"]
    for node in nodes[1:]:
        result = mix_nodes(tree, result, node.outputs["Image"])
    output = tree.nodes.new(versions.OUTPUT_NODE)
    tree.links.new(result, next(socket for socket in output.inputs if socket.type == "RGBA"))
    return tree, nodes


def mix_nodes(tree, first, second):
    """Half the sum of two pictures; before Blender 5.2 its Mix keeps the alpha of the first."""
    for kind in ("CompositorNodeMixRGB", "ShaderNodeMix"):
        try:
            mix = tree.nodes.new(kind)
        except RuntimeError:
            continue
        break
    if mix.bl_idname == "ShaderNodeMix":
        mix.data_type = "RGBA"
    factor = next(socket for socket in mix.inputs if socket.enabled and socket.type == "VALUE")
    one, other = [socket for socket in mix.inputs if socket.enabled and socket.type == "RGBA"]
    factor.default_value = 0.5
    tree.links.new(first, one)
    tree.links.new(second, other)
    return next(socket for socket in mix.outputs if socket.enabled)


def middle_of(path):
    return scenes.rendered(path)[8, 8]


PLANES = {"seen": {}, "left out": {"exclude": True}, "held out": {"holdout": True}}
COMBINATIONS = [
    (first, second, plane_1, plane_2)
    for first in (True, False) for second in (True, False)
    for plane_1, plane_2 in (("seen", "seen"), ("left out", "seen"), ("seen", "left out"), ("left out", "left out"),
                             ("held out", "seen"), ("seen", "held out"))
]  # fmt: skip


@pytest.mark.parametrize(("first", "second", "plane_1", "plane_2"), COMBINATIONS)
def test_B29_B30_each_layer_shows_what_it_shows(volume, bridge, tmp_path, first, second, plane_1, plane_2):
    """Two layers, mixed half and half: the volume in either, both or none, the plane seen, left out or held out."""
    layers = [bpy.context.view_layer, add_layer("second")]
    for layer, seen, plane in zip(layers, (first, second), (plane_1, plane_2)):
        child(layer, "volumes").exclude = not seen
        for name, value in PLANES[plane].items():
            setattr(child(layer, "planes"), name, value)
    make_tree(bridge("versions"), [layer.name for layer in layers])
    composite()
    expected = mixed(layer_pixel(first, plane_1), layer_pixel(second, plane_2))
    np.testing.assert_allclose(middle_of(tmp_path / "out.exr"), expected, atol=TOLERANCE)
    message = bpy.context.scene.rle_splat.message
    if first or second:
        assert message == ""
    else:
        assert message == ("'cube' is not in the picture: it is excluded from view layer 'ViewLayer' and it is "
                           "excluded from view layer 'second'.")  # fmt: skip


def composite():
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}


def test_the_only_layer_of_the_compositor_counts_not_the_first_rendered(volume, bridge, tmp_path):
    """The first of two rendered layers has no volume and no part in the output."""
    second = add_layer("second")
    child(bpy.context.view_layer, "volumes").exclude = True
    child(second, "planes").exclude = True
    tree, _ = make_tree(bridge("versions"), ["second"])
    composite()
    assert len([node for node in tree.nodes if node.bl_idname == "CompositorNodeAlphaOver"]) == 1
    np.testing.assert_allclose(middle_of(tmp_path / "out.exr"), over(N), atol=TOLERANCE)
    assert bpy.context.scene.rle_splat.message == ""


def test_layers_put_into_the_compositor_after_composite_share_its_picture(volume, bridge, tmp_path):
    """It is drawn by the first of them that shows the volume."""
    second = add_layer("second")
    tree, nodes = make_tree(bridge("versions"), ["ViewLayer"])
    composite()
    over_node = next(node for node in tree.nodes if node.bl_idname == "CompositorNodeAlphaOver")
    background = next(socket for socket in over_node.inputs if socket.type == "RGBA")
    later = tree.nodes.new("CompositorNodeRLayers")
    later.scene, later.layer = bpy.context.scene, "second"
    tree.links.new(mix_nodes(tree, nodes[0].outputs["Image"], later.outputs["Image"]), background)
    child(bpy.context.view_layer, "volumes").exclude = True
    child(bpy.context.view_layer, "planes").exclude = True
    beneath = mixed(np.zeros(4), layer_pixel(False, "seen"))
    expected = over(N - 0.5 - HEIGHT, beneath[:3], beneath[3])
    np.testing.assert_allclose(middle_of(tmp_path / "out.exr"), expected, atol=TOLERANCE)
    child(second, "planes").exclude = True
    np.testing.assert_allclose(middle_of(tmp_path / "out.exr"), over(N), atol=TOLERANCE)
    assert bpy.context.scene.rle_splat.message == ""


def test_a_layer_that_is_not_rendered_is_skipped(volume, bridge, tmp_path):
    """Its picture of an earlier render is not shown again, and the other layer is as it was."""
    second = add_layer("second")
    make_tree(bridge("versions"), ["ViewLayer", "second"])
    composite()
    both = layer_pixel(True, "seen")
    np.testing.assert_allclose(middle_of(tmp_path / "out.exr"), both, atol=TOLERANCE)
    second.use = False
    assert middle_of(tmp_path / "out.exr")[:3] == pytest.approx(0.5 * both[:3], abs=TOLERANCE)
    assert bpy.context.scene.rle_splat.message == ""


def test_only_a_layer_that_is_not_rendered_has_the_picture(volume, bridge, tmp_path):
    add_layer("second").use = False
    make_tree(bridge("versions"), ["second"])
    composite()
    scenes.rendered(tmp_path / "out.exr")
    assert bpy.context.scene.rle_splat.message == (
        "'cube' is not in the picture: view layer 'second' was not rendered."
    )


def test_one_layer_twice_has_one_picture(volume, bridge, tmp_path):
    add_layer("second")
    tree, _ = make_tree(bridge("versions"), ["ViewLayer", "second", "ViewLayer"])
    composite()
    images = [node.image for node in tree.nodes if node.bl_idname == "CompositorNodeImage"]
    assert len(images) == 3 and len(set(images)) == 2
    np.testing.assert_allclose(middle_of(tmp_path / "out.exr"), layer_pixel(True, "seen"), atol=TOLERANCE)


def links_of(tree):
    return sorted((link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier)
                  for link in tree.links)  # fmt: skip


def test_composite_again_and_remove_with_several_layers(volume, bridge):
    add_layer("second")
    tree, _ = make_tree(bridge("versions"), ["ViewLayer", "second"])
    before, names = links_of(tree), sorted(node.name for node in tree.nodes)
    images = len(bpy.data.images)
    composite()
    once = links_of(tree)
    composite()
    assert links_of(tree) == once and len(tree.nodes) == len(names) + 4 and len(bpy.data.images) == images + 2
    assert bpy.ops.rle_splat.remove_from_renders() == {"FINISHED"}
    assert links_of(tree) == before and sorted(node.name for node in tree.nodes) == names
    assert len(bpy.data.images) == images


def test_composite_again_after_a_layer_was_added_or_taken_away(volume, bridge, tmp_path):
    """One picture becomes two, each behind its layer, and one again."""
    second = add_layer("second")
    tree, nodes = make_tree(bridge("versions"), ["ViewLayer"])
    composite()
    over_node = next(node for node in tree.nodes if node.bl_idname == "CompositorNodeAlphaOver")
    later = tree.nodes.new("CompositorNodeRLayers")
    later.scene, later.layer = bpy.context.scene, "second"
    background = next(socket for socket in over_node.inputs if socket.type == "RGBA")
    tree.links.new(mix_nodes(tree, nodes[0].outputs["Image"], later.outputs["Image"]), background)
    child(second, "planes").exclude = True
    composite()
    expected = mixed(layer_pixel(True, "seen"), layer_pixel(True, "left out"))
    np.testing.assert_allclose(middle_of(tmp_path / "out.exr"), expected, atol=TOLERANCE)
    images = len(bpy.data.images)
    tree.nodes.remove(later)
    composite()
    assert len(bpy.data.images) == images - 1
    bpy.ops.rle_splat.remove_from_renders()
    assert not [node for node in tree.nodes if node.bl_idname in ("CompositorNodeAlphaOver", "CompositorNodeImage")]


REASONS = {
    "hide_render": "it is hidden from renders in view layer 'ViewLayer'",
    "collection": "it is hidden from renders in view layer 'ViewLayer'",
    "excluded": "it is excluded from view layer 'ViewLayer'",
    "indirect": "it is hidden from the camera in view layer 'ViewLayer'",
    "camera": "it is hidden from the camera in view layer 'ViewLayer'",
    "holdout": "it is a holdout in view layer 'ViewLayer', which RLE Splat does not support",
    "filter": "view layer 'ViewLayer' has volumes switched off (Filter > Volumes)",
    "instance": "it is not in the scene 'Scene'",
}


def hide(volume, way):
    layer = bpy.context.view_layer
    if way == "hide_render":
        volume.hide_render = True
    elif way == "collection":
        bpy.data.collections["volumes"].hide_render = True
    elif way == "excluded":
        child(layer, "volumes").exclude = True
    elif way == "indirect":
        child(layer, "volumes").indirect_only = True
    elif way == "camera":
        volume.visible_camera = False
    elif way == "holdout":
        child(layer, "volumes").holdout = True
    elif way == "filter":
        layer.use_volumes = False
    else:
        instancer = bpy.data.objects.new("instancer", None)
        instancer.instance_type, instancer.instance_collection = "COLLECTION", bpy.data.collections["volumes"]
        instancer.hide_render = True
        bpy.context.scene.collection.objects.link(instancer)
        bpy.context.scene.collection.children.unlink(bpy.data.collections["volumes"])


@pytest.mark.parametrize("way", REASONS)
def test_a_volume_that_is_hidden_on_purpose_is_blank_and_said(volume, tmp_path, capfd, way):
    composite()
    hide(volume, way)
    np.testing.assert_allclose(middle_of(tmp_path / "out.exr"), layer_pixel(False, "seen"), atol=TOLERANCE)
    settings = bpy.context.scene.rle_splat
    sentence = f"'cube' is not in the picture: {REASONS[way]}."
    assert settings.message == settings.render_problem == sentence and settings.failed_frames == ""
    assert sentence in settings.last_report and sentence in capfd.readouterr().out


def test_a_layer_without_surfaces_has_none_in_the_volume(volume, tmp_path):
    composite()
    bpy.context.view_layer.use_solid = False
    np.testing.assert_allclose(middle_of(tmp_path / "out.exr"), over(N), atol=TOLERANCE)
