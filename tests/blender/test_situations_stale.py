"""Pictures and what they were made from: edits from Python are read, and a followed backdrop follows every edit."""

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")


@pytest.fixture
def owner(addon, tmp_path):
    return scenes.cube_scene(tmp_path)


def two_colors(owner):
    """A ramp from red to blue, which the cube's value is in the middle of; returns the ramp."""
    ramp = owner.rle_splat.transfer.nodes["Color"].color_ramp
    while len(ramp.elements) < 2:
        ramp.elements.new(1.0)
    ramp.elements[0].position, ramp.elements[-1].position = 0.0, 1.0
    ramp.elements[0].color, ramp.elements[-1].color = (1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)
    owner.rle_splat.transfer.update_tag()
    return ramp


def test_B42_a_curve_edited_from_python(owner):
    assert scenes.picture_of()[1][..., 3].max() > 0.8
    scenes.lower_curve(owner)
    assert scenes.picture_of()[1][..., 3].max() == 0.0


def test_B43_a_stop_removed_from_python(owner):
    ramp = two_colors(owner)
    _, before = scenes.picture_of()
    assert before[..., 0].max() > 0.2 and before[..., 2].max() > 0.2
    ramp.elements.remove(ramp.elements[-1])
    _, after = scenes.picture_of()
    assert after[..., 0].max() > 0.2 and after[..., 2].max() == 0.0


@pytest.mark.parametrize("keyed", [False, True])
def test_B44_an_edit_from_python_with_persistent_data(owner, tmp_path, keyed):
    bpy.context.scene.render.use_persistent_data = True
    if keyed:  # on the colors; the curve is edited
        owner.rle_splat.transfer.keyframe_insert('nodes["Color"].color_ramp.elements[0].color', frame=1)
    bpy.ops.rle_splat.show_in_renders()
    assert scenes.rendered(tmp_path / "before.exr")[12, 12, 3] > 0.8
    scenes.lower_curve(owner)
    assert scenes.rendered(tmp_path / "after.exr")[..., 3].max() == 0.0


@pytest.fixture
def camera(owner):
    """The camera, whose backdrop follows."""
    assert bpy.ops.rle_splat.preview_in_camera_view(follow=True) == {"FINISHED"}
    return bpy.context.scene.camera


def follows(camera, edit):
    """After ``edit()`` the backdrop must be another, and the one that is made anew; no frame changes."""
    before = scenes.backdrop_of(camera)
    edit()
    scenes.update()
    after = scenes.backdrop_of(camera)
    assert after.shape != before.shape or np.abs(after - before).max() > 0.02
    np.testing.assert_allclose(after, scenes.set_anew(camera), atol=1e-6)


def test_B45_a_followed_transfer_function(owner, camera):
    ramp = two_colors(owner)
    scenes.update()
    follows(camera, lambda: setattr(ramp.elements[0], "color", (0.0, 1.0, 0.0, 1.0)))
    follows(camera, lambda: setattr(owner.rle_splat, "opacity_scale", 0.25))
    follows(camera, lambda: bpy.ops.rle_splat.apply_preset(preset="faint"))


def test_B45_an_edit_from_python_that_blender_does_not_tell(owner, camera):
    """Blender sends no update for a curve's points and a ramp's stops: the next update or frame shows them."""
    ramp = two_colors(owner)
    scenes.update()
    ramp.elements.remove(ramp.elements[-1])
    scenes.to_frame(2)
    shown = scenes.backdrop_of(camera)
    assert shown[..., 0].max() > 0.2 and shown[..., 2].max() == 0.0
    scenes.lower_curve(owner)
    camera.location.x += 1.0
    scenes.update()
    assert scenes.backdrop_of(camera)[..., 3].max() == 0.0


def test_B45_an_edit_from_python_is_in_the_saved_file(owner, camera, tmp_path):
    """Background mode has no timer that would notice an edit without an event."""
    scenes.lower_curve(owner)
    assert scenes.backdrop_of(camera)[..., 3].max() > 0.1
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "edited.blend"))
    (path,) = (tmp_path / "edited_rle_splat").glob("*Backdrop.exr")
    assert scenes.load_pixels(path)[..., 3].max() == 0.0


def test_B46_a_followed_camera(owner, camera):
    before = scenes.shown_at(scenes.backdrop_of(camera))
    follows(camera, lambda: setattr(camera.location, "x", 5.0))
    np.testing.assert_allclose(scenes.shown_at(scenes.backdrop_of(camera)) - before, (-4.0, 0.0), atol=0.1)
    follows(camera, lambda: setattr(camera.data, "ortho_scale", 18.0))


def test_B47_a_followed_volume(owner, camera):
    before = scenes.shown_at(scenes.backdrop_of(camera))
    follows(camera, lambda: setattr(owner.location, "x", 2.0))
    np.testing.assert_allclose(scenes.shown_at(scenes.backdrop_of(camera)) - before, (4.0, 0.0), atol=0.1)
    parent = bpy.data.objects.new("parent", None)
    bpy.context.scene.collection.objects.link(parent)
    owner.parent = parent
    follows(camera, lambda: setattr(parent.location, "y", 2.0))


def test_B48_a_followed_light(owner, tmp_path):
    owner.rle_splat.use_shading = True
    light = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    light.rotation_euler = (0.6, 0.0, 0.0)
    light.data.energy = 3.0
    bpy.context.scene.collection.objects.link(light)
    bpy.ops.rle_splat.preview_in_camera_view(follow=True)
    camera = bpy.context.scene.camera
    follows(camera, lambda: setattr(light.data, "energy", 0.5))
    follows(camera, lambda: setattr(light.data, "color", (0.0, 1.0, 0.0)))


def test_B49_a_followed_clip_object(owner, camera):
    follows(camera, lambda: bpy.ops.rle_splat.add_cutting_object(kind="PLANE"))
    arrow = bpy.context.object
    scenes.activate(owner)
    follows(camera, lambda: setattr(arrow.location, "z", 1.0))
    follows(camera, lambda: setattr(arrow.rle_splat, "clip_keep", "OUTSIDE"))


def test_B50_a_followed_quality_and_mode(owner, camera):
    settings = bpy.context.scene.rle_splat
    follows(camera, lambda: setattr(settings, "mode", "mip"))
    follows(camera, lambda: setattr(settings, "mode", "composite"))
    follows(camera, lambda: setattr(settings, "classification", "pre"))


def test_B51_a_followed_size(owner, camera):
    follows(camera, lambda: setattr(bpy.context.scene.render, "resolution_percentage", 50))
    assert scenes.backdrop_of(camera).shape == (12, 12, 4)


def test_B52_a_followed_mesh(owner, camera):
    plane = scenes.add_mesh([(-9, -9, 0), (3, -9, 0), (3, 15, 0), (-9, 15, 0)], [(0, 1, 2, 3)])
    plane.location.z = -5.0
    assert bpy.ops.rle_splat.preview_in_camera_view(follow=True, place="FRONT") == {"FINISHED"}
    follows(camera, lambda: setattr(plane.location, "z", 10.0))
