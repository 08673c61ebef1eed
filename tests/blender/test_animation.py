"""Every rendered frame is splatted anew: animated camera, volume, transfer function and meshes."""

import json

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy", "classified_first")

N = 9
ALPHA = 0.1


@pytest.fixture
def volume(tmp_path):
    owner = scenes.even_cube(tmp_path, N, ALPHA, (1.0, 0.5, 0.25))
    scene = scenes.use_cycles((32, 32))
    scene.frame_start, scene.frame_end = 1, 3
    scenes.add_camera((4.0, 4.0, 30.0), type="ORTHO", ortho_scale=32.0)
    scene.rle_splat.quality = "fine"
    return owner


def animated(tmp_path):
    """Render the animation; alpha (H, W) of each frame."""
    scenes.write_exr(tmp_path / "frame_####.exr")
    bpy.ops.render.render(animation=True)
    scene = bpy.context.scene
    return [scenes.load_pixels(tmp_path / f"frame_{frame:04d}.exr")[..., 3]
            for frame in range(scene.frame_start, scene.frame_end + 1)]  # fmt: skip


def key_linear(owner, path, values, index=-1):
    """Keyframe a property of ``owner`` at frames 1, 2, 3..."""
    for frame, value in enumerate(values, start=1):
        if index >= 0:
            getattr(owner, path)[index] = value
        else:
            setattr(owner, path, value)
        owner.keyframe_insert(path, index=index, frame=frame)


def test_a_moving_camera_and_a_moving_volume(volume, tmp_path):
    bpy.ops.rle_splat.show_in_renders()
    key_linear(bpy.context.scene.camera, "location", (4.0, 5.0, 6.0), index=0)
    key_linear(volume, "location", (0.0, 2.0, 4.0), index=1)
    middles = np.array([scenes.centroid(alpha) for alpha in animated(tmp_path)])
    pixels = 32 / 32.0
    np.testing.assert_allclose(
        middles - middles[0], [(0, 0), (-pixels, -2 * pixels), (-2 * pixels, -4 * pixels)], atol=0.05
    )


def test_the_compositor_on_the_graphics_card_reads_the_new_picture(volume, tmp_path):
    """Nothing of an earlier frame's texture is used again."""
    scenes.skip_without_graphics()
    bpy.ops.rle_splat.show_in_renders()
    bpy.context.scene.render.compositor_device = "GPU"
    key_linear(bpy.context.scene.camera, "location", (4.0, 5.0, 6.0), index=0)
    middles = np.array([scenes.centroid(alpha) for alpha in animated(tmp_path)])
    np.testing.assert_allclose(middles - middles[0], [(0, 0), (-1, 0), (-2, 0)], atol=0.05)


def test_a_reloaded_file_goes_on_splatting(volume, tmp_path):
    bpy.ops.rle_splat.show_in_renders()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    key_linear(bpy.context.scene.camera, "location", (4.0, 5.0, 6.0), index=0)
    middles = np.array([scenes.centroid(alpha) for alpha in animated(tmp_path)])
    np.testing.assert_allclose(middles - middles[0], [(0, 0), (-1, 0), (-2, 0)], atol=0.05)


def test_an_animated_transfer_function(volume, tmp_path):
    bpy.ops.rle_splat.show_in_renders()
    key_linear(volume.rle_splat, "opacity_scale", (1.0, 0.5, 0.0))
    frames = animated(tmp_path)
    for alpha, scale in zip(frames, (1.0, 0.5, 0.0)):
        assert alpha[16, 16] == pytest.approx(1.0 - (1.0 - ALPHA * scale) ** N, abs=1 / 255)


def test_all_frames_have_the_plan_of_the_first(volume, tmp_path):
    settings = bpy.context.scene.rle_splat
    settings.classification = "post"
    bpy.ops.rle_splat.show_in_renders()
    key_linear(volume.rle_splat, "opacity_scale", (1.0, 0.5, 0.2))
    animated(tmp_path)
    plan = json.loads(settings.last_report_json)["plan"]
    assert plan["quality"] == "fine" and plan["held"] and plan["why"] in settings.last_report.split("\n")
    assert plan["why"] == "The settings of the first frame are used."


def test_a_mesh_that_rises_through_the_volume(volume, tmp_path):
    rising = scenes.add_mesh([(-5, -5, 0), (14, -5, 0), (14, 14, 0), (-5, 14, 0)], [(0, 1, 2, 3)], (0.0, 0.0, 0.0))
    key_linear(rising, "location", (-5.0, 2.5, 12.0), index=2)
    bpy.ops.rle_splat.show_in_renders()
    image = bpy.context.scene.rle_splat.composite_image
    seen = []

    def note(*_):
        seen.append(float(scenes.image_pixels(image)[16, 16, 3]))

    bpy.app.handlers.render_post.append(note)
    try:
        animated(tmp_path)
    finally:
        bpy.app.handlers.render_post.remove(note)
    expected = [1.0 - (1.0 - ALPHA) ** length for length in (N, N - 0.5 - 2.5, 0.0)]
    np.testing.assert_allclose(seen, expected, atol=1 / 255)


def test_a_camera_bound_to_a_marker(volume, tmp_path):
    scene, first = bpy.context.scene, bpy.context.scene.camera
    second = scenes.add_camera((7.0, 4.0, 30.0), type="ORTHO", ortho_scale=32.0)
    scene.camera = first
    for frame, camera in ((1, first), (2, second)):
        scene.timeline_markers.new(f"cut {frame}", frame=frame).camera = camera
    bpy.ops.rle_splat.show_in_renders()
    frames = animated(tmp_path)
    moved = scenes.centroid(frames[1]) - scenes.centroid(frames[0])
    np.testing.assert_allclose(moved, (-3.0, 0.0), atol=0.05)


def test_two_view_layers_and_motion_blur_splat_each_frame_once(volume, bridge, tmp_path, monkeypatch):
    """One of the view layers alone is composited, and motion blur visits it three times."""
    scene = bpy.context.scene
    scene.view_layers.new("second")
    scene.render.use_motion_blur = True
    scenes.add_mesh([(60, 0, 0), (61, 0, 0), (60, 1, 0)], [(0, 1, 2)], (1.0, 1.0, 1.0))
    key_linear(scene.camera, "location", (4.0, 5.0, 6.0), index=0)
    bpy.ops.rle_splat.show_in_renders()
    scenes_read, calls = bridge("scene.render_scene"), []
    read = scenes_read.read_scenes
    monkeypatch.setattr(
        scenes_read, "read_scenes", lambda o, d, **k: (calls.append(d.scene.frame_current), read(o, d, **k))[1]
    )
    frames = animated(tmp_path)
    assert calls == [1, 2, 3]
    np.testing.assert_allclose(scenes.centroid(frames[0]), (16.0, 16.0), atol=0.05)  # at the frame, not a subframe
    moved = scenes.centroid(frames[2]) - scenes.centroid(frames[0])
    np.testing.assert_allclose(moved, (-2.0, 0.0), atol=0.05)


def test_what_did_not_change_is_not_made_again(volume, bridge, tmp_path):
    bpy.ops.rle_splat.show_in_renders()
    key_linear(bpy.context.scene.camera, "location", (4.0, 5.0, 6.0), index=0)
    kept = bridge("scene.render_scene").KEPT
    kept.clear()
    kept.made.clear()
    animated(tmp_path)
    assert {"visible", "records"} <= kept.made.keys() and set(kept.made.values()) == {1}


def test_a_frame_that_does_not_see_the_volume_is_transparent_and_no_failure(volume, tmp_path):
    bpy.ops.rle_splat.show_in_renders()
    key_linear(bpy.context.scene.camera, "location", (4.0, 400.0, 4.0), index=0)
    frames = animated(tmp_path)
    assert frames[0].max() > 0.3 and frames[1].max() == 0.0 and frames[2].max() > 0.3
    assert bpy.context.scene.rle_splat.message == ""


def test_a_frame_that_fails_is_a_placeholder_and_the_next_is_right_again(volume, tmp_path):
    bpy.ops.rle_splat.show_in_renders()
    key_linear(volume, "scale", (1.0, 0.0, 1.0), index=2)
    frames = animated(tmp_path)
    assert frames[1].min() == 1.0
    np.testing.assert_allclose([frames[0][16, 16], frames[2][16, 16]], 1.0 - (1.0 - ALPHA) ** N, atol=1 / 255)
