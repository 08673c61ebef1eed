"""Names of segments and labels of points in a picture: where their lines lead, what is left out, and what a second
press keeps."""

import math
from importlib import import_module
from xml.etree import ElementTree

import bpy
import nibabel
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Euler, Vector

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

N = 48  # voxels a side, of 1 mm
# Seen from the front (-y), x to the right and z upward: places and radii in voxels.
BALLS = {
    1: ("kidney_left", (10, 24, 24), 5.0), 2: ("right kidney", (36, 24, 30), 5.0), 3: ("spine", (24, 40, 24), 4.0),
    4: ("Liver", (24, 10, 26), 8.0), 5: ("hidden", (24, 24, 8), 4.0),
}  # fmt: skip


@pytest.fixture
def owner(addon, tmp_path):
    x, y, z = np.indices((N, N, N))
    numbers = np.zeros((N, N, N), np.uint8)
    for number, (_, middle, radius) in BALLS.items():
        numbers[(x - middle[0]) ** 2 + (y - middle[1]) ** 2 + (z - middle[2]) ** 2 <= radius**2] = number
    for name, values in (("scan", np.int16(numbers > 0) * 300), ("map", numbers)):
        nibabel.save(nibabel.Nifti1Image(values, np.diag((-1.0, -1.0, 1.0, 1.0))), tmp_path / f"{name}.nii.gz")
    assert bpy.ops.rle_splat.import_volume(filepath=str(tmp_path / "scan.nii.gz"), preset="ct-bone") == {"FINISHED"}
    found = bpy.context.view_layer.objects.active
    found.rle_splat.label_file = str(tmp_path / "map.nii.gz")
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    for row in found.rle_splat.labels:
        if row.label in BALLS:
            row.label_name = BALLS[row.label][0]
            row.show = row.label_name != "hidden"
    return found


def look(kind: str = "PERSP", turn: float = 0.0, away: float = 0.14) -> None:
    angles = math.radians(90.0), 0.0, math.radians(turn)
    place = 0.001 * Vector((23.5, 23.5, 23.5)) + Euler(angles).to_matrix() @ Vector((0.0, 0.0, away))
    scenes.add_camera(place, rotation=angles, type=kind, ortho_scale=0.1, clip_start=0.01)


def seen(point) -> np.ndarray:
    return np.array(world_to_camera_view(bpy.context.scene, bpy.context.scene.camera, Vector(point))[:2])


def end_of(line) -> np.ndarray:
    """The middle of the dot at a line's end, in the picture."""
    return np.mean([seen(line.matrix_world @ point.co.to_3d()) for point in line.data.splines[1].points], axis=0)


def names() -> dict:
    """Text -> its place in the picture, from 0 to 1, and the end of its line."""
    bpy.context.view_layer.update()
    found = {}
    for one in bpy.context.scene.objects:
        if one.type == "FONT":
            line = bpy.data.objects[f"Line to {one.data.body}"]
            found[one.data.body] = seen(one.matrix_world.translation), end_of(line)
    return found


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_each_segment_that_is_shown_has_a_name_and_a_line_to_what_is_seen(owner, kind):
    look(kind)
    assert bpy.ops.rle_splat.add_names() == {"FINISHED"}
    found = names()
    assert set(found) == {"Left kidney", "Right kidney", "Spine", "Liver"}
    for name, (_, middle, _) in BALLS.items():
        body = name if isinstance(name, str) else "Left kidney" if name == 1 else BALLS[name][0].capitalize()
        if body in found and body != "Spine":
            size = np.linalg.norm(seen(0.001 * np.array(middle) + (0.0, 0.0, 0.003)) - seen(0.001 * np.array(middle)))
            assert np.linalg.norm(found[body][1] - seen(0.001 * np.array(middle))) < size, body
    assert found["Left kidney"][0][0] < found["Left kidney"][1][0] < 0.5  # the name beyond the segment
    assert found["Right kidney"][0][0] > found["Right kidney"][1][0] > 0.5
    heights = sorted(place[1] for place, _ in found.values() if place[0] < 0.5)
    assert np.diff(heights).min(initial=1.0) > 0.03, "names lie over one another"
    parts = [one for one in bpy.context.scene.objects if "rle_splat_segment" in one]
    assert len(parts) == 8 and all(one.parent == bpy.context.scene.camera for one in parts)
    assert not any(one.visible_shadow for one in parts)
    depths = [world_to_camera_view(bpy.context.scene, bpy.context.scene.camera, one.matrix_world.translation).z
              for one in parts]  # fmt: skip
    assert max(depths) < 0.14 - 0.024, "names stand before the volume"


def test_renders_show_names_lines_and_the_bar_with_a_dark_edge(owner, tmp_path):
    look()
    assert bpy.ops.rle_splat.add_names() == bpy.ops.rle_splat.add_letters() == {"FINISHED"}
    owner.hide_render = True
    scenes.use_cycles((1200, 900))
    parts = [one for one in bpy.context.scene.objects if "rle_splat_letters" in one]
    assert {one.type for one in parts} == {"FONT", "CURVE"} and len(parts) == 8 + 4 + 2
    for part in parts:
        for one in parts:
            one.hide_render = one != part
        pixels = scenes.rendered(tmp_path / "part.exr")
        gray = pixels[pixels[..., 3] > 0.0, 0]
        assert set(gray) == {0.0, 1.0} and 0.2 < gray.mean() < 0.9, part.name


def test_a_line_leads_to_the_part_that_others_do_not_hide(owner):
    for row in owner.rle_splat.labels:
        row.show = row.label in (3, 4)
    look(turn=12.0)  # most of the spine is behind the liver
    assert bpy.ops.rle_splat.add_names() == {"FINISHED"}
    width, height = bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y
    away = (names()["Spine"][1] - seen((0.024, 0.010, 0.026))) * (width / height, 1.0)
    radius = seen((0.024, 0.010, 0.034))[1] - seen((0.024, 0.010, 0.026))[1]
    assert np.linalg.norm(away) > 0.95 * radius


def test_a_second_press_follows_the_camera_and_keeps_edited_texts(owner):
    look()
    assert bpy.ops.rle_splat.add_names() == {"FINISHED"}
    next(
        one for one in bpy.context.scene.objects if one.type == "FONT" and one.data.body == "Liver"
    ).data.body = "Leber"
    assert bpy.ops.rle_splat.add_letters() == {"FINISHED"}
    bpy.context.scene.camera.matrix_world = Euler((math.radians(90.0), 0.0, math.radians(180.0))).to_matrix().to_4x4()
    bpy.context.scene.camera.location = 0.001 * Vector((23.5, 163.5, 23.5))
    bpy.context.view_layer.update()
    assert bpy.ops.rle_splat.add_names() == {"FINISHED"}
    parts = [one for one in bpy.context.scene.objects if "rle_splat_segment" in one and one.type == "FONT"]
    assert sorted(one.data.body for one in parts) == ["Leber", "Left kidney", "Right kidney", "Spine"]
    places = {one.data.body: seen(one.matrix_world.translation)[0] for one in parts}
    assert places["Left kidney"] > 0.5 > places["Right kidney"], "from behind"
    others = [one for one in bpy.context.scene.objects if "rle_splat_letters" in one and "rle_splat_segment" not in one]
    assert others, "the letters stay"


def test_names_stand_beyond_slices_and_pass_letters_by(owner):
    look(away=0.3)
    assert bpy.ops.rle_splat.add_letters() == {"FINISHED"}
    assert bpy.ops.rle_splat.add_slice(kind="AXIAL") == {"FINISHED"}
    made = bpy.context.view_layer.objects.active
    made.scale *= 1.3
    bpy.context.view_layer.objects.active = owner
    bpy.context.view_layer.update()
    assert bpy.ops.rle_splat.add_names() == {"FINISHED"}
    bpy.context.view_layer.update()
    texts = [one for one in bpy.context.scene.objects if one.type == "FONT"]
    sides = [seen(one.matrix_world.translation) for one in texts if one.data.body in "RL"]
    ends = [seen(made.matrix_world @ Vector(corner))[0] for corner in made.bound_box]
    named = [one for one in texts if "rle_splat_segment" in one]
    for one in named:
        x = seen(one.matrix_world.translation)[0]
        assert x < min(ends) or x > max(ends), one.name
        assert all(abs(seen(one.matrix_world.translation)[1] - side[1]) > 0.03 for side in sides), one.name
        line = bpy.data.objects[f"Line to {one.data.body}"]
        begin, end = seen(line.matrix_world @ line.data.splines[0].points[0].co.to_3d()), end_of(line)
        for side in sides:
            share = (side[0] - begin[0]) / (end[0] - begin[0])
            if 0.0 < share < 0.75:
                assert abs(begin[1] + share * (end[1] - begin[1]) - side[1]) > 0.04, (one.name, side)
    assert len(named) == 4 and min(ends) < 0.4 < 0.6 < max(ends)


def test_what_is_cut_away_or_out_of_the_picture_has_no_name(owner, refused):
    look()
    assert bpy.ops.rle_splat.add_cutting_object(kind="BOX", keep="INSIDE") == {"FINISHED"}
    box = bpy.context.view_layer.objects.active
    box.matrix_world.translation.x += 0.034
    bpy.context.view_layer.objects.active = owner
    bpy.context.view_layer.update()
    assert bpy.ops.rle_splat.add_names() == {"FINISHED"}
    assert set(names()) == {"Right kidney"}
    bpy.context.scene.camera.rotation_euler.z += math.radians(180.0)
    bpy.context.view_layer.update()
    refused(bpy.ops.rle_splat.add_names, "sees none of the segments")
    assert set(names()) == {"Right kidney"}, "nothing is lost"


def test_without_shown_segments_or_with_too_many_it_says_so(owner, refused, monkeypatch):
    look()
    for row in owner.rle_splat.labels:
        row.show = False
    refused(bpy.ops.rle_splat.add_names, "No segment is shown")
    for row in owner.rle_splat.labels:
        row.show = True
    monkeypatch.setattr(import_module(f"{scenes.MODULE}.operators.callout_objects"), "STEP", 0.6)
    refused(bpy.ops.rle_splat.add_names, "room for 2; hide or delete some")


# --- labels of points -------------------------------------------------------------------------------------------------

TIP, SIDE = 0.001 * np.array((24.0, 2.0, 26.0)), 0.001 * np.array((10.0, 19.0, 24.0))  # of the liver and a kidney, m


def add_name(text: str, point) -> set:
    return bpy.ops.rle_splat.add_name(text=text, point=tuple(point))


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_a_label_has_a_line_to_its_point(owner, kind):
    look(kind)
    assert add_name("  Tip of the  liver ", TIP) == {"FINISHED"}
    (text, (place, end)), *others = names().items()
    assert text == "Tip of the liver" and not others
    assert end == pytest.approx(seen(TIP), abs=1e-4)
    assert place[0] < seen(0.001 * np.array((5.0, 24.0, 24.0)))[0], "it stands beside what is visible"


def test_labels_and_names_share_the_sides_of_a_picture(owner):
    look()
    assert bpy.ops.rle_splat.add_names() == {"FINISHED"}
    before = names()
    for number in range(3):
        assert add_name(f"Cyst {number}", SIDE) == {"FINISHED"}
    found = names()
    assert set(found) == {*before, "Cyst 0", "Cyst 1", "Cyst 2"}
    for text, (_, end) in before.items():
        assert found[text][1] == pytest.approx(end, abs=1e-4), "lines of names lead where they led"
    for side in (0, 1):
        heights = sorted(place[1] for place, _ in found.values() if (place[0] > 0.5) == bool(side))
        assert np.diff(heights).min(initial=1.0) > 0.03, "texts lie over one another"


def test_labels_follow_their_points_and_outlast_letters_and_names(owner):
    look()
    assert add_name("Cyst", SIDE) == {"FINISHED"}
    next(one for one in bpy.context.scene.objects if one.type == "FONT").data.body = "Zyste"
    owner.location.x += 0.004
    bpy.context.scene.camera.location.z += 0.01
    bpy.context.view_layer.update()
    assert bpy.ops.rle_splat.add_letters() == {"FINISHED"}
    assert bpy.ops.rle_splat.add_names() == {"FINISHED"}
    bpy.context.view_layer.update()
    (line,) = (one for one in bpy.context.scene.objects if one.type == "CURVE" and "rle_splat_point" in one)
    assert end_of(line) == pytest.approx(seen(SIDE + (0.004, 0.0, 0.0)), abs=1e-4)
    texts = [one.data.body for one in bpy.context.scene.objects if one.type == "FONT" and "rle_splat_point" in one]
    assert texts == ["Zyste"]


def test_a_label_without_a_text_or_out_of_the_picture_is_refused_and_others_stay(owner, refused):
    look()
    assert add_name("Cyst", SIDE) == {"FINISHED"}
    refused(bpy.ops.rle_splat.add_name, "is empty", text="  ", point=tuple(TIP))
    refused(bpy.ops.rle_splat.add_name, "does not see the point", text="Far", point=(0.0, -9.0, 0.0))
    refused(bpy.ops.rle_splat.name_structure, "needs a click in a window")
    bpy.context.scene.camera.rotation_euler.z += math.radians(180.0)
    bpy.context.view_layer.update()
    refused(bpy.ops.rle_splat.add_name, "does not see the point", text="Tip", point=tuple(TIP))
    assert {one.data.body for one in bpy.context.scene.objects if one.type == "FONT"} == {"Cyst"}


def test_a_figure_has_the_names_as_they_are_in_the_scene(owner, tmp_path):
    look("ORTHO")
    assert bpy.ops.rle_splat.add_names() == {"FINISHED"} and add_name("Cyst", SIDE) == {"FINISHED"}
    texts = {one.data.body: one.data for one in bpy.context.scene.objects if one.type == "FONT"}
    texts["Liver"].body = "Leber"
    path = tmp_path / "a.svg"
    assert bpy.ops.rle_splat.save_figure(filepath=str(path), names=True, dpi=72.0) == {"FINISHED"}
    drawn = {one.text for one in ElementTree.parse(path).iter("{http://www.w3.org/2000/svg}text")}
    assert {"Leber", "Left kidney", "Right kidney", "Spine", "Cyst"} <= drawn
    assert bpy.ops.rle_splat.save_figure(filepath=str(path), dpi=72.0) == {"FINISHED"}
    assert "Leber" not in path.read_text()
