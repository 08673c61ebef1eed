"""Clip objects of a volume: they move with it, cut it alone, and their handles move one face; Cut Along View."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Quaternion, Vector

from tests.blender import scenes

N = 9
MIDDLE = (N - 1) / 2


@pytest.fixture
def owner(addon, tmp_path):
    return scenes.import_raw(tmp_path, np.full((N, N, N), 100, np.uint8))


def add(owner, kind="BOX"):
    scenes.activate(owner)
    assert bpy.ops.rle_splat.add_cutting_object(kind=kind) == {"FINISHED"}
    scenes.update()
    return bpy.context.view_layer.objects.active


def corners(one):
    """(8, 3): the corners of a clip box in the world."""
    matrix = np.array(one.matrix_world)
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return signs @ matrix[:3, :3].T + matrix[:3, 3]


def test_a_box_fits_a_sheared_and_mirrored_volume_exactly(owner, bridge):
    shear = Matrix(((1.0, 0.0, 0.3, 0.0), (0.0, -1.5, 0.0, 0.0), (0.0, 0.2, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
    owner.matrix_world = Matrix.Translation((3.0, -2.0, 1.0)) @ Matrix.Rotation(0.7, 4, (1.0, 2.0, 3.0))
    scenes.update()
    box = add(owner)
    bridge("volumes.attached").attach(box, owner, np.array(owner.matrix_world @ shear))
    scenes.update()
    np.testing.assert_allclose(np.array(box.matrix_world), np.array(owner.matrix_world @ shear), atol=1e-5)


def test_a_box_fits_the_visible_part(addon, tmp_path, refused):
    voxels = np.zeros((N, N, N), np.uint8)
    voxels[4:6, 3:5, 2:8] = 100
    owner = scenes.import_raw(tmp_path, voxels)
    scenes.load_color(tmp_path, scenes.RED)
    assert bpy.ops.rle_splat.add_cutting_object(kind="BOX", fit="VISIBLE") == {"FINISHED"}
    scenes.update()
    found = corners(bpy.context.view_layer.objects.active)
    np.testing.assert_allclose(found.min(axis=0), (1, 2, 3), atol=1e-5)
    np.testing.assert_allclose(found.max(axis=0), (8, 5, 6), atol=1e-5)
    scenes.activate(owner)
    scenes.lower_curve(owner)
    refused(bpy.ops.rle_splat.add_cutting_object, "shows no voxel", kind="BOX", fit="VISIBLE")


def test_it_moves_with_its_volume_and_with_the_scene_scale(owner):
    box, plane = add(owner), add(owner, "PLANE")
    before = corners(box)
    np.testing.assert_allclose(before.min(axis=0), 0.0, atol=1e-5)
    np.testing.assert_allclose(before.max(axis=0), N - 1.0, atol=1e-5)
    place = Matrix.Translation((5.0, 1.0, -2.0)) @ Matrix.Rotation(0.5, 4, "X") @ Matrix.Scale(2.0, 4)
    owner.matrix_world = place
    scenes.update()
    moved = np.array([place @ Vector(corner) for corner in before])
    np.testing.assert_allclose(corners(box), moved, atol=1e-4)
    bpy.context.scene.rle_splat.scene_scale = 0.5
    scenes.update()
    np.testing.assert_allclose(corners(box), np.array([place @ Vector(0.5 * corner) for corner in before]), atol=1e-4)
    np.testing.assert_allclose(plane.matrix_world.translation, place @ Vector((0.5 * MIDDLE,) * 3), atol=1e-4)


def test_it_cuts_its_own_volume_alone(owner, bridge, tmp_path):
    other = scenes.import_raw(tmp_path, np.full((N, N, N), 50, np.uint8), name="other")
    box = add(owner)
    scenes.activate(other)

    def cut(volume_object):
        depsgraph = bpy.context.evaluated_depsgraph_get()
        return [clip.kind for clip in bridge("scene.clip_objects").read_clips(depsgraph, volume_object)]

    assert (cut(owner), cut(other)) == (["box"], [])
    box.rle_splat.clip_only_parent = False
    assert (cut(owner), cut(other)) == (["box"], ["box"])
    box.rle_splat.clip_only_parent = True
    with bpy.context.temp_override(selected_objects=[owner]):
        bpy.ops.object.delete()
    scenes.update()
    assert cut(other) == ["box"], "one without a volume cuts every volume, as those of older files do"


def test_its_volume_is_the_active_one_while_it_is_selected(owner, bridge, tmp_path):
    scenes.import_raw(tmp_path, np.full((N, N, N), 50, np.uint8), name="other")
    add(owner)
    assert bridge("volumes.volumes").volume_object(bpy.context) == owner
    assert bridge("scene.clip_handles").active_box(bpy.context).name == "Cut Box"
    scenes.activate(bpy.data.objects["other"])
    assert bridge("scene.clip_handles").active_box(bpy.context) is None
    scenes.activate(owner)
    assert bridge("scene.clip_handles").active_box(bpy.context).name == "Cut Box"


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("side", [-1, 1])
def test_a_handle_moves_one_face(owner, bridge, axis, side):
    handles, box = bridge("scene.clip_handles"), add(owner)
    owner.rotation_euler, owner.scale = (0.3, -0.6, 1.1), (1.5, 1.5, 1.5)
    box.delta_location = (0.1, 0.2, 0.3)
    scenes.update()
    before = {face: handles.face(box, *face) for face in handles.FACES}
    opposite, direction, extent = before[axis, side]
    for wanted in (0.5 * extent, 0.8 * extent, 0.25 * extent):  # events that come before Blender evaluates anew
        handles.move_face(box, axis, side, wanted)
    scenes.update()
    for face in handles.FACES:
        base, _, length = handles.face(box, *face)
        assert length == pytest.approx((0.25 if face[0] == axis else 1.0) * before[face][2], rel=1e-5)
        if face == (axis, side):
            np.testing.assert_allclose(base, opposite, atol=1e-5)
        elif face == (axis, -side):
            np.testing.assert_allclose(base, opposite + 0.25 * extent * direction, atol=1e-5)
    handles.move_face(box, axis, side, -5.0)
    scenes.update()
    assert 0.0 < handles.face(box, axis, side)[2] < 0.01 * extent
    handles.move_face(box, axis, side, extent)
    scenes.update()
    np.testing.assert_allclose(handles.face(box, axis, side)[0], opposite, atol=1e-3)
    assert handles.face(box, axis, side)[2] == pytest.approx(extent, rel=1e-3)


def test_auto_keying_inserts_keyframes(owner, bridge):
    box = add(owner)
    bridge("scene.clip_handles").move_face(box, 0, 1, 5.0)
    assert box.animation_data is None
    bpy.context.scene.tool_settings.use_keyframe_insert_auto = True
    bridge("scene.clip_handles").move_face(box, 0, 1, 4.0)
    paths = {curve.data_path for curve in bridge("data.playback").curves_of(box)}
    assert paths == {"location", "scale"}


def test_a_handle_moves_a_plane_along_its_normal(owner, bridge):
    handles, plane = bridge("scene.clip_handles"), add(owner, "PLANE")
    owner.rotation_euler = (0.3, -0.6, 1.1)
    plane.rotation_euler = (0.2, 0.4, 0.0)
    scenes.update()
    place = plane.matrix_world.copy()
    base, normal, distance = handles.plane_origin(plane)
    np.testing.assert_allclose(normal, place.col[2].to_3d().normalized(), atol=1e-5)
    handles.move_plane(plane, distance - 3.0)
    scenes.update()
    np.testing.assert_allclose(plane.matrix_world.translation, place.translation - 3.0 * normal, atol=1e-5)
    np.testing.assert_allclose(handles.plane_origin(plane)[0], base, atol=1e-5)


@pytest.mark.parametrize("mode", ["XYZ", "ZXY", "QUATERNION", "AXIS_ANGLE"])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_ring_tilts_a_plane_about_its_own_axis(owner, bridge, mode, mirrored):
    handles, plane = bridge("scene.clip_handles"), add(owner, "PLANE")
    owner.rotation_euler, owner.scale = (0.3, -0.6, 1.1), (-1.0 if mirrored else 1.0, 1.0, 1.0)
    plane.rotation_mode = mode
    scenes.update()
    for axis in (0, 1):
        middle, direction = handles.tilt_axis(plane, axis)
        before = plane.matrix_world.col[2].to_3d().normalized()
        handles.tilt(plane, axis, 0.25)
        handles.tilt(plane, axis, 0.15)
        scenes.update()
        after = plane.matrix_world.col[2].to_3d().normalized()
        np.testing.assert_allclose(after, Quaternion(direction, 0.4) @ before, atol=1e-5)
        np.testing.assert_allclose(plane.matrix_world.translation, middle, atol=1e-5)
        np.testing.assert_allclose(handles.tilt_axis(plane, axis)[1], direction, atol=1e-5)


def test_clip_to_view_faces_the_camera_in_background_mode(owner, refused):
    refused(bpy.ops.rle_splat.cut_along_view, "no 3D viewport and no active camera")
    camera = scenes.add_camera((20.0, 15.0, 30.0), (0.4, 0.5, 0.3))
    scenes.update()
    assert bpy.ops.rle_splat.cut_along_view() == {"FINISHED"}
    plane = bpy.context.view_layer.objects.active
    scenes.update()
    axes = np.array(camera.matrix_world)[:3, :3]
    np.testing.assert_allclose(np.array(plane.matrix_world.normalized())[:3, :3], axes, atol=1e-5)
    np.testing.assert_allclose((np.array(plane.matrix_world)[:3, 3] - MIDDLE) @ axes[:, 2], 0.0, atol=1e-4)
    box = np.array([(x, y, z) for x in (0, N - 1) for y in (0, N - 1) for z in (0, N - 1)], np.float64)
    within = (box - np.array(plane.matrix_world)[:3, 3]) @ np.linalg.inv(np.array(plane.matrix_world)[:3, :3]).T
    np.testing.assert_allclose((within[:, :2].min(), within[:, :2].max()), (-1.0, 1.0), atol=1e-4)
    assert plane.instance_collection is not None and plane.rle_splat.clip_keep == "INSIDE"


def test_clip_to_view_at_the_cursor_moves_the_active_plane(owner, refused):
    camera = scenes.add_camera((MIDDLE, MIDDLE, 30.0))
    bpy.context.scene.cursor.location = (1.0, 2.0, 20.0)
    scenes.update()
    refused(bpy.ops.rle_splat.cut_along_view, "before or behind all of", through="CURSOR")
    bpy.context.scene.cursor.location = (1.0, 2.0, 6.0)
    assert bpy.ops.rle_splat.cut_along_view(through="CURSOR") == {"FINISHED"}
    plane = bpy.context.view_layer.objects.active
    scenes.update()
    assert plane.matrix_world.translation.z == pytest.approx(6.0, abs=1e-5)
    camera.location, camera.rotation_euler = (30.0, MIDDLE, MIDDLE), (0.0, np.pi / 2, 0.0)
    scenes.update()
    assert bpy.ops.rle_splat.cut_along_view(through="CURSOR") == {"FINISHED"}
    scenes.update()
    assert bpy.context.scene.rle_splat.clip_objects.objects.values() == [plane]
    assert plane.matrix_world.translation.x == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(plane.matrix_world.col[2].to_3d().normalized(), (1.0, 0.0, 0.0), atol=1e-5)
