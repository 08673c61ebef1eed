"""Shadows and light in Blender: what is read of lights and world, and falloff as Cycles has it on a mesh in the same
place."""

import json
import math
from itertools import pairwise

import bpy
import numpy as np
import pytest
from mathutils import Vector

from tests.blender import scenes
from tests.blender.test_panels import draw_all

SIZE = 24


@pytest.fixture
def ball(addon, tmp_path):
    """Two balls seen from above: under a sun from the side one shades the other, and neither itself."""
    return scenes.ball_scene(tmp_path, 2)


def add_light(kind, location, aim=(0.0, 0.0, 0.0), **settings):
    data = bpy.data.lights.new(kind, kind)
    for name, value in settings.items():
        setattr(data, name, value)
    light = bpy.data.objects.new(kind, data)
    light.location = location
    light.rotation_euler = (Vector(aim) - Vector(location)).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(light)
    return light


def picture():
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    image = bpy.context.scene.rle_splat.image
    pixels = np.empty(SIZE * SIZE * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels


def read(bridge, volume, **how):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return bridge("scene.render_scene").read_scene(volume, depsgraph, with_meshes=False, **how)[0]


def test_indirect_light_is_read_and_reaches_pictures_renders_and_the_live_view(ball, bridge, monkeypatch, tmp_path):
    add_light("SUN", (10.0, 0.0, -30.0), energy=20.0)
    scene = bpy.context.scene
    settings = scene.rle_splat
    scenes.use_cycles((SIZE, SIZE))
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    plain, rendered = picture(), scenes.rendered(tmp_path / "plain.exr")
    settings.indirect_light = 1.0
    assert read(bridge, ball).indirect_light == 1.0 and read(bridge, ball, with_shadows=False).indirect_light == 0.0
    any_view, depsgraph = bridge("live.surface")._ANY_VIEW, bpy.context.evaluated_depsgraph_get()
    drawn_live = bridge("scene.render_scene").seen_by(ball, depsgraph, any_view)
    assert drawn_live.indirect_light == 1.0
    assert np.abs(picture() - plain).max() > 0.02
    row = settings.effect_rows["indirect light"]
    assert row.on and row.reason == "amount 1"
    assert np.abs(scenes.rendered(tmp_path / "lit.exr") - rendered).max() > 0.02

    def gray():
        return {what[1] for before, what in pairwise(draw_all(monkeypatch)) if before == ("enabled", False)}

    def needs():
        return "Scattering needs" in " ".join(str(what) for kind, what in draw_all(monkeypatch) if kind == "label")

    assert "indirect_light" not in gray() and not needs()
    settings.use_shadows = False
    assert "indirect_light" in gray() and needs()
    settings.use_shadows, settings.quality, settings.classification = True, "custom", "pre"
    assert "indirect_light" in gray() and needs()
    scattered, settings.indirect_light = picture(), 0.0
    np.testing.assert_array_equal(scattered, picture())


def plain_world(color, strength):
    world = bpy.data.worlds.new("World")
    if world.node_tree is None:
        world.use_nodes = True
    node = next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")
    node.inputs["Color"].default_value, node.inputs["Strength"].default_value = (*color, 1.0), strength
    bpy.context.scene.world = world
    return world, node


def test_lights_that_cast_shadows_cast_them_and_only_they(ball):
    sun = add_light("SUN", (30.0, 0.0, 10.0), energy=4.0)
    settings = bpy.context.scene.rle_splat
    rows = settings.effect_rows
    shaded = picture()
    assert rows["shadows"].on and rows["shadows"].reason == "cast by 1 sun" and rows["shadows"].ms > 0.0
    sun.data.use_shadow = False
    plain = picture()
    assert not rows["shadows"].on and rows["shadows"].reason == "no light casts shadows"
    assert np.abs(shaded - plain).max() > 0.02 and (shaded <= plain + 5e-3).all()  # the warp overshoots at edges
    sun.data.use_shadow, settings.use_shadows = True, False
    np.testing.assert_array_equal(picture(), plain)


def test_a_headlight_casts_none_and_a_maximum_error_leaves_them_out_of_pre(ball, bridge):
    assert not read(bridge, ball).volume_shadows
    add_light("SUN", (30.0, 0.0, 10.0))
    settings = bpy.context.scene.rle_splat
    settings.ambient_occlusion = 0.5
    plain = read(bridge, ball)
    assert plain.volume_shadows and plain.ambient_occlusion == 0.5
    without = read(bridge, ball, with_shadows=False)
    assert not without.volume_shadows and without.ambient_occlusion == 0.0
    settings.max_error, settings.classification = 2.0, "pre"
    scenes.add_camera((0.0, 0.0, 30.0))
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    report = json.loads(settings.last_report_json)
    assert any("no shadows and no ambient occlusion" in remark for remark in report["remarks"])
    assert {row["name"]: row["on"] for row in report["effects"]}["shadows"] is False
    settings.classification = "post"
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    report = json.loads(settings.last_report_json)
    assert {row["name"]: row["on"] for row in report["effects"]}["shadows"] and report["error"]["truth"] == "T2"


def test_a_world_of_one_color_is_read_from_its_node(ball, bridge):
    add_light("SUN", (30.0, 0.0, 10.0))
    bpy.context.scene.world = None
    assert read(bridge, ball).world is None
    plain_world((0.1, 0.2, 0.4), 2.5)
    np.testing.assert_allclose(read(bridge, ball).world, (0.25, 0.5, 1.0), rtol=1e-6)
    bpy.context.scene.rle_splat.use_world = False
    assert read(bridge, ball).world is None


LIGHTS = {
    "sun": ("SUN", (3.0, 0.0, 4.0), {"energy": 3.0, "angle": 0.0}),
    "point": ("POINT", (1.0, 0.5, 2.0), {"energy": 50.0, "shadow_soft_size": 0.01}),
    "spot": ("SPOT", (1.5, 0.0, 3.0), {"energy": 80.0, "shadow_soft_size": 0.01, "spot_size": 0.9, "spot_blend": 0.5}),
    "area": ("AREA", (-1.0, 1.0, 4.0), {"energy": 40.0, "size": 0.2}),
}


@pytest.mark.parametrize("name", LIGHTS)
def test_light_falls_off_as_cycles_has_it_on_a_mesh_in_the_same_place(addon, bridge, core, tmp_path, name):
    """A white floor four units wide, pixel by pixel: within 3 % of its brightest place, 1 % in the mean."""
    kind, location, settings = LIGHTS[name]
    scenes.use_cycles((16, 16), samples=64)
    scenes.add_camera((0.0, 0.0, 20.0), type="ORTHO", ortho_scale=4.0)
    scenes.add_white_floor(2.5)
    add_light(kind, location, **settings)
    theirs = np.asarray(scenes.rendered(tmp_path / "lit.exr"))[..., 1]
    lights = bridge("scene.lights").read_lights(bpy.context.evaluated_depsgraph_get())
    function = core("classify.transfer_function")
    shade = function.Shade(ambient=0.0, diffuse=1.0, specular=0.0, shininess=1.0)
    tf = function.TransferFunction(opacity=((0, 0.5),), color=((0, 1, 1, 1),), shade=shade)
    place = np.diag((4 / 64, -4 / 64, 1.0, 1.0))  # voxels share the pixels out, rows from the top
    place[:2, 3] = -2.0 + 2 / 64, 2.0 - 2 / 64
    volume = core("volume.volume").Volume(np.ones((1, 64, 64), np.uint8), place)
    classified = core("classify.classification").classify(volume, tf, place)
    up = np.tile(np.array((0.0, 0.0, 1.0), np.float32), (64 * 64, 1))
    falling = core("shade.lighting").lighting(place, shade, lights)
    ours = core("shade.shading").shaded_colors(classified, up, falling)[:, 1]
    ours = ours.reshape(16, 4, 16, 4).mean(axis=(1, 3))
    assert kind == "SUN" or np.ptp(ours) > 0.2 * ours.max()
    assert np.abs(ours - theirs).max() < 0.03 * ours.max()
    assert math.isclose(ours.mean(), theirs.mean(), rel_tol=0.01)


def test_the_shadow_pass_is_what_shadows_take_of_the_picture(ball):
    settings = bpy.context.scene.rle_splat
    with pytest.raises(RuntimeError, match="turn on shadows or ambient occlusion"):
        bpy.ops.rle_splat.shadow_pass()
    add_light("SUN", (30.0, 0.0, 10.0), energy=4.0)
    shaded = picture().reshape(SIZE, SIZE, 4)[::-1, :, :3].sum(axis=2)
    settings.use_shadows = False
    plain = picture().reshape(SIZE, SIZE, 4)[::-1, :, :3].sum(axis=2)
    settings.use_shadows = True
    assert bpy.ops.rle_splat.shadow_pass() == {"FINISHED"}
    image = next(image for image in bpy.data.images if image.name.endswith("Splat Shadow"))
    share = scenes.image_pixels(image)[..., 0]
    seen = plain > 1e-3
    expected = np.where(seen, 1.0 - shaded / np.where(seen, plain, 1.0), 0.0)
    assert image.colorspace_settings.name == "Non-Color"
    assert share.max() > 0.1 and np.abs(share - np.clip(expected, 0.0, 1.0))[seen].max() < 1e-4
    settings.max_error, settings.classification = 2.0, "pre"
    with pytest.raises(RuntimeError, match="turn Maximum Error off"):
        bpy.ops.rle_splat.shadow_pass()
