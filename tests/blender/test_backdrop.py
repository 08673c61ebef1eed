"""Preview in Camera View: our picture fills the camera's frame exactly, the user's own background images stay.

How Blender draws a background image was measured in a window: with Stretch it fills the camera's frame for every
shift, sensor fit and pixel aspect, with Fit it does not.  Here the settings that decide it are asserted.
"""

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")


@pytest.fixture
def volume(tmp_path):
    owner = scenes.even_cube(tmp_path, 9, 0.3, (0.9, 0.5, 0.2))
    scenes.add_camera((4.0, 4.0, 30.0), type="ORTHO", ortho_scale=20.0, shift_x=0.1)
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y, render.pixel_aspect_x = 40, 32, 1.5
    return owner


@pytest.mark.parametrize("place", ["BACK", "FRONT"])
def test_the_backdrop_fills_the_frame(volume, place):
    assert bpy.ops.rle_splat.preview_in_camera_view(place=place) == {"FINISHED"}
    camera = bpy.context.scene.camera.data
    assert camera.show_background_images and len(camera.background_images) == 1
    entry = camera.background_images[0]
    assert tuple(entry.image.size) == (40, 32)
    assert (entry.frame_method, entry.display_depth, entry.alpha, entry.scale, entry.rotation) == (
        "STRETCH", place, 1.0, 1.0, 0.0)  # fmt: skip
    assert tuple(entry.offset) == (0.0, 0.0) and not entry.use_flip_x and not entry.use_flip_y
    picture = scenes.image_pixels(entry.image)
    # x = 4 is the middle; the shift of a tenth of the 60-wide fitted side (in pixels, 40 of 1.5) moves it left
    assert scenes.centroid(picture[..., 3])[0] == pytest.approx(20 - 0.1 * 40, abs=0.05)
    assert bpy.context.scene.rle_splat.backdrop_depth == place


def test_setting_it_again_keeps_one_entry_and_the_users_own(volume):
    camera = bpy.context.scene.camera.data
    own = camera.background_images.new()
    own.image = bpy.data.images.new("blueprint", 4, 4)
    own.alpha = 0.3
    bpy.ops.rle_splat.preview_in_camera_view()
    bpy.ops.rle_splat.preview_in_camera_view()
    assert len(camera.background_images) == 2
    assert camera.background_images[0].image.name == "blueprint"
    assert camera.background_images[0].alpha == pytest.approx(0.3)
    assert bpy.ops.rle_splat.remove_from_camera_view() == {"FINISHED"}
    assert [entry.image.name for entry in camera.background_images] == ["blueprint"]
    assert not bpy.ops.rle_splat.remove_from_camera_view.poll()


def test_in_front_meshes_cut_it_behind_they_do_not(volume):
    scenes.add_mesh([(-9, -9, 20), (19, -9, 20), (19, 19, 20), (-9, 19, 20)], [(0, 1, 2, 3)])
    for place, hidden in (("FRONT", True), ("BACK", False)):
        bpy.ops.rle_splat.preview_in_camera_view(place=place)
        alpha = scenes.image_pixels(bpy.context.scene.camera.data.background_images[0].image)[..., 3]
        assert (alpha.max() < 1e-6) == hidden


def test_it_follows_the_frame_only_when_told_to(volume):
    scene, camera = bpy.context.scene, bpy.context.scene.camera
    camera.keyframe_insert("location", frame=1)
    camera.location.x += 2.0
    camera.keyframe_insert("location", frame=2)
    scene.frame_set(1)
    bpy.ops.rle_splat.preview_in_camera_view()
    image = camera.data.background_images[0].image
    still = scenes.image_pixels(image)
    scene.frame_set(2)
    np.testing.assert_array_equal(scenes.image_pixels(image), still)
    scene.frame_set(1)
    bpy.ops.rle_splat.preview_in_camera_view(follow=True)
    scene.frame_set(2)
    moved = scenes.centroid(scenes.image_pixels(image)[..., 3]) - scenes.centroid(still[..., 3])
    np.testing.assert_allclose(moved, (-2.0 / 20.0 * 40, 0.0), atol=0.05)


def test_a_render_does_not_show_it(volume, tmp_path):
    scenes.use_cycles((40, 32))
    bpy.ops.rle_splat.preview_in_camera_view(place="FRONT")
    assert np.abs(scenes.rendered(tmp_path / "out.exr")).max() == 0.0
