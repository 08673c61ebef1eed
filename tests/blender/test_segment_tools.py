"""Segment tools: what becomes of a volume's labels, the file that keeps them, undo, export, and bad input."""

import json
import os
from pathlib import Path

import bpy
import nibabel
import numpy as np
import pytest

from tests.blender import layout_recorder, scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

N = 40  # voxels a side
BODY, TABLE, BONE = 100, 90, 220
BONE_AT = 12, 16, 20  # a voxel, x, y, z
OPACITY = [[60.0, 0.0], [80.0, 0.5], [255.0, 0.5]]


each_tool = pytest.mark.parametrize(
    "tool, options",
    [
        ("hide_table", {}), ("keep_connected", {"voxel": BONE_AT, "value": 180.0}),
        ("threshold_segment", {"low": 80.0, "high": 130.0}),
        *(("change_segment", {"tool": tool, "length": 6.0})
          for tool in ("GROW", "SHRINK", "SMOOTH", "FILL", "LARGEST", "INVERT")),
    ],
    ids=lambda given: given if isinstance(given, str) else given.get("tool", ""),
)  # fmt: skip


def scan():
    """A body with two separate bones in it, one of them smaller, above a table; 5 mm voxels."""
    z, y, x = np.indices((N, N, N)) - 0.5 * (N - 1)
    voxels = np.zeros((N, N, N), np.uint8)
    voxels[(x / 15.0) ** 2 + ((y + 3.0) / 11.0) ** 2 <= 1.0] = BODY
    voxels[(np.abs(y - 15.0) < 0.7) & (np.abs(x) < 18.0)] = TABLE
    for middle, radius in ((-7.0, 3.6), (6.0, 2.4)):
        voxels[(x - middle) ** 2 + (y + 3.0) ** 2 + z**2 <= radius**2] = BONE
    return voxels


@pytest.fixture
def owner(addon, tmp_path):
    found = scenes.import_raw(tmp_path, scan(), (5.0, 5.0, 5.0), "chest")
    scenes.load_color(tmp_path, (0.9, 0.5, 0.2), opacity=OPACITY)
    return found


@pytest.mark.parametrize(
    "name, options, unit, labels",
    [("threshold_segment", {}, "HU", ["Lowest Value (HU)", "Highest Value (HU)"]),
     ("change_segment", {"tool": "GROW"}, "mm", ["Distance (mm)"]),
     ("change_segment", {"tool": "SMOOTH"}, "mm", ["Radius (mm)"]),
     ("extract_surface", {"of": "VALUE"}, "HU", ["Value (HU)"])])  # fmt: skip
def test_dialogs_name_the_unit(addon, name, options, unit, labels):
    cls = next(one for one in layout_recorder.subclasses(bpy.types.Operator) if one.__name__.endswith(f"_OT_{name}"))
    log, properties = [], layout_recorder.operator_properties(cls.bl_idname)
    for option, value in options.items():
        setattr(properties, option, value)
    drawn = layout_recorder.Drawn(cls, log, properties)
    drawn.unit = unit
    cls.draw(drawn, bpy.context)
    for option in options:
        properties.property_unset(option)
    assert [text for kind, text in log if kind == "text"] == labels


def rows_of(owner):
    return [(row.label, row.label_name, row.show) for row in owner.rle_splat.labels]


def map_of(owner):
    """The label file as another library reads it, (nz, ny, nx)."""
    return np.asarray(nibabel.load(owner.rle_splat.label_file).dataobj).T


def run(operator, **options):
    assert operator(**options) == {"FINISHED"}


def picture():
    run(bpy.ops.rle_splat.render_image)
    return scenes.image_pixels(bpy.context.scene.rle_splat.image)


def buttons_of_display() -> list[str]:
    """Operators and properties of the buttons that hide and show the table, in the panel Display."""
    log, panel = [], bpy.types.RLE_SPLAT_PT_display
    panel.draw(layout_recorder.Drawn(panel, log), bpy.context)
    return [value for kind, value in log if kind in ("operator", "prop") and "table" in value]


def test_remove_table_shows_the_body_alone(owner):
    """From the front the table is a line behind the body; it is gone from the picture, and undo brings it back."""
    bpy.context.scene.render.resolution_x = bpy.context.scene.render.resolution_y = 48
    scenes.add_camera((97.5, 97.5, 600.0), type="ORTHO", ortho_scale=240.0)
    before = picture()
    run(bpy.ops.rle_splat.hide_table)
    assert rows_of(owner) == [(0, "Background", False), (1, "Body", True)]
    assert owner.rle_splat.active_label == 1
    found, voxels = map_of(owner) == 1, scan()
    assert found[(voxels == BODY) | (voxels == BONE)].all() and not found[voxels == TABLE].any()
    after = picture()
    table_row = 24 - round((0.5 * (N - 1) + 15.0) * 5.0 - 97.5) * 48 // 240  # y of the table in the picture
    assert before[table_row, 20:28, 3].min() > 0.5 and after[table_row, 20:28, 3].max() == 0.0
    np.testing.assert_allclose(after[26:32, 18:30], before[26:32, 18:30], atol=1e-3)
    assert owner.rle_splat.hide_table and buttons_of_display() == ["hide_table"]
    owner.rle_splat.hide_table = False
    assert rows_of(owner)[0] == (0, "Background", True) and not owner.rle_splat.hide_table
    assert buttons_of_display() == ["hide_table"]


def test_keep_connected_follows_what_is_shown_and_hides_the_rest(owner):
    middle = int(0.5 * (N - 1) - 7.0), int(0.5 * (N - 1) - 3.0), N // 2
    run(bpy.ops.rle_splat.keep_connected, voxel=middle, value=200.0)
    assert rows_of(owner) == [(0, "Background", False), (1, "Kept", True)]
    bone = (scan() == BONE) & (np.arange(N) < N // 2)
    np.testing.assert_array_equal(map_of(owner) == 1, bone)
    owner.rle_splat.labels[0].show, owner.rle_splat.labels[1].show = True, False
    run(bpy.ops.rle_splat.keep_connected, voxel=(N // 2, N // 2, 1))
    assert rows_of(owner) == [(0, "Background", False), (1, "Kept", False), (2, "Kept", True)]
    np.testing.assert_array_equal(map_of(owner) == 2, ((scan() == BODY) | (scan() == BONE)) & ~bone)
    np.testing.assert_array_equal(map_of(owner) == 1, bone)


def test_the_voxel_under_a_click_is_one_of_what_is_seen(owner, bridge):
    segments, probe, volumes = bridge("volumes.segments"), bridge("look.probe"), bridge("volumes.volumes")
    depsgraph = bpy.context.evaluated_depsgraph_get()
    ray = probe.Ray((97.5, 82.5, 600.0), (0.0, 0.0, -1.0))
    hit = probe.look_along(bpy.context, depsgraph, ray, [owner])
    voxel = segments.brightest_near(volumes.load_volume(owner), hit.surface.index)
    assert scan()[voxel[::-1]] >= BODY
    assert 60.0 < segments.lowest_visible(owner) < 65.0
    run(bpy.ops.rle_splat.keep_connected, voxel=voxel)
    np.testing.assert_array_equal(map_of(owner) == 1, (scan() == BODY) | (scan() == BONE))


def test_tools_change_the_chosen_segment_and_leave_others(owner):
    run(bpy.ops.rle_splat.threshold_segment, low=80.0, high=130.0)
    run(bpy.ops.rle_splat.threshold_segment, low=200.0, high=255.0)
    voxels, properties = scan(), owner.rle_splat
    assert rows_of(owner)[1:] == [(1, "80 to 130", True), (2, "200 to 255", True)] and properties.active_label == 2
    bones = voxels == BONE
    np.testing.assert_array_equal(map_of(owner) == 2, bones)

    def change(tool, **options):
        run(bpy.ops.rle_splat.change_segment, tool=tool, **options)
        return map_of(owner)

    before, properties.active_label = map_of(owner), 1
    np.testing.assert_array_equal(change("FILL"), before, "other segments in the holes stay")
    properties.active_label = 2
    largest = bones & (np.arange(N) < N // 2)
    np.testing.assert_array_equal(change("LARGEST") == 2, largest)
    grown = change("GROW", length=5.0) == 2
    expected = largest.copy()
    for axis in range(3):
        for way in (-1, 1):
            expected |= np.roll(largest, way, axis)
    np.testing.assert_array_equal(grown, expected)
    np.testing.assert_array_equal(change("SHRINK", length=5.0) == 2, largest)
    assert (map_of(owner)[grown & ~largest] == 0).all(), "what was taken from another segment is in none"
    before = map_of(owner)
    inverted = change("INVERT")
    np.testing.assert_array_equal(inverted, np.choose(before, (2, 1, 0)))
    properties.active_label = 1
    assert 0 < np.count_nonzero(change("SMOOTH", length=6.0) != inverted) < 3000
    filled = change("FILL")
    assert (filled == 1)[largest].all() and properties.labels[properties.active_label].label == 1


def test_a_tool_leaves_the_look_of_segments_as_it_is(owner):
    run(bpy.ops.rle_splat.threshold_segment, low=80.0, high=130.0)
    run(bpy.ops.rle_splat.threshold_segment, low=200.0, high=255.0)
    background, soft, _ = owner.rle_splat.labels
    soft.shown_color = 0.8, 0.2, 0.1
    soft.label_name, soft.look, soft.opacity = "Flesh", "SOLID", 0.25
    background.show = soft.show = False
    owner.rle_splat.active_label = 2
    for tool in ("GROW", "SMOOTH", "LARGEST"):
        run(bpy.ops.rle_splat.change_segment, tool=tool, length=5.0)
        background, soft, bones = owner.rle_splat.labels
        assert (background.show, soft.show, bones.show) == (False, False, True), tool
        assert (soft.label_name, soft.look, soft.opacity) == ("Flesh", "SOLID", 0.25)
        np.testing.assert_allclose(soft.shown_color, (0.8, 0.2, 0.1), atol=1e-6)


def test_labels_that_a_file_had_stay_and_the_body_takes_none_of_them(owner, tmp_path):
    organs = np.where(scan() == BONE, 7, 0).astype(np.uint8)
    organs[0, 0, 0] = 300 - 45  # a number as large as the type of the file allows
    organs.tofile(tmp_path / "organs.raw")
    owner.rle_splat.label_file = str(tmp_path / "organs.raw")
    run(bpy.ops.rle_splat.load_segments)
    owner.rle_splat.labels[1].label_name = "Bones"
    owner.rle_splat.labels[1].use_color, owner.rle_splat.labels[1].color = True, (0.1, 0.2, 0.3)
    run(bpy.ops.rle_splat.hide_table)
    assert [name for _, name, _ in rows_of(owner)] == ["Background", "Bones", "Segment 255", "Body"]
    assert (map_of(owner)[organs == 7] == 7).all() and map_of(owner).max() == 256
    assert (tmp_path / "organs.raw").read_bytes() == organs.tobytes()


def test_the_file_is_beside_the_blend_and_none_is_overwritten(owner, tmp_path):
    """Before the first save it is in Blender's temporary folder, and saving copies it."""
    run(bpy.ops.rle_splat.threshold_segment, low=200.0, high=255.0)
    first = Path(owner.rle_splat.label_file)
    assert first.is_relative_to(bpy.app.tempdir)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "case.blend"))
    folder = tmp_path / "case_rle_splat"
    assert Path(owner.rle_splat.label_file) == folder / "chest segments.nii.gz"
    stored = scenes.stored(tmp_path / "case.blend", "objects", owner.name).rle_splat.label_file
    assert stored.replace("\\", "/") == "//case_rle_splat/chest segments.nii.gz"  # Windows writes its own
    run(bpy.ops.rle_splat.change_segment, tool="GROW", length=6.0)
    assert Path(owner.rle_splat.label_file) == folder / "chest segments 2.nii.gz"
    assert (folder / "chest segments.nii.gz").read_bytes() == first.read_bytes()
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "case.blend"))
    opened = bpy.data.objects["chest"]
    assert Path(opened.rle_splat.label_file) == folder / "chest segments 2.nii.gz"
    assert [name for _, name, _ in rows_of(opened)] == ["Background", "200 to 255"]


@each_tool
def test_undo_brings_the_segments_of_before_back(owner, tool, options):
    bpy.ops.ed.undo_push(message="before")
    run(bpy.ops.rle_splat.threshold_segment, low=200.0, high=255.0)
    bpy.ops.ed.undo_push(message="bones")
    file, name, rows, before = owner.rle_splat.label_file, owner.name, rows_of(owner), map_of(owner)
    run(getattr(bpy.ops.rle_splat, tool), **options)
    assert owner.rle_splat.label_file != file
    bpy.ops.ed.undo_push(message=tool)
    bpy.ops.ed.undo()
    owner = bpy.data.objects[name]
    assert owner.rle_splat.label_file == file and rows_of(owner) == rows
    np.testing.assert_array_equal(map_of(owner), before)
    bpy.ops.ed.undo()
    owner = bpy.data.objects[name]
    assert owner.rle_splat.label_file == "" and not owner.rle_splat.labels


@pytest.mark.parametrize("name", ["out.nii.gz", "out.seg.nrrd"])
def test_export_writes_names_and_colors(owner, core, tmp_path, name):
    run(bpy.ops.rle_splat.threshold_segment, low=200.0, high=255.0)
    row = owner.rle_splat.labels[1]
    row.label_name, row.use_color, row.color = "Knochen & Co", True, (0.5, 0.25, 0.125)
    run(bpy.ops.rle_splat.export_segments, filepath=str(tmp_path / name))
    found = core("read.formats").read_volume(tmp_path / name)
    np.testing.assert_array_equal(found.voxels == 1, scan() == BONE)
    label = next(one for one in found.named_labels if one.label == 1)
    assert label.name == "Knochen & Co"
    np.testing.assert_allclose(label.color, (0.5, 0.25, 0.125), atol=1e-5)
    with pytest.raises(RuntimeError, match="never overwritten"):
        bpy.ops.rle_splat.export_segments(filepath=owner.rle_splat.label_file)


def test_bad_input_is_one_sentence_and_changes_nothing(owner, refused, tmp_path):
    ops = bpy.ops.rle_splat
    refused(ops.keep_connected, "Nothing is visible at this place", voxel=(0, 0, 0))
    refused(ops.keep_connected, "Nothing is visible at this place", voxel=(N, 0, 0))
    refused(ops.threshold_segment, "No voxel has a value from 230 to 240", low=230.0, high=240.0)
    refused(ops.threshold_segment, "exchange them", low=3.0, high=2.0)
    refused(ops.change_segment, "Choose a segment in the list", tool="GROW")
    refused(ops.export_segments, "Make or read segments first", filepath=str(tmp_path / "a.nii.gz"))
    refused(ops.pick_connected, "needs a click in a window")
    run(ops.threshold_segment, low=200.0, high=255.0)
    refused(ops.change_segment, "No part of the segment is as thick as 90", tool="SMOOTH", length=45.0)
    refused(ops.change_segment, "No voxel would be in the segment", tool="SHRINK", length=45.0)
    owner.rle_splat.active_label = 0
    refused(ops.change_segment, "not the background", tool="GROW")
    os.remove(owner.rle_splat.label_file)
    refused(ops.hide_table, "choose the file, or clear the field")


def test_a_scan_without_contrast_and_one_that_is_missing(addon, refused, tmp_path):
    refused(bpy.ops.rle_splat.hide_table, "Import a volume first")
    scenes.import_raw(tmp_path, np.full((9, 9, 9), 100, np.uint8))
    refused(bpy.ops.rle_splat.hide_table, "No body with air around it was found")


@each_tool
def test_it_is_done_in_steps_that_can_be_stopped(owner, bridge, core, tool, options, monkeypatch, capfd):
    """What a window does from a timer; Esc leaves no file, and segments as they were."""
    run(bpy.ops.rle_splat.threshold_segment, low=200.0, high=255.0)
    file, before, fractions = owner.rle_splat.label_file, rows_of(owner), []
    there = os.listdir(os.path.dirname(file))

    def stop_before_the_end(steps):
        for step in steps:
            fractions.append(step.fraction)
            if step.fraction > 0.9:  # while the file is written
                steps.close()
                raise core("scene").Cancelled

    monkeypatch.setattr(bridge("loop.jobs"), "drain", stop_before_the_end)
    assert getattr(bpy.ops.rle_splat, tool)(**options) == {"CANCELLED"}
    assert fractions == sorted(fractions) and len(fractions) > 10
    assert "Canceled; nothing was changed." in capfd.readouterr().out
    assert owner.rle_splat.label_file == file and rows_of(owner) == before
    assert os.listdir(os.path.dirname(file)) == there


def test_reports_of_pictures_count_with_the_new_labels(owner):
    run(bpy.ops.rle_splat.hide_table)
    bpy.context.scene.render.resolution_x = bpy.context.scene.render.resolution_y = 24
    scenes.add_camera((97.5, 97.5, 600.0), type="ORTHO", ortho_scale=240.0)
    picture()
    assert json.loads(bpy.context.scene.rle_splat.last_report_json)["plan"]["classification"] == "post"


@pytest.mark.parametrize("asked, holder, hidden", [(True, 900, True), (True, -300, False), (False, 900, False)])
def test_an_import_can_hide_a_holder_that_is_shown(addon, tmp_path, asked, holder, hidden):
    """Of a CT whose holder is as bright as bone; the preset ct-bone does not show a fainter one."""
    voxels = np.select([scan() == BONE, scan() == BODY, scan() == TABLE], [1200, 40, holder], -1000).astype("<i2")
    (tmp_path / "head.raw").write_bytes(voxels.tobytes())
    run(bpy.ops.rle_splat.import_volume, filepath=str(tmp_path / "head.raw"), shape=(N, N, N), dtype="int16",
        spacing=(5.0, 5.0, 5.0), value_unit="HU", modality="CT", preset="ct-bone", hide_table=asked)  # fmt: skip
    owner = bpy.context.view_layer.objects.active
    assert rows_of(owner) == ([(0, "Background", False), (1, "Body", True)] if hidden else [])
    assert bool(owner.rle_splat.label_file) is hidden
    if hidden:
        shown = map_of(owner).astype(bool)
        assert not shown[scan() == TABLE].any()
        assert shown[(scan() == BONE) | (scan() == BODY)].all()
