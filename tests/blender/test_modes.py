"""Modes and surfaces from the panels: each picture is that of the renderer with the scene as the panels say it."""

import json

import bpy
import numpy as np
import pytest

from tests.blender import scenes
from tests.blender.scenes import add_camera, gray_world, image_pixels, import_raw

pytestmark = pytest.mark.usefixtures("by_numpy")

SIZE = 24
BALL = scenes.ball()


@pytest.fixture
def volume(addon, tmp_path):
    found = import_raw(tmp_path, BALL)
    add_camera(location=(0.0, 0.0, 40.0))
    render = bpy.context.scene.render
    render.resolution_x = render.resolution_y = SIZE
    render.resolution_percentage = 100
    return found


def picture():
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    settings = bpy.context.scene.rle_splat
    effects = {row["name"]: row for row in json.loads(settings.last_report_json)["effects"]}
    return image_pixels(settings.image), effects


def rendered(bridge, core, volume, **more):
    scene, quality = scenes.read_scene(volume, with_meshes=True)
    return scene, core("pipeline.render").render(scene, quality).rgba


@pytest.mark.parametrize("mode", ("xray", "mip", "minip", "average"))
def test_each_mode_is_the_renderers_and_says_so(volume, bridge, core, mode):
    plain, effects = picture()
    assert not effects["mode"]["on"]
    bpy.context.scene.rle_splat.mode = mode
    found, effects = picture()
    scene, true = rendered(bridge, core, volume)
    assert scene.mode == mode and effects["mode"]["on"] and not effects["shading"]["on"]
    np.testing.assert_array_equal(found, true)
    assert np.abs(found - plain).max() > 0.05 or mode == "minip"


def test_a_gradient_opacity_is_read_and_a_transfer_function_writes_it(volume, bridge, core):
    plain, effects = picture()
    assert not effects["gradient opacity"]["on"]
    properties = volume.rle_splat
    properties.use_gradient_opacity, properties.gradient_low, properties.gradient_high = True, 20.0, 80.0
    found, effects = picture()
    scene, true = rendered(bridge, core, volume)
    steep = scene.transfer_function.gradient_opacity
    assert (steep.low, steep.high) == (20.0, 80.0) and effects["gradient opacity"]["on"]
    np.testing.assert_array_equal(found, true)
    assert np.abs(found - plain).max() > 0.01
    transfer = bridge("look.transfer")
    transfer.move_window(volume, properties.window_center, 2.0 * properties.window_width, keep_values=True)
    assert transfer.read_transfer(volume).gradient_opacity == steep
    nodes = bridge("look.transfer_nodes")
    nodes.write_curve(nodes.gradient_mapping(properties.transfer), ((0.0, 0.25), (0.5, 1.0), (1.0, 0.0)))
    scene, true = rendered(bridge, core, volume)
    assert scene.transfer_function.gradient_opacity.curve == ((0.0, 0.25), (0.5, 1.0), (1.0, 0.0))
    bent, _ = picture()
    np.testing.assert_array_equal(bent, true)
    assert np.abs(bent - found).max() > 0.01
    transfer.write_transfer(volume, scene.transfer_function)
    assert transfer.read_transfer(volume).gradient_opacity == scene.transfer_function.gradient_opacity
    # A group of an earlier version has no such curve: a ramp.
    properties.transfer.nodes.remove(properties.transfer.nodes[nodes.GRADIENT_NODE])
    assert transfer.read_transfer(volume).gradient_opacity == steep
    bridge("data.migration")._replace_removed()
    assert transfer.read_transfer(volume).gradient_opacity == steep and nodes.gradient_mapping(properties.transfer)
    assert bpy.ops.rle_splat.apply_preset(preset="ct-bone") == {"FINISHED"}
    assert not properties.use_gradient_opacity


def test_impossible_ends_of_a_gradient_are_one_sentence(volume, refused):
    properties = volume.rle_splat
    properties.use_gradient_opacity, properties.gradient_low, properties.gradient_high = True, 10.0, 5.0
    refused(bpy.ops.rle_splat.render_image, "gradient opacity's low")


def test_B56_the_mist_is_the_worlds_where_its_own_switch_is_on_and_a_mist_pass_changes_nothing(volume, bridge, core):
    gray_world(1.0)
    scene = bpy.context.scene
    background = next(node for node in scene.world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = (0.25, 0.5, 0.75, 1.0)
    settings = scene.world.mist_settings
    settings.start, settings.depth, settings.falloff = 30.0, 20.0, "LINEAR"
    scene.rle_splat.use_world = False
    plain, effects = picture()
    assert not effects["mist"]["on"]
    bpy.context.view_layer.use_pass_mist = True
    found, effects = picture()
    np.testing.assert_array_equal(found, plain)
    assert not effects["mist"]["on"]
    scene.rle_splat.use_mist = True
    found, effects = picture()
    plain_scene, true = rendered(bridge, core, volume)
    assert plain_scene.mist == core("scene").Mist(30.0, 20.0, "LINEAR", (0.25, 0.5, 0.75)) and effects["mist"]["on"]
    np.testing.assert_array_equal(found, true)
    np.testing.assert_array_equal(found[..., 3], plain[..., 3])
    assert np.abs(found - plain).max() > 0.05


def test_volumes_of_a_scene_have_modes_and_lights_of_their_own(volume, bridge, tmp_path):
    other = import_raw(tmp_path, BALL, name="other")
    light = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "SUN"))
    bpy.context.scene.collection.objects.link(light)
    volume.rle_splat.display = "mip"
    other.rle_splat.lighting = "BOTH"
    depsgraph = bpy.context.evaluated_depsgraph_get()
    placed = bridge("scene.placements").shown(depsgraph)
    found, problems, _ = bridge("scene.render_scene").read_scenes(placed, depsgraph, with_meshes=True)
    plain = {placed[number].owner.name: scene for number, scene in found.items()}
    assert not problems
    assert [plain[one.name].mode for one in (volume, other)] == ["mip", "composite"]
    lit = {name: (len(scene.lights), scene.headlight) for name, scene in plain.items()}
    assert lit == {volume.name: (1, False), other.name: (1, True)}


def test_a_headlight_and_lights_add_up(volume):
    """Diffuse light of both is the sum of each, where nothing is clipped."""
    light = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "SUN"))
    light.data.energy, light.rotation_euler = 2.0, (0.0, 1.0, 0.0)
    bpy.context.scene.collection.objects.link(light)
    properties = volume.rle_splat
    properties.ambient = properties.specular = 0.0
    properties.two_sided, bpy.context.scene.rle_splat.use_shadows = False, False
    found = {}
    for lighting in ("SCENE", "HEADLIGHT", "BOTH"):
        properties.lighting = lighting
        found[lighting] = picture()[0].astype(np.float64)
    np.testing.assert_allclose(found["BOTH"][..., 3], found["SCENE"][..., 3], atol=1e-6)
    difference = np.abs(found["BOTH"] - found["SCENE"] - found["HEADLIGHT"])[..., :3]
    assert difference.max() < 0.01 and difference.mean() < 1e-4 and found["HEADLIGHT"][..., :3].mean() > 0.01


@pytest.fixture
def body(addon, tmp_path):
    """A CT of a cylinder of water with a rod of dense bone and a tooth in air, from the side."""
    _, y, x = np.mgrid[:40, :40, :40]
    values = np.where((x - 19.5) ** 2 + (y - 19.5) ** 2 < 230.0, 30, -1000)
    values[(x - 26.0) ** 2 + (y - 19.5) ** 2 < 20.0] = 1250
    values[30:34, 17:22, 24:29] = 2000
    found = import_raw(tmp_path, values.astype(np.int16), name="body")
    found.rle_splat.value_unit = "HU"
    add_camera(location=(19.5, -60.0, 19.5), rotation=(np.pi / 2, 0.0, 0.0), type="ORTHO", ortho_scale=36.0)
    render = bpy.context.scene.render
    render.resolution_x = render.resolution_y = 40
    render.resolution_percentage = 100
    return found


@pytest.mark.parametrize("mode", ("xray", "mip", "minip", "average"))
def test_each_mode_begins_with_a_window_that_shows_the_body(body, mode):
    """Water and bone are neither black nor white and apart; MinIP, whose lines all pass air, is black, not empty."""
    body.rle_splat.display = mode
    pixels = picture()[0]
    row = pixels[20].astype(np.float64)
    water, bone = row[10:18, 0].mean(), row[26:29, 0].mean()
    if mode == "minip":
        assert (pixels[4:36, 4:36, 3] > 0.99).all() and row[:, 0].max() < 0.05
        return
    assert 0.01 < water < 0.95 and water + 0.04 < bone < 0.99
    assert row[0, 3] < 0.1, "air is not clear"


@pytest.mark.parametrize(("mode", "seen"), (("mip", 30.0), ("minip", -1000.0)))
def test_the_gray_on_the_screen_is_proportional_to_the_value(body, core, mode, seen):
    """As of a slice on a viewing workstation: the middle of the window is 0.5 in sRGB, over black."""
    properties = body.rle_splat
    properties.value_unit, properties.display, properties.window_width = "HU", mode, 800.0
    for share in (0.1, 0.5, 0.75):
        properties.window_center = seen + (0.5 - share) * 800.0
        water = core("scene.color").to_display(picture()[0][20, 14:16, 0])
        np.testing.assert_allclose(water, share, atol=0.002)


def test_a_preset_for_mip_shows_mip(body):
    """In Shaded mode it is a white shape."""
    assert bpy.ops.rle_splat.apply_preset(preset="mr-mip") == {"FINISHED"}
    assert (body.rle_splat.display, body.rle_splat.transfer_name) == ("mip", "MR MIP")


def test_shaded_has_its_own_window_again(body):
    properties = body.rle_splat
    properties.window_center, properties.window_width = 123.0, 456.0
    for mode in ("xray", "mip"):
        properties.display = mode
        assert properties.window_width != 456.0 and properties.shift_by == 0.0
    properties.display = "composite"
    assert (properties.window_center, properties.window_width) == (123.0, 456.0)
    properties.display = "mip"
    assert bpy.ops.rle_splat.apply_preset(preset="ct-bone") == {"FINISHED"}
    chosen = properties.window_center, properties.window_width
    properties.display = "composite"  # what was applied meanwhile stays
    assert (properties.window_center, properties.window_width) == chosen


def test_a_plain_background_is_one_of_a_viewport(volume):
    """Black, or white where high values are black."""
    area = next(one for one in bpy.context.screen.areas if one.type == "VIEW_3D")
    shading = area.spaces.active.shading
    volume.rle_splat.display = "mip"
    with bpy.context.temp_override(area=area, space_data=area.spaces.active):
        for inverted, color in ((False, 0.0), (True, 1.0)):
            volume.rle_splat.use_inverted_grays = inverted
            for expected in ("VIEWPORT", "THEME"):
                assert bpy.ops.rle_splat.plain_background() == {"FINISHED"}
                assert shading.background_type == expected
            assert tuple(shading.background_color) == (color,) * 3
        volume.rle_splat.display = "composite"
        assert bpy.ops.rle_splat.apply_preset(preset="pet") == {"FINISHED"}
        assert bpy.ops.rle_splat.plain_background() == {"FINISHED"}
        assert shading.background_type == "VIEWPORT" and tuple(shading.background_color) == (1.0, 1.0, 1.0)
        shading.type = "MATERIAL"
        with pytest.raises(RuntimeError, match="Switch the viewport to Solid shading"):
            bpy.ops.rle_splat.plain_background()


@pytest.mark.parametrize("mode", ("mip", "minip", "average"))
def test_inverted_grays_are_the_negative_on_white(body, core, mode):
    """On the screen: a gray over white is one less that over black."""
    display = core("scene.color").to_display
    body.rle_splat.display = mode
    assert not body.rle_splat.use_inverted_grays
    plain = picture()[0].astype(np.float64)
    body.rle_splat.use_inverted_grays = True
    inverted = picture()[0].astype(np.float64)
    over_white = inverted[..., 0] + 1.0 - inverted[..., 3]
    assert plain[..., 0].max() > 0.1 or mode == "minip"
    inside = slice(4, 36), slice(4, 36)  # pixels at the edge are covered in part
    np.testing.assert_allclose(display(over_white[inside]), 1.0 - display(plain[inside][..., 0]), atol=0.004)


def test_a_pet_begins_with_inverted_grays(body):
    properties = body.rle_splat
    properties.value_unit, properties.facts = "", "Modality: PT"
    properties.display = "mip"
    assert properties.use_grays and properties.use_inverted_grays
    properties.value_unit = "HU"
    properties.display = "composite"
    properties.display = "mip"
    assert properties.use_grays and not properties.use_inverted_grays
