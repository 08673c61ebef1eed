"""Gray Values on Cut: where the slices on cuts lie, what they show, and that they follow and end with their cuts."""

import bpy
import numpy as np
import pytest
from mathutils import Vector

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

SIDE, MIDDLE = 25, 12.0
RADIUS = 9.0  # of what is visible: values from 100 on; they fall by 10 a voxel


@pytest.fixture
def owner(addon, tmp_path):
    """A ball, a world unit a voxel."""
    outward = np.sqrt(sum((axis - MIDDLE) ** 2 for axis in np.mgrid[:SIDE, :SIDE, :SIDE]))
    owner = scenes.import_raw(tmp_path, np.clip(100.0 + 10.0 * (RADIUS - outward), 0.0, 255.0).astype(np.uint8))
    scenes.give_transfer(owner, ((0.0, 0.0), (99.5, 0.0), (100.0, 1.0), (255.0, 1.0)), (1.0, 1.0, 1.0))
    ours = owner.rle_splat
    ours.slices_follow_window, ours.slice_center, ours.slice_width = False, 150.0, 200.0
    return owner


def add_cut(owner, kind="PLANE", keep="INSIDE"):
    scenes.activate(owner)
    assert bpy.ops.rle_splat.add_cutting_object(kind=kind, keep=keep) == {"FINISHED"}
    return bpy.context.view_layer.objects.active


def click(owner):
    scenes.activate(owner)
    assert bpy.ops.rle_splat.gray_values_on_cut() == {"FINISHED"}


def slices_of(cut):
    return [one for one in cut.children if one.rle_splat.is_slice]


def shown(one):
    """Area in square world units of what a slice shows, and its pixels."""
    pixels = scenes.image_pixels(one.rle_splat.slice_image)
    matrix = np.array(one.matrix_world)
    return 4.0 * pixels[..., 3].mean() * np.prod(np.linalg.norm(matrix[:3, :2], axis=0)), pixels


def disk(depth):
    """Area of the ball on a plane so far from its middle."""
    return np.pi * (RADIUS**2 - depth**2)


def test_a_plane_shows_the_values_of_what_is_visible(owner):
    cut = add_cut(owner)
    click(owner)
    (one,) = slices_of(cut)
    area, pixels = shown(one)
    assert area == pytest.approx(disk(0.0), rel=0.02)
    level = pixels[pixels.shape[0] // 2, pixels.shape[1] // 2]
    assert level[3] == 1.0 and level[0] == pytest.approx(((0.7 + 0.055) / 1.055) ** 2.4, abs=0.03)  # 190 from 50 to 250
    assert one.hide_select and not one.visible_shadow
    assert 0.0 < one.matrix_world.translation.z - MIDDLE < 0.1  # before the cut, whose arrow points up


def test_slices_follow_their_cut(owner):
    cut = add_cut(owner)
    click(owner)
    (one,) = slices_of(cut)
    cut.location.z += 5.0
    scenes.update()
    assert shown(one)[0] == pytest.approx(disk(5.0), rel=0.02)
    cut.rotation_euler = 0.9, 0.4, 0.0
    cut.location = MIDDLE, MIDDLE, MIDDLE
    scenes.update()
    assert shown(one)[0] == pytest.approx(disk(0.0), rel=0.03)
    cut.rle_splat.clip_keep = "OUTSIDE"
    scenes.update()
    away = one.matrix_world.translation - cut.matrix_world.translation
    assert away.dot(cut.matrix_world.col[2].to_3d()) < 0.0


@pytest.mark.parametrize("off", ["the cut", "all cuts"])
def test_a_cut_that_is_off_shows_nothing(owner, off):
    cut = add_cut(owner)
    click(owner)
    if off == "the cut":
        cut.rle_splat.clip_is_on = False
    else:
        bpy.context.scene.rle_splat.use_clips = False
    scenes.update()
    assert shown(slices_of(cut)[0])[0] == 0.0


def test_the_corner_that_a_box_cuts_out_has_three_faces(owner):
    cut = add_cut(owner, "BOX", "OUTSIDE")
    cut.location = Vector((MIDDLE, MIDDLE, MIDDLE)) + cut.scale  # its lowest corner is in the middle
    click(owner)
    found = slices_of(cut)
    areas = sorted(shown(one)[0] for one in found)
    assert len(found) == 6 and areas[:3] == [0.0] * 3
    np.testing.assert_allclose(areas[3:], 0.25 * disk(0.0), rtol=0.04)


def test_two_planes_limit_each_other(owner):
    first, second = add_cut(owner), add_cut(owner)
    second.rotation_euler.x = 0.5 * np.pi
    click(owner)
    for cut in (first, second):
        (one,) = slices_of(cut)
        assert shown(one)[0] == pytest.approx(0.5 * disk(0.0), rel=0.04)


def test_what_is_enclosed_is_shown_unless_black_is_transparent(owner):
    scenes.give_transfer(owner, ((0.0, 0.0), (99.5, 0.0), (100.0, 1.0), (140.0, 1.0), (140.5, 0.0), (255.0, 0.0)),
                         (1.0, 1.0, 1.0))  # fmt: skip
    cut = add_cut(owner)
    click(owner)
    (one,) = slices_of(cut)
    assert shown(one)[0] == pytest.approx(disk(0.0), rel=0.02)
    owner.rle_splat.slices_clear_black = True
    scenes.update()
    assert shown(one)[0] == pytest.approx(disk(0.0) - np.pi * (RADIUS - 4.0) ** 2, rel=0.04)


def test_the_volume_is_hidden_only_behind_what_is_shown(owner, bridge):
    cut = add_cut(owner)
    click(owner)
    (one,) = slices_of(cut)
    triangles = bridge("live.slices").outlines(bpy.context.evaluated_depsgraph_get())[one]
    matrix = np.array(one.matrix_world)
    edges = (triangles[:, 1:] - triangles[:, :1]) @ matrix[:3, :3].T
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum()
    assert area == pytest.approx(disk(0.0), rel=0.02)


def test_the_button_removes_them_and_cuts_added_later_get_theirs(owner):
    first = add_cut(owner)
    click(owner)
    second = add_cut(owner, "BOX")
    click(owner)
    assert len(slices_of(first)) == 1 and len(slices_of(second)) == 6
    counts = [len(data) for data in (bpy.data.images, bpy.data.materials, bpy.data.meshes)]
    click(owner)
    assert not slices_of(first) and not slices_of(second)
    left = [len(data) for data in (bpy.data.images, bpy.data.materials, bpy.data.meshes)]
    assert [before - after for before, after in zip(counts, left)] == [7, 7, 7]


def test_they_are_no_cutting_objects_wherever_they_are(owner, bridge):
    cut = add_cut(owner)
    collection = bpy.context.scene.rle_splat.clip_objects
    bpy.context.view_layer.active_layer_collection = bpy.context.view_layer.layer_collection.children[collection.name]
    click(owner)
    assert slices_of(cut)[0].name in collection.objects
    assert bridge("scene.clip_objects").clip_objects(bpy.context.scene) == [cut]


@pytest.mark.parametrize("lost", ["the cut", "the volume"])
def test_they_end_with_their_cut_and_with_their_volume(owner, bridge, lost):
    cut = add_cut(owner)
    click(owner)
    (one,) = slices_of(cut)
    name = one.name
    bpy.data.objects.remove(cut if lost == "the cut" else owner)
    scenes.update()
    assert bpy.context.scene.rle_splat.message == ""
    bridge("live.cut_slices").remove_lost()  # by a timer in a window
    assert name not in bpy.data.objects


def test_deleting_a_cut_in_the_panel_removes_its_slices(owner):
    cut = add_cut(owner, "BOX")
    click(owner)
    assert bpy.ops.rle_splat.delete_cutting_object(name=cut.name) == {"FINISHED"}
    assert not any(one.rle_splat.is_slice for one in bpy.data.objects)


def test_it_needs_a_cut_of_the_volume(owner, refused):
    scenes.activate(owner)
    refused(bpy.ops.rle_splat.gray_values_on_cut, "Add a box or a plane that cuts the volume")


def test_a_scroll_does_not_move_them_off_their_cut(owner):
    cut = add_cut(owner)
    click(owner)
    (one,) = slices_of(cut)
    scenes.activate(one)
    assert bpy.ops.rle_splat.scroll_slice(layers=2) == {"CANCELLED"}
