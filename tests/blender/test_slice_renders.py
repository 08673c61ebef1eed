"""Slices in renders: their grays, the light that they leave alone, and the volume before and behind them."""

import bpy
import numpy as np
import pytest

from tests.blender import scenes
from tests.blender.test_slices import HIGH, LOW, add, shown

pytestmark = pytest.mark.usefixtures("by_numpy")


def plateau_scene(tmp_path, size=(16, 16)):
    """An axial slice of a volume that is 60 in its lower and 180 in its upper layers, seen from above."""
    values = np.full((6, 8, 8), 60, np.uint8)
    values[3:] = 180
    owner = scenes.import_raw(tmp_path, values, name="plateau")
    owner.rle_splat.slices_follow_window = True
    assert bpy.ops.rle_splat.window_level(center=0.5 * (LOW + HIGH), width=HIGH - LOW) == {"FINISHED"}
    one = add(owner)
    scene = scenes.use_cycles(size)
    scenes.add_camera((3.5, 3.5, 30.0), type="ORTHO", ortho_scale=8.0)
    return scene, owner, one


def test_renders_show_the_gray_levels_frame_by_frame(addon, tmp_path):
    scene, _owner, one = plateau_scene(tmp_path)
    one.location.z = -2.0
    one.keyframe_insert("location", frame=1)
    one.location.z = 1.0
    one.keyframe_insert("location", frame=2)
    scene.frame_start, scene.frame_end = 1, 2
    scenes.write_exr(tmp_path / "f")
    bpy.ops.render.render(animation=True)
    for frame, value in ((1, 60.0), (2, 180.0)):
        pixels = scenes.load_pixels(tmp_path / f"f{frame:04d}.exr")
        np.testing.assert_allclose(pixels[..., :3], shown(value), rtol=1e-5, err_msg=str(frame))
        np.testing.assert_array_equal(pixels[..., 3], 1.0)


def test_eevee_shows_the_same(addon, tmp_path):
    scene, _owner, one = plateau_scene(tmp_path)
    names = [item.identifier for item in bpy.types.RenderSettings.bl_rna.properties["engine"].enum_items]
    scene.render.engine = next((name for name in names if "EEVEE" in name), "BLENDER_EEVEE")
    scene.eevee.taa_render_samples = 1
    one.scale.x *= 2.0
    pixels = scenes.rendered(tmp_path / "eevee.exr")
    np.testing.assert_allclose(pixels[3:-3, 3:-3, :3], shown(180.0), rtol=2e-3)


def test_a_slice_lights_nothing(addon, tmp_path):
    scene, _owner, _one = plateau_scene(tmp_path)
    scenes.add_white_floor(4.0).location = (12.0, 3.5, -1.0)
    scene.camera.data.ortho_scale = 40.0
    scene.camera.location.x = 12.0
    pixels = scenes.rendered(tmp_path / "floor.exr")
    assert pixels[8, 8, 3] == 1.0 and not pixels[8, 8, :3].any()


def test_the_volume_ends_at_a_slice_but_not_at_what_lies_outside_of_it(addon, tmp_path, bridge):
    owner = scenes.cube_scene(tmp_path)
    one = add(owner)
    scenes.activate(owner)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    (triangles,) = bridge("live.slices").outlines(depsgraph).values()
    np.testing.assert_allclose(np.abs(triangles[..., :2]), 1.0, atol=1e-5)
    half = scenes.picture_of(use_meshes=True)[1][12, 12, 3]
    full = scenes.picture_of(use_meshes=False)[1][12, 12, 3]
    np.testing.assert_allclose(np.log1p(-half) / np.log1p(-full), 0.5, atol=0.02)
    one.location.z = 4.0  # above the volume, where it shows nothing
    scenes.update()
    assert not scenes.image_pixels(one.rle_splat.slice_image)[..., 3].any()
    np.testing.assert_allclose(scenes.picture_of(use_meshes=True)[1][12, 12, 3], full, atol=1e-6)


def test_the_volume_shows_behind_a_slice_where_its_black_is_clear(addon, tmp_path, bridge):
    owner = scenes.cube_scene(tmp_path)
    one = add(owner)
    ours = owner.rle_splat
    ours.slices_follow_window, ours.slices_clear_black = False, True
    scenes.activate(owner)
    full = scenes.picture_of(use_meshes=False)[1][12, 12, 3]
    for center, expected in ((1e4, 1.0), (-1e4, 0.5)):  # all black; all white
        ours.slice_center, ours.slice_width = center, 100.0
        scenes.update()
        seen = scenes.image_pixels(one.rle_splat.slice_image)[..., 3]
        np.testing.assert_array_equal(seen, float(expected < 1.0))
        alpha = scenes.picture_of(use_meshes=True)[1][12, 12, 3]
        np.testing.assert_allclose(np.log1p(-alpha) / np.log1p(-full), expected, atol=0.02)
    ours.slice_center = 1e4
    ours.slices_clear_black = False
    scenes.update()
    alpha = scenes.picture_of(use_meshes=True)[1][12, 12, 3]
    np.testing.assert_allclose(np.log1p(-alpha) / np.log1p(-full), 0.5, atol=0.02)


def test_what_a_slice_hides_is_found_again_when_it_was_dropped_from_memory(addon, tmp_path, bridge):
    owner = scenes.cube_scene(tmp_path)
    add(owner)
    ours = owner.rle_splat
    ours.slices_follow_window, ours.slices_clear_black = False, True
    ours.slice_center, ours.slice_width = 1e4, 100.0  # all black
    scenes.activate(owner)
    scenes.update()
    full = scenes.picture_of(use_meshes=False)[1][12, 12, 3]
    store = bridge("loop.store")
    store.withdraw([wish for wish in list(store._wanted) if wish.purpose == "opaque"])
    np.testing.assert_allclose(scenes.picture_of(use_meshes=True)[1][12, 12, 3], full, atol=1e-6)


def test_a_render_right_after_a_change_shows_nothing_of_a_coarse_slice(addon, tmp_path, bridge, monkeypatch):
    """While a slice changes in a window it has few pixels; the volume of a render ends at the one with all."""
    side = 25
    outward = np.sqrt(sum((axis - side // 2) ** 2 for axis in np.mgrid[:side, :side, :side]))
    owner = scenes.import_raw(tmp_path, np.clip(190.0 - 10.0 * outward, 0.0, 255.0).astype(np.uint8))
    scenes.give_transfer(owner, ((0.0, 0.0), (99.5, 0.0), (100.0, 1.0), (255.0, 1.0)), (1.0, 1.0, 1.0))
    scenes.activate(owner)
    assert bpy.ops.rle_splat.add_cutting_object(kind="PLANE") == {"FINISHED"}
    scenes.activate(owner)
    assert bpy.ops.rle_splat.gray_values_on_cut() == {"FINISHED"}
    scene = scenes.use_cycles((40, 40))
    scenes.add_camera((12.0, -30.0, 54.0), rotation=(0.785, 0.0, 0.0), type="ORTHO", ortho_scale=26.0)
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    expected = scenes.rendered(tmp_path / "all.exr")
    (one,) = bridge("live.slices").slice_objects(scene)
    pictures, depsgraph = bridge("live.slice_pictures"), bpy.context.evaluated_depsgraph_get()
    update = pictures.update
    monkeypatch.setattr(pictures, "MOST_OF_DRAFT", 25)
    monkeypatch.setattr(pictures, "update", lambda scene, depsgraph, may_wait: update(
        scene, depsgraph, depsgraph.mode != "RENDER"))  # fmt: skip
    bridge("loop.store").forget_all()
    update(scene, depsgraph, may_wait=False)  # reads the voxels
    pictures.forget()
    update(scene, depsgraph, may_wait=True)
    assert len(one.rle_splat.slice_image.pixels) <= 100
    np.testing.assert_array_equal(scenes.rendered(tmp_path / "few.exr"), expected)
