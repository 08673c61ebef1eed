"""Modes and surfaces from the panels: each picture is that of the renderer with the scene as the panels say it."""

import json

import bpy
import numpy as np
import pytest

from tests.blender.scenes import add_camera, gray_world, image_pixels, import_raw

pytestmark = pytest.mark.usefixtures("by_numpy")

SIZE = 24
BALL = np.clip(
    250.0 - 40.0 * np.sqrt(sum((axis - 5.0) ** 2 for axis in np.mgrid[:11, :11, :11])), 0.0, 255.0
).astype(np.uint8)


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
    scene, quality = bridge("scene.render_scene").read_scene(
        volume, bpy.context.evaluated_depsgraph_get(), with_meshes=True
    )
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
