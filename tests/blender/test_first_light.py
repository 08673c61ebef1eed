"""The light on the first volume of a scene: a headlight where the scene's lights leave it dark, and nobody chose."""

import bpy
import numpy as np
import pytest

from tests.blender import scenes

VOXELS = np.arange(5 * 6 * 7, dtype=np.uint8).reshape(5, 6, 7)


def add_light(energy: float):
    light = bpy.data.objects.new("Light", bpy.data.lights.new("Light", "POINT"))
    light.location, light.data.energy = (4.1, 1.0, 5.9), energy
    bpy.context.scene.collection.objects.link(light)


def add_default_view():
    scenes.add_camera((7.36, -6.93, 4.96), (1.109, 0.0, 0.815))


def import_raw(folder, name="scan", **options):
    path = folder / f"{name}.raw"
    path.write_bytes(VOXELS.tobytes())
    layout = dict(shape=VOXELS.shape[::-1], dtype="uint8", spacing=(1.0, 1.0, 1.0))
    assert bpy.ops.rle_splat.import_volume(filepath=str(path), **layout, **options) == {"FINISHED"}


def lighting() -> str:
    return bpy.context.scene.rle_splat.lighting


@pytest.mark.parametrize("energy, expected", ((1000.0, "HEADLIGHT"), (3000.0, "SCENE")))
def test_the_light_of_the_default_scene_is_too_weak_and_three_times_as_much_is_not(tmp_path, energy, expected):
    add_light(energy)
    add_default_view()
    import_raw(tmp_path, use_headlight=True)
    assert lighting() == expected


@pytest.mark.parametrize("energy, expected", ((1500.0, "HEADLIGHT"), (6000.0, "SCENE")))
def test_a_light_above_is_judged_from_the_sides_too(tmp_path, energy, expected):
    """Seen from above, where both are bright."""
    add_light(energy)
    scenes.add_camera((0.0, 0.0, 10.0))
    import_raw(tmp_path, use_headlight=True)
    assert lighting() == expected


@pytest.mark.parametrize("radiance, expected", ((0.01, "HEADLIGHT"), (0.5, "SCENE")))
def test_the_light_of_the_world_counts(tmp_path, radiance, expected):
    add_light(1000.0)
    scenes.gray_world(radiance)
    add_default_view()
    import_raw(tmp_path, use_headlight=True)
    assert lighting() == expected


def test_a_scene_without_lights_keeps_scene_lights_which_is_a_headlight_there(tmp_path):
    add_default_view()
    import_raw(tmp_path, use_headlight=True)
    assert lighting() == "SCENE"


def test_scripts_keep_the_scenes_lights(tmp_path):
    add_light(1000.0)
    add_default_view()
    import_raw(tmp_path)
    assert lighting() == "SCENE"


def test_later_volumes_are_lit_as_the_first_one_is(tmp_path):
    add_light(1000.0)
    add_default_view()
    import_raw(tmp_path)
    assert lighting() == "SCENE"
    import_raw(tmp_path, "another", use_headlight=True)
    assert lighting() == "SCENE"
    bpy.context.scene.rle_splat.lighting = "NONE"  # of all volumes, as scripts for earlier versions set it
    import_raw(tmp_path, "third", use_headlight=True)
    assert [one.rle_splat.lighting for one in bpy.data.objects if one.rle_splat.is_volume] == ["NONE"] * 3


def test_the_panel_says_that_the_scenes_lights_are_not_used(bridge):
    unused = bridge("scene.first_light").unused_lights
    assert unused(bpy.context.scene, "HEADLIGHT") == ""
    add_light(1000.0)
    assert unused(bpy.context.scene, "SCENE") == unused(bpy.context.scene, "BOTH") == ""
    assert "do not shine" in unused(bpy.context.scene, "HEADLIGHT")
