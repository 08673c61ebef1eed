"""Medical files in Blender: imported where the patient lies, read again after a reload, with letters at the box."""

import math

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Euler, Vector

from tests.blender import formats, scenes

AFFINE = np.array([(-2.0, 0.3, 0, 30), (0, 1.5, 0.4, -20), (0, 0, 3.0, 100), (0, 0, 0, 1)])  # to LPS, sheared


SIDES = {"L": (1, 0, 0), "R": (-1, 0, 0), "P": (0, 1, 0), "A": (0, -1, 0), "S": (0, 0, 1), "I": (0, 0, -1)}  # in LPS


@pytest.fixture
def nibabel(addon):
    """nibabel from the extension's wheels, which are there when the extension is."""
    return pytest.importorskip("nibabel")


def active():
    return bpy.context.view_layer.objects.active


@pytest.fixture
def values():
    return np.random.default_rng(5).integers(0, 200, (6, 7, 8)).astype(np.int16)  # x, y, z


@pytest.fixture
def nifti(tmp_path, values, nibabel):
    path = tmp_path / "scan.nii.gz"
    image = nibabel.Nifti1Image(values, np.diag((-1.0, -1, 1, 1)) @ AFFINE)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, path)
    return path


def test_a_nifti_lies_in_the_world_as_the_patient_does(nifti, values, bridge):
    assert bpy.ops.rle_splat.import_volume(filepath=str(nifti)) == {"FINISHED"}
    owner = active()
    volume = bridge("volumes.volumes").load_volume(owner)
    np.testing.assert_array_equal(volume.voxels.transpose(2, 1, 0), values)
    np.testing.assert_allclose(volume.affine, AFFINE, rtol=1e-6)
    assert owner.name == "scan" and owner.rle_splat.space == "patient"
    assert "Orientation: R P S, 11.3° oblique" in owner.rle_splat.facts
    np.testing.assert_array_equal(np.array(owner.matrix_world), np.eye(4))
    holder = owner.instance_collection.objects[0]
    first = np.array(holder.matrix_world @ holder.data.vertices[0].co)
    np.testing.assert_allclose(first, AFFINE[:3, 3] * 0.001, rtol=1e-6)  # millimeters in a world of meters


@pytest.mark.parametrize("frames", [1, 3])
def test_a_message_begins_with_what_was_chosen_and_warns_only_of_what_needs_an_action(
    tmp_path, values, nibabel, capfd, frames
):
    path = tmp_path / "scan.nii.gz"
    nibabel.save(nibabel.Nifti1Image(np.stack([values] * frames, axis=-1), np.diag((-1.0, -1, 1, 1)) @ AFFINE), path)
    assert bpy.ops.rle_splat.import_volume(filepath=str(path)) == {"FINISHED"}
    (message,) = [line for line in capfd.readouterr().out.splitlines() if line.startswith(("Warning:", "Info:"))]
    assert message.startswith("Info: Imported scan. ")
    ends = ("mm is assumed.", "There are 3 time points; time point 1 was read.")
    assert message.endswith(ends[frames > 1])


@pytest.mark.parametrize(
    ("degrees", "across"), [(0, ("R", "L")), (90, ("A", "P")), (35, ("RA", "LP")), (-110, ("P", "A"))]
)
def test_letters_name_the_sides_of_the_view(nifti, bridge, degrees, across):
    """A view turned about the patient's length; the volume lies elsewhere."""
    bpy.ops.rle_splat.import_volume(filepath=str(nifti))
    owner = active()
    owner.location = (1.0, 2.0, 3.0)
    bpy.context.view_layer.update()
    turn = math.radians(degrees)
    found = bridge("live.letters").letters_of_sides(owner, ((math.cos(turn), math.sin(turn), 0.0), (0.0, 0.0, 1.0)))
    assert [text for text, _ in found] == [*across, "S", "I"]
    assert [tuple(toward) for _, toward in found] == [(-1, 0), (1, 0), (0, 1), (0, -1)]


def test_letters_of_a_viewport_stand_at_the_outline_of_the_box(bridge):
    """The box is a hexagon in the picture, with corners on the axis across and level edges."""
    distance = bridge("live.letters")._outline_distance
    corners = np.array([(-4, 0), (-2, -1), (2, -1), (4, 0), (2, 1), (-2, 1), (1, 0), (0, 0)], float)
    for toward, expected in (((1.0, 0.0), 4.0), ((0.0, 1.0), 1.0), ((0.6, 0.8), 1.25), ((0.8, -0.6), 5.0 / 3.0)):
        assert distance(corners, np.array(toward)) == pytest.approx(expected)


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_letters_and_a_scale_bar_as_objects_of_a_render(nifti, bridge, kind):
    bpy.ops.rle_splat.import_volume(filepath=str(nifti))
    owner, scene = active(), bpy.context.scene
    middle = Vector(bridge("volumes.box").world_corners(owner).mean(axis=0))
    scenes.add_camera(middle + Vector((0.0, -0.5, 0.0)), rotation=(math.radians(90.0), 0.0, 0.0), type=kind,
                      ortho_scale=0.1, clip_start=0.01)  # fmt: skip
    has_objects = bridge("live.letters").has_objects
    assert not has_objects(owner)
    for _ in range(2):  # the second time in place of the first ones
        assert bpy.ops.rle_splat.add_letters() == {"FINISHED"}
    bpy.context.view_layer.update()
    made = {one.name: one for one in scene.objects if "rle_splat_letters" in one}
    length = {"PERSP": 50.0, "ORTHO": 20.0}[kind]  # of a picture 360 and 100 mm wide
    assert set(made) == {"R", "L", "S", "I", "Scale Bar", f"{length:g} mm"}  # A and P lie along the view
    seen = {name: world_to_camera_view(scene, scene.camera, one.matrix_world.translation)
            for name, one in made.items()}  # fmt: skip
    assert seen["R"].x < 0.5 < seen["L"].x and seen["I"].y < 0.5 < seen["S"].y  # from the front
    assert (made["R"].matrix_world.to_3x3().normalized().col[2] - Vector((0.0, -1.0, 0.0))).length < 1e-5
    bar = made["Scale Bar"]
    ends = [world_to_camera_view(scene, scene.camera, bar.matrix_world @ Vector((x, 0.0, 0.0))) for x in (0.0, 1.0)]
    at_the_middle = [world_to_camera_view(scene, scene.camera, middle + Vector((x, 0.0, 0.0)))
                     for x in (0.0, 0.001 * length)]  # fmt: skip
    assert ends[1].x - ends[0].x == pytest.approx(at_the_middle[1].x - at_the_middle[0].x, rel=1e-4)
    assert 0.0 < ends[0].x < ends[1].x < 0.5 and 0.0 < ends[0].y < 0.2 and ends[0].z < min(
        seen[name].z for name in "RLSI")  # fmt: skip
    assert not any(one.visible_shadow for one in made.values())
    assert has_objects(owner)
    for name in "RLSI":
        made[name].hide_set(True)
    assert not has_objects(owner)


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize(("turn", "expected"), [(30.0, "LP RA S I"), (-60.0, "AL PR S I"), (110.0, "P A S I")])
def test_letters_of_a_render_stand_at_the_edges_of_an_oblique_picture(nifti, bridge, kind, turn, expected):
    bpy.ops.rle_splat.import_volume(filepath=str(nifti))
    owner, scene = active(), bpy.context.scene
    middle = bridge("volumes.box").world_corners(owner).mean(axis=0)
    angles = math.radians(85.0), 0.0, math.radians(turn)
    place = Vector(middle) + Euler(angles).to_matrix() @ Vector((0.004, 0.002, 0.12))
    scenes.add_camera(place, rotation=angles, type=kind, ortho_scale=0.1, clip_start=0.01)
    scene.camera.data.shift_x = 0.1
    assert bpy.ops.rle_splat.add_letters() == {"FINISHED"}
    bpy.context.view_layer.update()

    def seen(point) -> np.ndarray:
        return np.array(world_to_camera_view(scene, scene.camera, Vector(point))[:2])

    made = {one.name: seen(one.matrix_world.translation) for one in scene.objects if set(one.name) <= set(SIDES)}
    assert set(made) == set(expected.split())
    for letter, point in made.items():
        away = point - 0.5
        assert 0.4 < np.abs(away).max() < 0.49 and np.abs(away).min() < 1e-4, f"{letter} is not at an edge's middle"
        for side in letter:
            true = seen(middle + 0.001 * np.array(SIDES[side])) - seen(middle)
            assert true @ away > 0.0, f"{letter} is on the wrong side"


def test_a_volume_without_a_place_has_no_letters(volume_object, bridge):
    assert bridge("live.letters").letters_of_sides(volume_object, np.eye(2, 3)) == []


def test_the_view_of_a_slice_names_its_place_in_the_patient(nifti, bridge):
    bpy.ops.rle_splat.import_volume(filepath=str(nifti))
    owner = active()
    owner.location = (1.0, 2.0, 3.0)  # of the object, not of the patient
    bpy.ops.rle_splat.add_slice(kind="AXIAL")
    one, middle = active(), (AFFINE @ (2.5, 3.0, 4.0, 1))[:3]  # a layer of voxels
    for layers in (0.0, -40.0):
        one.location.z += 0.001 * layers * np.linalg.norm(AFFINE[:3, 2])  # along the voxels
        bpy.context.view_layer.update()
        text = bridge("live.slice_places").place_text(one, bpy.context.evaluated_depsgraph_get())
        height = middle[2] + 3.0 * layers
        assert text == f"Axial, {'S' if height > 0.0 else 'I'} {abs(height):.1f} mm"
        assert one.rle_splat.slice_position == pytest.approx(height, abs=1e-3)
    one.rotation_euler.x = 0.3
    for height in (12.0, -34.0):
        one.rle_splat.slice_position = height
        bpy.context.view_layer.update()
        text = bridge("live.slice_places").place_text(one, bpy.context.evaluated_depsgraph_get())
        assert text.endswith(f"{'S' if height > 0.0 else 'I'} {abs(height):.1f} mm")
        assert bridge("live.slice_places").growing_side(one, bpy.context.evaluated_depsgraph_get()) == "S+"


def test_it_is_read_again_after_a_reload_and_after_it_moved(nifti, values, bridge, tmp_path):
    bpy.ops.rle_splat.import_volume(filepath=str(nifti))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    owner = active()
    np.testing.assert_array_equal(bridge("volumes.volumes").load_volume(owner).voxels.transpose(2, 1, 0), values)
    moved = nifti.rename(tmp_path / "elsewhere.nii.gz")
    bridge("volumes.volumes").forget_all()
    assert bpy.ops.rle_splat.relocate_volume(filepath=str(moved)) == {"FINISHED"}
    volume = bridge("volumes.volumes").load_volume(owner, warn=pytest.fail)
    np.testing.assert_allclose(volume.affine, AFFINE, rtol=1e-6)


def test_a_frame_is_chosen_and_kept(tmp_path, bridge, nibabel):
    values = np.arange(3 * 4 * 5 * 6, dtype=np.int16).reshape(3, 4, 5, 6)
    nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), tmp_path / "a.nii")
    bpy.ops.rle_splat.import_volume(filepath=str(tmp_path / "a.nii"), frame=4)
    owner = active()
    bridge("volumes.volumes").forget_all()
    voxels = bridge("volumes.volumes").load_volume(owner).voxels
    np.testing.assert_array_equal(voxels.transpose(2, 1, 0), values[..., 3])
    assert "Time Points: 6" in owner.rle_splat.facts


def test_bad_files_are_refused_in_a_sentence_and_change_nothing(nifti, refused, tmp_path):
    content = nifti.read_bytes()
    nifti.write_bytes(content[:-40])
    before = len(bpy.data.objects)
    refused(bpy.ops.rle_splat.import_volume, "breaks off", filepath=str(nifti))
    refused(bpy.ops.rle_splat.import_volume, "holds no medical images", filepath=str(tmp_path))
    assert len(bpy.data.objects) == before


def test_named_labels_fill_the_rows(nifti, tmp_path, nibabel):
    bpy.ops.rle_splat.import_volume(filepath=str(nifti))
    owner = active()
    labels = np.zeros((6, 7, 8), np.uint8)
    labels[3:] = 2
    flip = np.diag((-1.0, 1, 1, 1))
    flip[0, 3] = 5
    image = nibabel.Nifti1Image(labels[::-1], np.diag((-1.0, -1, 1, 1)) @ AFFINE @ flip)
    nibabel.save(image, tmp_path / "seg.nii.gz")
    (tmp_path / "seg.txt").write_text('0 0 0 0 0 0 0 "Clear Label"\n2 255 0 0 1 1 1 "liver"\n')
    owner.rle_splat.label_file = str(tmp_path / "seg.nii.gz")
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    rows = owner.rle_splat.labels
    assert [(row.label, row.label_name) for row in rows] == [(0, "Clear Label"), (2, "liver")]
    assert rows[1].use_color
    assert tuple(rows[1].color) == (1.0, 0.0, 0.0)


def test_dropping_is_offered_for_medical_files_but_not_for_pictures():
    dropped = bpy.types.RLE_SPLAT_FH_volume.bl_file_extensions.split(";")
    assert {".nii", ".gz", ".nrrd", ".nhdr", ".mha", ".mhd", ".vdb", ".raw"} <= set(dropped)
    assert not {".tif", ".tiff", ".hdr", ".img"} & set(dropped)


def test_lzw_pages_are_decoded_by_blenders_own_module(tmp_path, bridge):
    """tifffile needs a package for LZW that the extension does without."""
    bpy.utils.expose_bundled_modules()
    oiio = pytest.importorskip("OpenImageIO")
    values = (np.arange(5 * 7 * 9) * 37 % 60000).astype(np.uint16).reshape(5, 7, 9)
    for number, page in enumerate(values):
        path = str(tmp_path / f"page{number}.tif")
        output = oiio.ImageOutput.create(path)
        spec = oiio.ImageSpec(9, 7, 1, "uint16")
        spec.attribute("compression", "lzw")
        assert output.open(path, spec) and output.write_image(np.ascontiguousarray(page[..., None]))
        output.close()
    tiff = pytest.importorskip("tifffile")
    with tiff.TiffFile(tmp_path / "page0.tif") as file:
        assert file.pages[0].compression.name == "LZW"
    bpy.ops.rle_splat.import_volume(filepath=str(tmp_path / "page0.tif"))
    np.testing.assert_array_equal(bridge("volumes.volumes").load_volume(active()).voxels, values)


def test_one_file_of_each_family(tmp_path, bridge, nibabel):
    for name in formats.write_families(tmp_path):
        assert bpy.ops.rle_splat.import_volume(filepath=str(tmp_path / name)) == {"FINISHED"}
        volume = bridge("volumes.volumes").load_volume(active())
        np.testing.assert_array_equal(volume.voxels.transpose(2, 1, 0), formats.values(), err_msg=name)
