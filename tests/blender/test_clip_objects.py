"""Proves that the objects of the scene's clip collection cut the volume where Blender shows them, and that moving one
changes the picture."""

import json

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

N, ALPHA, VIEW = 9, 0.08, 12.0


@pytest.fixture
def settings(tmp_path):
    """Of a scene with a homogeneous cube of N voxels, seen from above: a ray along z is N - 1 long."""
    scenes.even_cube(tmp_path, N, ALPHA, (0.9, 0.5, 0.2))
    scenes.add_camera(((N - 1) / 2, (N - 1) / 2, 30.0), type="ORTHO", ortho_scale=VIEW)
    render = bpy.context.scene.render
    render.resolution_x = render.resolution_y = 48
    settings = bpy.context.scene.rle_splat
    settings.quality = "fine"
    return settings


def depth_at(x, y):
    """Length of the medium on the ray through world (x, y), from the picture's alpha."""
    assert bpy.ops.rle_splat.render_image(use_meshes=True) == {"FINISHED"}
    alpha = scenes.image_pixels(bpy.context.scene.rle_splat.image)[..., 3]
    column, row = (int((a - (N - 1) / 2) / VIEW * 48 + 24) for a in (x, -y + N - 1))
    return float(np.log1p(-alpha[row, column]) / np.log1p(-ALPHA))


def reason(settings):
    effects = json.loads(settings.last_report_json)["effects"]
    return next(effect for effect in effects if effect["name"] == "clip objects")


def put(kind, location, size=1.0):
    empty = bpy.data.objects.new("clip", None)
    empty.empty_display_type, empty.empty_display_size, empty.location = kind, size, location
    bpy.context.scene.rle_splat.clip_objects.objects.link(empty)
    return empty


def test_a_fitted_box_cuts_nothing_until_it_is_moved(settings):
    assert depth_at(4, 4) == pytest.approx(N - 1, abs=0.05) and reason(settings)["on"] is False
    assert bpy.ops.rle_splat.add_cutting_object(kind="BOX") == {"FINISHED"}
    box = bpy.context.view_layer.objects.active
    assert box.type == "EMPTY" and box.name in settings.clip_objects.objects
    assert depth_at(4, 4) == pytest.approx(N - 1, abs=0.05)
    assert not reason(settings)["on"] and "none cuts" in reason(settings)["reason"]
    box.location.z += 3.0
    assert depth_at(4, 4) == pytest.approx(N - 1 - 3, abs=0.05)
    assert reason(settings) == {**reason(settings), "on": True, "reason": "1 box cuts the volume"}
    box.rle_splat.clip_keep = "OUTSIDE"
    assert depth_at(4, 4) == pytest.approx(3, abs=0.05)
    box.rle_splat.clip_is_on = False
    assert box.hide_render and depth_at(4, 4) == pytest.approx(N - 1, abs=0.05)


def test_an_arrow_points_at_what_is_cut_away(settings):
    bpy.ops.object.select_all(action="DESELECT")
    bpy.context.view_layer.objects.active = None
    assert bpy.ops.rle_splat.add_cutting_object(kind="PLANE") == {"FINISHED"}
    arrow = bpy.context.view_layer.objects.active
    assert arrow.empty_display_type == "SINGLE_ARROW"
    arrow.location.z = 5.5
    assert depth_at(4, 4) == pytest.approx(5.5, abs=0.05)
    arrow.rotation_euler.x = np.pi
    assert depth_at(4, 4) == pytest.approx(N - 1 - 5.5, abs=0.05)
    arrow.rotation_euler = 0.0, np.arctan(0.5), 0.0  # the plane rises by one in two along -x
    arrow.location = 4.0, 4.0, 4.0
    assert depth_at(2, 4) - depth_at(6, 4) == pytest.approx(2.0, abs=0.1)


def test_meshes_are_their_bounds_and_no_surfaces(settings):
    settings.clip_objects = bpy.data.collections.new("mine")
    bpy.context.scene.collection.children.link(settings.clip_objects)
    corners = [(x, y, z) for x in (-9, 9) for y in (-9, 9) for z in (2, 7)]
    box = scenes.add_mesh(corners, [(0, 1, 3, 2), (4, 5, 7, 6)], name="box")
    settings.clip_objects.objects.link(box)
    assert depth_at(4, 4) == pytest.approx(5, abs=0.05)
    flat = scenes.add_mesh([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2, 3)], name="plane")
    flat.location.z = 4.5
    settings.clip_objects.objects.link(flat)
    assert depth_at(4, 4) == pytest.approx(2.5, abs=0.05)
    assert reason(settings)["reason"] == "1 plane and 1 box cut the volume"


def test_a_size_and_a_parent_count(settings):
    settings.clip_objects = bpy.data.collections.new("mine")
    bpy.context.scene.collection.children.link(settings.clip_objects)
    parent = bpy.data.objects.new("parent", None)
    bpy.context.scene.collection.objects.link(parent)
    parent.scale = 2.0, 2.0, 2.0
    cube = put("CUBE", (2.0, 2.0, 2.0), 0.75)
    cube.parent = parent
    assert depth_at(4, 4) == pytest.approx(3, abs=0.05)  # 2 * 2 * 0.75 high


def test_what_can_cut_nothing_is_refused_in_a_sentence(settings, refused):
    settings.clip_objects = bpy.data.collections.new("mine")
    bpy.context.scene.collection.children.link(settings.clip_objects)
    ball = put("SPHERE", (4, 4, 4))
    bpy.context.view_layer.update()
    refused(bpy.ops.rle_splat.render_image, "neither a plane nor a box")
    ball.empty_display_type = "CUBE"
    ball.scale.x = 0.0
    bpy.context.view_layer.update()
    refused(bpy.ops.rle_splat.render_image, "is flat")
