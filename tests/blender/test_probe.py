"""The value along a ray, as it is told to people: what hides it, which volumes count, and the line of text."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from tests.blender import scenes

CENTER = (3.0, 3.0)  # of the cube that tests.blender.scenes imports: 7 voxels a side, value 100


@pytest.fixture
def owner(addon, tmp_path):
    return scenes.add_cube(tmp_path, alpha=0.9)


@pytest.fixture
def look(bridge):
    probe = bridge("look.probe")

    def along(origin=(*CENTER, 30.0), direction=(0.0, 0.0, -1.0), **more):
        """What a ray from above finds, and its line."""
        depsgraph = bpy.context.evaluated_depsgraph_get()
        owners = probe.visible_owners(bpy.context)
        found = probe.look_along(bpy.context, depsgraph, probe.Ray(origin, direction, **more), owners)
        return found, None if found is None else probe.line_of(found, len(owners) > 1)

    return along


def add_plate(height, name="plate"):
    x, y = CENTER
    corners = [(x - 2, y - 2, height), (x + 2, y - 2, height), (x + 2, y + 2, height), (x - 2, y + 2, height)]
    plate = scenes.add_mesh(corners, [(0, 1, 2, 3)], name=name)
    scenes.update()
    return plate


def test_value_voxel_and_position(owner, look):
    found, line = look()
    assert found.owner == owner and found.surface.value == 100.0
    assert found.surface.index[2] == pytest.approx(6.0 - np.log(2.0) / -np.log(0.1), abs=0.02)
    assert line == "100, voxel 3 3 6, x 3.0 y 3.0 z 5.7 mm"


def test_a_mesh_before_the_volume_hides_it_and_one_inside_what_is_behind_it(owner, look):
    plate = add_plate(20.0)
    assert look() == (None, None)
    bpy.context.scene.rle_splat.meshes_occlude = False
    assert look()[0] is not None
    bpy.context.scene.rle_splat.meshes_occlude = True
    plate.location.z = -20.0 + 5.8  # half is not absorbed before it
    scenes.update()
    assert look()[0].surface.index[2] > 5.79
    plate.location.z = -20.0 + 3.0
    scenes.update()
    assert look()[1].startswith("100, voxel 3 3 6")
    assert look(nearest=-np.inf)[1].startswith("100, voxel 3 3 6")  # as in an orthographic view


def test_meshes_that_hide_nothing_are_passed(owner, look):
    wires, clip = add_plate(20.0, "wires"), add_plate(19.0, "clip")
    wires.display_type = "BOUNDS"
    bpy.context.scene.rle_splat.clip_objects = bpy.data.collections.new("clips")
    bpy.context.scene.rle_splat.clip_objects.objects.link(clip)
    clip.location.z = -15.0  # a flat mesh cuts away what its normal points to: all above 4
    scenes.update()
    found, line = look()
    assert line.startswith("100, voxel 3 3 4") and found.surface.index[2] < 4.01


def test_hidden_volumes_do_not_count_and_the_nearest_of_several_is_named(owner, look, tmp_path):
    other = scenes.add_cube(tmp_path, "other", value=200, alpha=0.9)
    other.location.z = 10.0
    scenes.update()
    assert look()[1].endswith(", other") and look()[0].surface.value == 200.0
    other.hide_set(True)
    scenes.update()
    assert look()[0].owner == owner and look()[1].startswith("100, ")


def test_the_ray_follows_the_object(owner, look):
    owner.matrix_world = Matrix.Translation((0.0, 0.0, 100.0)) @ Matrix.Scale(2.0, 4)
    scenes.update()
    found, line = look((6.0, 6.0, 300.0))
    assert 100.0 < found.surface.world[2] < 112.0 and line.startswith("100, voxel 3 3 6, x 3.0 y 3.0")
    assert look((6.0, 6.0, 0.0))[0] is None  # it looks down from below


def test_labels_are_named(owner, look, tmp_path):
    path = tmp_path / "labels.raw"
    path.write_bytes(np.repeat(np.arange(7, dtype=np.uint8) % 3, 49).tobytes())  # the top slice is 0, below it 2
    owner.rle_splat.label_file = str(path)
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    next(row for row in owner.rle_splat.labels if row.label == 0).show = False
    next(row for row in owner.rle_splat.labels if row.label == 2).label_name = "Liver"
    scenes.update()
    found, line = look()
    assert found.surface.label == 2 and line.endswith(", Liver") and "voxel 3 3 5" in line


def test_the_operator_tells_it(owner, capfd):
    scenes.update()
    assert bpy.ops.rle_splat.value_at_surface(origin=(*CENTER, 30.0), direction=(0.0, 0.0, -2.0)) == {"FINISHED"}
    assert bpy.ops.rle_splat.value_at_surface(origin=(*CENTER, 30.0), direction=(0.0, 0.0, 1.0)) == {"FINISHED"}
    said = capfd.readouterr().out
    assert "Info: 100, voxel 3 3 6, x 3.0 y 3.0 z 5.7 mm" in said and "Nothing is visible along the ray" in said


def test_the_operator_refuses_what_it_cannot_follow(owner, refused, tmp_path):
    refused(bpy.ops.rle_splat.value_at_surface, "no direction", direction=(0.0, 0.0, 0.0))


def test_without_a_volume_it_says_so(addon, refused):
    refused(bpy.ops.rle_splat.value_at_surface, "Import a volume first")


def test_values_have_the_decimals_that_their_range_needs(bridge):
    text = bridge("look.probe").value_text
    assert text(311.7, -1024.0, 3071.0, "HU") == "312 HU" and text(-0.2, -1024.0, 3071.0) == "0"
    assert text(-55.2, -160.0, 240.0, "HU") == "-55 HU" and text(5.21, 2.0, 8.0, "SUVbw") == "5.210 SUVbw"
    assert text(0.12345, 0.0, 1.0) == "0.123" and text(17.26, 0.0, 255.0) == "17.3"
    assert text(4e-6, 0.0, 1e-5) == "0.00000400" and text(3.0, 3.0, 3.0) == "3"


def test_positions_in_a_patient_have_letters(bridge, core):
    volume = core("volume.volume").Volume(np.zeros((2, 2, 2), np.uint8), np.eye(4), space="patient")
    assert bridge("look.probe").position_text(np.array((12.34, -45.0, 88.06)), volume) == "L 12.3 A 45.0 S 88.1 mm"
    assert bridge("look.probe").position_text((-12.34, 45.0, -88.0), volume) == "R 12.3 P 45.0 I 88.0 mm"
    plain = core("volume.volume").Volume(np.zeros((2, 2, 2), np.uint8), np.eye(4), unit="um")
    assert bridge("look.probe").position_text((-0.01, 45.0, -88.0), plain) == "x 0.0 y 45.0 z -88.0 um"
