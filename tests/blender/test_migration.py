"""Files saved by version 0.1.0, whose pictures were found by name, and by 0.2.0 open with everything in them found;
what later versions removed is replaced."""

import shutil
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender import scenes
from tests.blender.linking import bring

pytestmark = pytest.mark.usefixtures("by_numpy")

SAVED = Path(__file__).parent / "data"


@pytest.fixture
def opened(addon, tmp_path):
    """The scene of a copy of the file: two volumes, a followed backdrop of the first, the second composited."""
    for path in SAVED.iterdir():
        shutil.copyfile(path, tmp_path / path.name)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved_by_0_1_0.blend"))
    return bpy.context.scene


def test_volumes_and_transfer_functions_are_there(opened, bridge):
    first, second = (bpy.data.objects[name] for name in ("first", "second"))
    expected = np.add.outer(np.add.outer(np.arange(5), np.arange(6)), np.arange(7)) * 12
    np.testing.assert_array_equal(bridge("volumes.volumes").load_volume(first).voxels, expected)
    np.testing.assert_array_equal(bridge("volumes.volumes").load_volume(second).voxels, 255 - expected)
    assert first.rle_splat.window_center == 77.0 and second.rle_splat.opacity_scale == 0.5
    names = [bridge("look.transfer").read_transfer(one).name for one in (first, second)]
    assert len(set(names)) == 2 and all(names)


def test_B12_the_backdrop_is_ours_again_and_follows(opened):
    camera = opened.camera
    image = camera.data.background_images[0].image
    before, count = scenes.image_pixels(image), len(bpy.data.images)
    assert before[..., 3].max() > 0.01
    camera.location.x += 1.0
    bpy.context.view_layer.update()
    assert [entry.image for entry in camera.data.background_images] == [image] and len(bpy.data.images) == count
    assert np.abs(scenes.image_pixels(image) - before).max() > 0.01
    assert bpy.ops.rle_splat.remove_from_camera_view() == {"FINISHED"} and not camera.data.background_images


def test_the_last_depth_image_is_written_over_by_its_own_volume_alone(opened):
    depth = bpy.data.images["first Splat Depth"]
    for name, same in (("first", True), ("second", False)):
        bpy.context.view_layer.objects.active = bpy.data.objects[name]
        assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
        assert (opened.rle_splat.depth_image == depth) == same


def test_the_compositing_works_and_is_taken_out(opened, tmp_path):
    scene, count = opened, len(bpy.data.images)
    scenes.use_cycles((16, 16))
    scene.rle_splat.backdrop_follows = False
    assert scenes.rendered(tmp_path / "out.exr")[..., 3].max() > 0.01 and scene.rle_splat.message == ""
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    assert len(bpy.data.images) <= count + 1  # of the render itself: ours is the one of before
    assert bpy.ops.rle_splat.remove_from_renders() == {"FINISHED"}


def test_saved_again_it_is_a_file_of_today(opened, tmp_path):
    image = opened.camera.data.background_images[0].image
    before = scenes.image_pixels(image)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "again.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "again.blend"))
    image = bpy.context.scene.camera.data.background_images[0].image
    np.testing.assert_array_equal(scenes.image_pixels(image), before)
    assert bpy.ops.rle_splat.remove_from_camera_view.poll()


def test_a_file_of_version_0_2_0_opens_with_its_settings_and_renders(addon, bridge, tmp_path):
    """What it saved: 'refined' with records of 6 bytes, a mode and a lighting of the scene, a cut, a composite."""
    for path in SAVED.iterdir():
        shutil.copyfile(path, tmp_path / path.name)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved_by_0_2_0.blend"))
    scene, first = bpy.context.scene, bpy.data.objects["first"]
    settings, own = scene.rle_splat, first.rle_splat
    expected = np.add.outer(np.add.outer(np.arange(5), np.arange(6)), np.arange(7)) * 12
    np.testing.assert_array_equal(bridge("volumes.volumes").load_volume(first).voxels, expected)
    assert (own.window_center, own.window_width, own.opacity_scale) == (90.0, 120.0, 0.5)
    assert (own.use_gradient_opacity, own.gradient_high, own.clip_keep) == (True, 60.0, "OUTSIDE")
    assert (own.mode, own.lighting) == ("mip", "HEADLIGHT"), "of the scene, then"
    assert (settings.use_shadows, settings.ambient_occlusion) == (False, 0.25)
    assert settings.clip_objects == bpy.data.collections["Cuts"] and settings.composite_object == first
    assert (settings.classification, settings.record) == ("post", "16")
    for removed in ("backend", "'refined'"):
        assert removed in settings.message
    settings.message = ""
    scenes.use_cycles((16, 16))
    assert scenes.rendered(tmp_path / "out.exr")[..., 3].max() > 0.01 and settings.message == ""


@pytest.mark.parametrize("way", ("open", "append", "link"))
def test_a_classification_that_was_removed_is_replaced_with_a_message(addon, bridge, tmp_path, way):
    """The numbers of the others are those of earlier versions: 0 and 2."""
    scene, saved, read = bpy.context.scene, str(tmp_path / "saved.blend"), bridge("data.settings").quality_of
    scene.name = "Saved"
    group = type(scene.rle_splat)
    items = group.bl_rna.properties["classification"].enum_items
    assert [(item.identifier, item.value) for item in items] == [("pre", 0), ("post", 2)]
    scene.rle_splat.quality, scene.rle_splat.record = "fine", "8"  # which chooses pre
    scene.rle_splat["classification"] = 1  # refined
    bpy.ops.wm.save_as_mainfile(filepath=saved)
    with pytest.warns(FutureWarning, match="'post' with the record 16 is used"):  # as of a keyframe, which stays
        assert read(scene) == read(scene).preset("fine")
    if way == "open":
        bpy.ops.wm.open_mainfile(filepath=saved)
    else:
        bpy.ops.wm.read_homefile(use_empty=True)
        with bpy.data.libraries.load(saved, link=way == "link") as (there, here):
            here.scenes = there.scenes
    settings = bpy.data.scenes["Saved"].rle_splat
    if way == "link":  # linked data is left alone, and rendered as with a keyframe
        assert (settings.classification, settings.record, settings.quality, settings.message) == ("", "8", "fine", "")
        with pytest.warns(FutureWarning, match="'post' with the record 16 is used"):
            assert read(bpy.data.scenes["Saved"]) == read(bpy.data.scenes["Saved"]).preset("fine")
        return
    assert (settings.classification, settings.record, settings.quality) == ("post", "16", "fine")
    assert settings.message == "The classification 'refined' was removed; 'post' with the record 16 is used instead."
    assert read(bpy.data.scenes["Saved"]) == read(bpy.data.scenes["Saved"]).preset("fine")


def test_other_values_and_settings_that_were_removed(addon, tmp_path):
    settings, saved = bpy.context.scene.rle_splat, str(tmp_path / "saved.blend")
    removed = {"minification": 2, "use_previews": False, "backend": 2}  # pool, numpy
    settings.quality, settings.classification = "custom", "pre"
    for name, value in removed.items():
        settings[name] = value
    bpy.ops.wm.save_as_mainfile(filepath=saved)
    for message in (
        "The setting use_previews was removed; pictures that take long show a draft first. "
        "The setting backend was removed; numba is used where it can be loaded, and numpy elsewhere. "
        "The minification 'pool' was removed; 'widen' is used instead.",
        "",
    ):  # the second time nothing is left of them
        bpy.ops.wm.open_mainfile(filepath=saved)
        settings = bpy.context.scene.rle_splat
        assert (settings.minification, settings.message) == ("widen", message)
        settings.message = ""
        bpy.ops.wm.save_as_mainfile(filepath=saved)
    for name, value in (("use_previews", True), ("backend", "auto")):
        settings.message = ""
        setattr(settings, name, False)  # as a script does
        assert settings.message.startswith(f"The setting {name} was removed; ") and getattr(settings, name) == value


def test_records_that_were_removed_are_replaced_with_a_message(addon, tmp_path):
    """Their numbers are those of earlier versions: 2 and 3."""
    settings = bpy.context.scene.rle_splat
    items = type(settings).bl_rna.properties["record"].enum_items
    assert [(item.identifier, item.value) for item in items] == [("16", 0), ("8", 1)]
    settings.classification = "pre"
    for number, record in ((2, 6), (3, 4)):
        settings["record"] = number
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
        settings = bpy.context.scene.rle_splat
        assert (settings.record, settings.classification) == ("8", "pre")
        assert settings.message == f"The record {record} was removed; 8 is used instead."


def test_mode_and_lighting_of_a_scene_become_those_of_its_volumes(addon, tmp_path):
    """Their numbers are those of earlier versions: mip is 2, grays are on, unlit is 2."""
    saved = str(tmp_path / "saved.blend")
    _first, second = (scenes.import_raw(tmp_path, np.ones((3, 4, 5), np.uint8), name=name) for name in ("a", "b"))
    second.rle_splat.lighting = "HEADLIGHT"  # as a later version has set it
    settings = bpy.context.scene.rle_splat
    for name, number in {"mode": 2, "use_grays": 1, "lighting": 2}.items():
        settings[name] = number
    bpy.ops.wm.save_as_mainfile(filepath=saved)
    for _again in (False, True):
        bpy.ops.wm.open_mainfile(filepath=saved)
        found = [bpy.data.objects[name].rle_splat for name in ("a", "b")]
        assert [one.mode for one in found] == ["mip", "mip"] and all(one.use_grays for one in found)
        assert [one.lighting for one in found] == ["NONE", "HEADLIGHT"]
        settings = bpy.context.scene.rle_splat
        assert (settings.mode, settings.lighting, settings.message) == ("mip", "NONE", "")
        assert settings.get("mode") is None
        bpy.ops.wm.save_as_mainfile(filepath=saved)


def test_an_animated_mode_of_a_scene_leaves_a_sentence(addon, tmp_path):
    scene, saved = bpy.context.scene, str(tmp_path / "saved.blend")
    scene.rle_splat.keyframe_insert("max_error")
    (curve,) = scene.animation_data.action.layers[0].strips[0].channelbags[0].fcurves
    curve.data_path = "rle_splat.mode"
    bpy.ops.wm.save_as_mainfile(filepath=saved)
    bpy.ops.wm.open_mainfile(filepath=saved)
    assert "belong to each volume now" in bpy.context.scene.rle_splat.message


@pytest.mark.parametrize("how", ["link", "override"])
def test_an_earlier_scenes_mode_reaches_overrides_and_a_linked_volume_leaves_a_sentence(library, how, tmp_path):
    name = bring(library, how).name
    bpy.context.scene.rle_splat["mode"] = 2  # mip, as earlier versions stored it
    saved = str(tmp_path / "earlier.blend")
    bpy.ops.wm.save_as_mainfile(filepath=saved)
    for _again in (False, True):
        bpy.ops.wm.open_mainfile(filepath=saved)
        found = [one for one in bpy.context.scene.objects if one.rle_splat.is_volume]
        message = bpy.context.scene.rle_splat.message
        assert [one.rle_splat.mode for one in found] == ["composite" if how == "link" else "mip"]
        assert ("make a library override" in message and repr(name) in message) == (how == "link")
        bpy.ops.wm.save_as_mainfile(filepath=saved)


def test_highlights_that_were_phongs_have_four_times_the_shininess(addon, bridge, tmp_path):
    """``highlight`` was 1 for Phong, 0 for Blinn-Phong."""
    saved, read = str(tmp_path / "saved.blend"), bridge("look.transfer").read_transfer
    for name, number in {"a": 1, "b": 0, "c": None}.items():
        own = scenes.import_raw(tmp_path, np.ones((3, 4, 5), np.uint8), name=name).rle_splat
        own.shininess = 7.5
        if number is not None:
            own["highlight"] = number
    bpy.ops.wm.save_as_mainfile(filepath=saved)
    for _again in (False, True):
        bpy.ops.wm.open_mainfile(filepath=saved)
        assert [read(bpy.data.objects[name]).shade.shininess for name in "abc"] == [30.0, 7.5, 7.5]
        assert bpy.context.scene.rle_splat.message == ""
        bpy.ops.wm.save_as_mainfile(filepath=saved)
