"""Pictures cost no memory of undo: their pixels are in no step."""

import bpy
import numpy as np
import pytest

from tests.blender import scenes

SIZE = 64


@pytest.fixture
def scene(addon, tmp_path):
    scenes.import_raw(tmp_path, np.full((4, 4, 4), 100, np.uint8))
    scenes.add_camera()
    scene = bpy.context.scene
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    return scene


@pytest.mark.parametrize("make", ["render_image", "preview_in_camera_view", "show_in_renders"])
def test_steps_of_undo_hold_no_pixels(scene, make):
    """A step of undo is what a .blend would hold, and that holds an image's pixels only where they are packed."""
    assert getattr(bpy.ops.rle_splat, make)() == {"FINISHED"}
    images = [image for image in bpy.data.images if image.size[0] == SIZE]
    assert images and all(image.packed_file is None and image.source == "GENERATED" for image in images)


def test_pixels_outlive_undo_and_redo_of_other_steps(scene):
    bpy.ops.rle_splat.render_image()
    bpy.ops.ed.undo_push(message="picture")
    bpy.context.view_layer.objects.active.location.x += 1.0
    bpy.ops.ed.undo_push(message="moved")
    before = scenes.image_pixels(bpy.context.scene.rle_splat.image)
    for step in (bpy.ops.ed.undo, bpy.ops.ed.redo):
        step()
        np.testing.assert_array_equal(scenes.image_pixels(bpy.context.scene.rle_splat.image), before)


@pytest.mark.parametrize(
    "name", ["render_image", "preview_in_camera_view", "shadow_pass", "measure_accuracy", "error_map"]
)
def test_f9_does_not_make_a_picture_again(addon, name):
    """An operator with REGISTER is run anew, blocking, by every change in Blender's panel of the last operation."""
    assert "REGISTER" not in getattr(bpy.types, f"RLE_SPLAT_OT_{name}").bl_options
