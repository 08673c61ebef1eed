"""Copies of volumes, cameras and scenes: what is copied gets pictures of its own and leaves the first's alone."""

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")


def own_pictures(first, copy, camera):
    """The copy, moved up, gets images of its own; the first's picture and followed backdrop stay the first's."""
    image = bpy.context.scene.rle_splat.image
    pixels, backdrop = scenes.image_pixels(image), scenes.backdrop_of(camera)
    copy.location.y += 2.0
    scenes.activate(copy)
    other, moved = scenes.picture_of()
    assert other != image and other not in scenes.backdrops(camera)
    np.testing.assert_allclose(scenes.shown_at(moved) - scenes.shown_at(pixels), (0.0, -4.0), atol=0.1)
    np.testing.assert_array_equal(scenes.image_pixels(image), pixels)
    scenes.to_frame(2)
    np.testing.assert_allclose(scenes.backdrop_of(camera), backdrop, atol=1e-6)
    scenes.activate(first)
    assert scenes.picture_of()[0] == image
    np.testing.assert_allclose(scenes.image_pixels(image), pixels, atol=1e-6)


@pytest.fixture
def shown(addon, tmp_path):
    """(volume, camera): with a picture and a backdrop that follows."""
    owner = scenes.cube_scene(tmp_path)
    assert bpy.ops.rle_splat.preview_in_camera_view(follow=True) == {"FINISHED"}
    scenes.picture_of()
    scenes.activate(owner)
    return owner, bpy.context.scene.camera


def test_B13_a_volume_copied_by_shift_d(shown):
    owner, camera = shown
    assert bpy.ops.object.duplicate() == {"FINISHED"}
    copy = bpy.context.object
    assert copy != owner and copy.rle_splat.is_volume
    own_pictures(owner, copy, camera)


def test_B14_a_volume_copied_by_alt_d(shown):
    owner, camera = shown
    assert bpy.ops.object.duplicate(linked=True) == {"FINISHED"}
    own_pictures(owner, bpy.context.object, camera)


def two_scenes(first, second, tmp_path):
    """Pictures and renders made in ``second``, whose camera is elsewhere, change nothing of ``first``."""
    image, pixels = first.rle_splat.image, scenes.image_pixels(first.rle_splat.image)
    assert second != first
    data = second.camera.data.copy()
    second.camera = bpy.data.objects.new("its own", data)
    second.collection.objects.link(second.camera)
    second.camera.location = (5.0, 3.0, 30.0)
    volume = next(one for one in second.objects if one.rle_splat.is_volume)
    with scenes.in_scene(second):
        scenes.activate(volume)
        other, moved = scenes.picture_of(second)
    assert other != image
    np.testing.assert_allclose(scenes.shown_at(moved) - scenes.shown_at(pixels), (-4.0, 0.0), atol=0.1)
    np.testing.assert_array_equal(scenes.image_pixels(image), pixels)
    for scene, seen in ((second, moved), (first, pixels)):
        with scenes.in_scene(scene):
            render = scenes.rendered(tmp_path / f"{scene.name}.exr", scene=scene.name)
        np.testing.assert_allclose(scenes.shown_at(render), scenes.shown_at(seen), atol=0.1)
    with scenes.in_scene(first):
        assert scenes.picture_of(first)[0] == image


def copied_scene(tmp_path, kind):
    scenes.cube_scene(tmp_path)
    first = bpy.context.scene
    bpy.ops.rle_splat.show_in_renders()
    scenes.picture_of()
    assert bpy.ops.scene.new(type=kind) == {"FINISHED"}
    two_scenes(first, bpy.context.scene, tmp_path)


def test_B15_a_scene_copied_in_full(addon, tmp_path):
    copied_scene(tmp_path, "FULL_COPY")


def test_B16_a_scene_copied_with_linked_objects(addon, tmp_path):
    copied_scene(tmp_path, "LINK_COPY")


def test_B10_a_camera_switched_by_a_marker(addon, tmp_path):
    scenes.cube_scene(tmp_path)
    scene, first = bpy.context.scene, bpy.context.scene.camera
    second = scenes.add_camera((5.0, 3.0, 30.0), type="ORTHO", ortho_scale=12.0)
    scene.camera = first
    for frame, camera in ((1, first), (2, second)):
        scene.timeline_markers.new(f"cut {frame}", frame=frame).camera = camera
    assert bpy.ops.rle_splat.preview_in_camera_view(follow=True, place="FRONT") == {"FINISHED"}
    seen = scenes.backdrop_of(first)
    scenes.to_frame(2)
    assert scene.camera == second
    moved = scenes.shown_at(scenes.backdrop_of(second)) - scenes.shown_at(seen)
    np.testing.assert_allclose(moved, (-4.0, 0.0), atol=0.1)
    entry = second.data.background_images[0]
    assert second.data.show_background_images and entry.frame_method == "STRETCH" and entry.display_depth == "FRONT"
    np.testing.assert_array_equal(scenes.backdrop_of(first), seen)
    scenes.to_frame(1)
    np.testing.assert_allclose(scenes.backdrop_of(first), seen, atol=1e-6)
    assert len(scenes.backdrops(second)) == 1


def test_B11_two_scenes_that_follow_one_volume(addon, tmp_path):
    owner = scenes.cube_scene(tmp_path)
    first, second = bpy.context.scene, bpy.data.scenes.new("second")
    second.collection.objects.link(owner)
    second.rle_splat.scene_scale = 1.0
    second.render.resolution_x, second.render.resolution_y = 16, 12
    second.camera = first.camera.copy()
    second.camera.data = first.camera.data.copy()
    second.collection.objects.link(second.camera)
    for scene in (first, second):
        with scenes.in_scene(scene):
            scenes.activate(owner)
            assert bpy.ops.rle_splat.preview_in_camera_view(follow=True) == {"FINISHED"}
    for frame in (2, 3):
        owner.location.x += 1.0
        for scene in (first, second, first):
            scene.frame_set(frame)
        large, small = scenes.backdrop_of(first.camera), scenes.backdrop_of(second.camera)
        assert large.shape == (24, 24, 4) and small.shape == (12, 16, 4)
        middle = scenes.shown_at(large)
        assert middle == pytest.approx((12.0 + 2.0 * (frame - 1), 12.0), abs=1.0)
        assert scenes.shown_at(small) == pytest.approx((middle - 12.0) * 16 / 24 + (8.0, 6.0), abs=0.5)


def test_B95_a_camera_copied_by_shift_d(shown):
    """With its data, and so with an entry that shows the first camera's picture."""
    owner, first = shown
    before = scenes.backdrop_of(first)
    scenes.activate(first)
    bpy.ops.object.duplicate()
    copy = bpy.context.object
    assert copy.data != first.data and len(scenes.backdrops(copy)) == 1
    bpy.context.scene.camera = copy
    copy.location.x += 2.0
    scenes.activate(owner)
    assert bpy.ops.rle_splat.preview_in_camera_view(follow=True) == {"FINISHED"}
    for frame in (2, 3):
        np.testing.assert_allclose(
            scenes.shown_at(scenes.backdrop_of(copy)) - scenes.shown_at(before), (-4.0, 0.0), atol=0.1
        )
        np.testing.assert_array_equal(scenes.backdrop_of(first), before)
        scenes.to_frame(frame)
