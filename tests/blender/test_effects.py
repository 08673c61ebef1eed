"""The list of effects in Blender: analyzed without a picture, priced with one, forced by hand, undone and reloaded."""

import json
import math

import bpy
import numpy as np
import pytest

from tests.blender import scenes
from tests.blender.scenes import add_mesh

pytestmark = pytest.mark.usefixtures("by_numpy")

SIZE = 24


@pytest.fixture
def scene(addon, tmp_path):
    """A ball seen from above through a small frame, with no light of its own."""
    scenes.ball_scene(tmp_path)
    return bpy.context.scene


def picture(scene, **options):
    assert bpy.ops.rle_splat.render_image(**options) == {"FINISHED"}
    image = scene.rle_splat.image
    pixels = np.empty(SIZE * SIZE * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels


def rows(scene) -> dict:
    return {row.name: row for row in scene.rle_splat.effect_rows}


def add_sun():
    light = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    light.rotation_euler = (math.radians(50.0), 0.0, 0.0)
    bpy.context.scene.collection.objects.link(light)


def test_the_list_is_made_out_without_a_picture(scene, bridge):
    assert not scene.rle_splat.effect_rows
    assert bpy.ops.rle_splat.list_effects() == {"FINISHED"}
    assert list(rows(scene)) == list(bridge("data.effects").TEXTS)
    assert rows(scene)["headlight"].on and not rows(scene)["lights"].on and not rows(scene)["mesh occlusion"].on
    assert not any(row.is_timed for row in scene.rle_splat.effect_rows)
    assert scene.rle_splat.image is None and scene.rle_splat.last_report == ""
    add_sun()
    add_mesh([(-9.0, -9.0, 0.0), (9.0, -9.0, 0.0), (0.0, 9.0, 0.0)], [(0, 1, 2)])
    assert bpy.ops.rle_splat.list_effects() == {"FINISHED"}
    assert rows(scene)["lights"].on and rows(scene)["lights"].reason == "1 sun"
    assert rows(scene)["mesh occlusion"].on and not rows(scene)["headlight"].on


def test_a_picture_prices_the_list_as_its_report_does(scene):
    picture(scene)
    listed = json.loads(scene.rle_splat.last_report_json)["effects"]
    kept = rows(scene)
    assert [entry["name"] for entry in listed] == list(kept)
    for entry in listed:
        row = kept[entry["name"]]
        assert (row.on, row.reason, row.is_timed) == (entry["on"], entry["reason"], entry["ms"] is not None)
        assert row.ms == pytest.approx(entry["ms"] or 0.0)
    assert kept["shading"].on and kept["shading"].ms > 0.0


def test_an_effect_is_forced_off_and_back_to_what_the_scene_calls_for(scene):
    lit = picture(scene)
    overrides = scene.rle_splat.effect_overrides
    overrides.shading = "off"
    unlit = picture(scene)
    assert (rows(scene)["shading"].on, rows(scene)["shading"].reason) == (False, "by hand")
    scene.rle_splat.lighting = "NONE"
    overrides.shading = "auto"
    assert np.array_equal(picture(scene), unlit) and not np.array_equal(unlit, lit)
    scene.rle_splat.lighting = "SCENE"
    assert np.array_equal(picture(scene), lit)


def test_what_cannot_be_forced_on_is_refused_in_one_sentence(scene, refused):
    scene.rle_splat.effect_overrides.mesh_occlusion = "on"
    refused(bpy.ops.rle_splat.render_image, "the scene has no meshes")
    refused(bpy.ops.rle_splat.list_effects, "the scene has no meshes")


def test_what_is_forced_is_kept_in_the_file_and_copied_with_the_scene(scene, tmp_path):
    scene.rle_splat.effect_overrides.specular = "off"
    assert bpy.ops.rle_splat.list_effects() == {"FINISHED"}
    assert scene.copy().rle_splat.effect_overrides.specular == "off"
    path = str(tmp_path / "kept.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert bpy.context.scene.rle_splat.effect_overrides.specular == "auto"
    bpy.ops.wm.open_mainfile(filepath=path)
    again = bpy.context.scene.rle_splat
    assert again.effect_overrides.specular == "off"
    assert not again.effect_rows["specular"].on and again.effect_rows["specular"].reason == "by hand"


def test_the_panel_shows_a_row_with_an_override_for_each_effect(scene, bridge, monkeypatch):
    from tests.blender.test_panels import draw_all, texts

    effects = bridge("data.effects")
    log = draw_all(monkeypatch)
    for name in effects.TEXTS:
        assert ("prop", name.replace(" ", "_")) in log and effects.title(name) in texts(log)
    picture(scene)
    shown = texts(draw_all(monkeypatch))
    assert f"On, {rows(scene)['shading'].ms:.1f} ms: diffuse" in shown and "Off: the scene has no meshes" in shown
