"""Whose picture is whose: pictures belong to a volume and a camera, whatever they and other datablocks are called."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

DATA = Path(__file__).resolve().parent / "data"
LONG = "sub-01_ses-02_acq-highres_run-01_desc-prep_"  # what T1w and T2w of one session agree in


def users_image(name):
    """An image that the user painted and looks at."""
    image = bpy.data.images.new(name, 5, 3, float_buffer=True)
    painted = np.linspace(0.0, 1.0, 60, dtype=np.float32)
    painted[3::4] = 1.0  # it has no alpha
    image.pixels.foreach_set(painted)
    image.use_fake_user = True
    image.pack()
    return image


def follow():
    """Set the active volume's backdrop to follow; returns the camera."""
    assert bpy.ops.rle_splat.preview_in_camera_view(follow=True) == {"FINISHED"}
    return bpy.context.scene.camera


def follows(camera, frame=2):
    """Move the camera's object by two units and the frame on; whether the one backdrop went along."""
    before = scenes.shown_at(scenes.backdrop_of(camera))
    camera.location.x += 2.0
    scenes.to_frame(frame)
    moved = scenes.shown_at(scenes.backdrop_of(camera)) - before
    return moved == pytest.approx((-4.0, 0.0), abs=0.1)


def test_B1_an_image_of_the_users_with_our_backdrops_name(addon, tmp_path):
    scenes.cube_scene(tmp_path)
    own = users_image("cube Splat Backdrop")
    painted = scenes.image_pixels(own)
    camera = follow()
    assert scenes.backdrops(camera) != [own] and follows(camera)
    assert tuple(own.size) == (5, 3)
    np.testing.assert_array_equal(scenes.image_pixels(own), painted)
    scenes.save_and_reload(tmp_path / "saved.blend")
    np.testing.assert_array_equal(scenes.image_pixels(bpy.data.images["cube Splat Backdrop"]), painted)


def test_B2_an_image_of_the_users_with_our_pictures_name(addon, tmp_path):
    scenes.cube_scene(tmp_path)
    own = users_image("cube Splat")
    painted = scenes.image_pixels(own)
    image, first = scenes.picture_of()
    count = len(bpy.data.images)
    for _ in range(2):
        again, pixels = scenes.picture_of()
        assert again == image and len(bpy.data.images) == count
        np.testing.assert_array_equal(pixels, first)
    np.testing.assert_array_equal(scenes.image_pixels(own), painted)


def test_B3_a_copy_of_our_picture_is_the_users(addon, tmp_path):
    scenes.cube_scene(tmp_path)
    image, pixels = scenes.picture_of()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))  # Blender copies no pixels that were not saved
    copy = image.copy()
    camera = bpy.context.scene.camera
    entry = camera.data.background_images.new()
    entry.image, entry.alpha = copy, 0.25
    camera.location.x += 2.0
    bpy.ops.rle_splat.preview_in_camera_view()
    assert len(camera.data.background_images) == 2 and entry.image == copy and entry.alpha == 0.25
    np.testing.assert_array_equal(scenes.image_pixels(copy), pixels)
    assert bpy.ops.rle_splat.remove_from_camera_view() == {"FINISHED"}
    assert scenes.backdrops(camera) == [copy]
    assert not bpy.ops.rle_splat.remove_from_camera_view.poll()
    scenes.picture_of()
    scenes.save_and_reload(tmp_path / "saved.blend")
    shown = bpy.context.scene.camera.data.background_images[0].image
    np.testing.assert_array_equal(scenes.image_pixels(shown), pixels)


def two_pictures(first, second):
    """Render both, one after the other: the first's image must be its own and stay as it was."""
    scenes.activate(first)
    image, pixels = scenes.picture_of()
    scenes.activate(second)
    other, others = scenes.picture_of()
    assert other != image
    np.testing.assert_array_equal(scenes.image_pixels(image), pixels)
    assert np.abs(others - pixels).max() > 0.1
    scenes.activate(first)
    assert scenes.picture_of()[0] == image


def two_backdrops(first, second):
    """The followed backdrop is the volume's that it was asked for, whatever is done with the other."""
    scenes.activate(second)
    scenes.picture_of()
    bpy.ops.rle_splat.preview_in_camera_view()
    scenes.activate(first)
    camera = follow()
    before = scenes.backdrop_of(camera)
    scenes.activate(second)
    scenes.picture_of()
    scenes.to_frame(2)
    np.testing.assert_allclose(scenes.backdrop_of(camera), before, atol=1e-6)


def test_B4_names_that_agree_in_40_letters(addon, tmp_path):
    first = scenes.cube_scene(tmp_path, name=f"{LONG}T1w")
    second = scenes.add_cube(tmp_path, name=f"{LONG}T2w", color=scenes.BLUE)
    second.location.y += 2.0
    assert first.name[:40] == second.name[:40] and first.name != second.name
    two_pictures(first, second)
    two_backdrops(first, second)


def test_B5_a_name_that_is_used_again(addon, tmp_path):
    first = scenes.cube_scene(tmp_path)
    image, pixels = scenes.picture_of()
    camera = follow()
    first.name = "another"
    second = scenes.add_cube(tmp_path, color=scenes.BLUE)
    second.location.y += 2.0
    assert second.name == "cube"
    other, _ = scenes.picture_of()
    assert other != image
    np.testing.assert_array_equal(scenes.image_pixels(image), pixels)
    shown = scenes.backdrop_of(camera)
    scenes.to_frame(2)
    np.testing.assert_allclose(scenes.backdrop_of(camera), shown, atol=1e-6)


def test_B6_a_local_and_a_linked_volume_of_one_name(addon, tmp_path):
    scenes.cube_scene(tmp_path)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    (tmp_path / "here").mkdir()
    local = scenes.cube_scene(tmp_path / "here", color=scenes.BLUE)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, target):
        target.objects = ["cube"]
    linked = target.objects[0]
    bpy.context.scene.collection.objects.link(linked)
    assert linked.library is not None and linked.name == local.name
    two_pictures(linked, local)
    two_backdrops(local, linked)


def test_B7_a_renamed_volume(addon, tmp_path):
    owner = scenes.cube_scene(tmp_path)
    image, _ = scenes.picture_of()
    camera = follow()
    owner.name = "patient"
    assert follows(camera)
    count = len(bpy.data.images)
    assert scenes.picture_of()[0] == image and len(bpy.data.images) == count


def test_B8_a_renamed_image(addon, tmp_path):
    scenes.cube_scene(tmp_path)
    image, _ = scenes.picture_of()
    image.name = "my picture"
    assert scenes.picture_of()[0] == image
    camera = follow()
    scenes.backdrops(camera)[0].name = "my backdrop"
    assert follows(camera)
    assert scenes.backdrops(camera)[0].name == "my backdrop"


def test_B9_a_renamed_channel(addon, tmp_path):
    owner = scenes.cube_scene(tmp_path)
    channel = scenes.add_cube(tmp_path, "other", scenes.BLUE)
    scenes.activate(owner, channel)
    assert bpy.ops.rle_splat.add_channels() == {"FINISHED"}
    _, both = scenes.picture_of()
    assert both[..., 0].max() > 0.1 and both[..., 2].max() > 0.1
    channel.name = "renamed"
    np.testing.assert_array_equal(scenes.picture_of()[1], both)
