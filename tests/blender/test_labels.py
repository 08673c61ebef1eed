"""Proves that a volume object's labels are listed from their file, and shown, hidden and colored as the rows say."""

import json

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

N, ALPHA = 9, 0.2
COLOR = (0.9, 0.5, 0.2)


@pytest.fixture
def owner(tmp_path):
    """A homogeneous cube whose left third is labeled 3, the rest 0; seen from above."""
    owner = scenes.even_cube(tmp_path, N, ALPHA, COLOR)
    scenes.add_camera(((N - 1) / 2, (N - 1) / 2, 30.0), type="ORTHO", ortho_scale=12.0)
    render = bpy.context.scene.render
    render.resolution_x = render.resolution_y = 48
    labels = np.zeros((N, N, N), np.uint8)
    labels[:, :, :3] = 3
    path = tmp_path / "labels.raw"
    labels.tofile(path)
    owner.rle_splat.label_file = str(path)
    return owner


def column_of(x):
    return int((x - (N - 1) / 2) / 12.0 * 48 + 24)


def reported():
    return json.loads(bpy.context.scene.rle_splat.last_report_json)


def test_labels_are_listed_hidden_and_colored(owner):
    rows = owner.rle_splat.labels
    before = scenes.picture()
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    assert [(row.label, row.label_name) for row in rows] == [(0, "Background"), (3, "Segment 3")]
    np.testing.assert_array_equal(scenes.picture(), before)
    assert reported()["plan"]["classification"] == "post", "nothing asks for more than one transfer function"

    rows[1].use_color, rows[1].color = True, (0.0, 0.0, 1.0)
    blue = scenes.picture()
    left, right = (blue[20:28, column_of(x)].mean(axis=0) for x in (1.0, 6.0))
    assert left[2] == pytest.approx(left[3], abs=0.01) and left[0] < 0.01 < 0.3 < left[3]
    np.testing.assert_allclose(right[:3], right[3] * np.array(COLOR), atol=0.01)
    assert reported()["plan"]["classification"] == "post"

    rows[1].show = False
    hidden = scenes.picture()[20:28]
    assert hidden[:, column_of(0.5), 3].max() < 0.01 < 0.3 < hidden[:, column_of(6.0), 3].min()
    owner.rle_splat.smooth_labels = False
    assert np.abs(scenes.picture()[20:28] - hidden).max() > 0.02
    rows[1].label_name = "liver"
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    assert rows[1].label_name == "liver" and not rows[1].show, "what was said of a label stays"


def test_label_maps_are_read_in_steps(owner, bridge):
    """What a window reads first, in slices of work, and what Esc leaves: nothing."""
    loading, store, volumes = (bridge(name) for name in ("volumes.loading", "loop.store", "volumes.volumes"))

    def forget_labels():
        store.withdraw([wish for wish in store._wanted if wish.purpose == "labels"])

    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    owner.rle_splat.labels[1].show = False
    assert loading.missing_steps(owner) is None and loading.is_at_hand(owner)
    for forget in (forget_labels, volumes.forget_all):
        forget()
        assert not loading.is_at_hand(owner)
        steps = loading.missing_steps(owner)
        kept = dict(store._entries)
        messages = [next(steps).message]
        steps.close()
        assert store._entries == kept and not loading.is_at_hand(owner)
        messages += [step.message for step in loading.missing_steps(owner)]
        assert any("labels" in message for message in messages) or forget == volumes.forget_all
        assert loading.is_at_hand(owner) and loading.missing_steps(owner) is None
    forget_labels()
    work = bridge("loop.work")
    assert work.want(owner)  # as a backdrop that follows the scene does
    while work._tick() is not None:
        pass
    assert loading.is_at_hand(owner) and not work.want(owner)


def test_a_label_file_that_is_gone_is_told_and_not_waited_for(owner, bridge, refused, tmp_path):
    bpy.ops.rle_splat.load_segments()
    owner.rle_splat.labels[1].show = False
    (tmp_path / "labels.raw").unlink()
    assert bridge("volumes.loading").is_at_hand(owner)
    refused(bpy.ops.rle_splat.render_image, "choose the file, or clear the field")


def test_a_preset_for_a_label(owner):
    bpy.ops.rle_splat.load_segments()
    owner.rle_splat.labels[1].look = "smoke"
    changed = scenes.picture()[20:28]
    np.testing.assert_allclose(changed[:, column_of(6.0), :3], changed[:, column_of(6.0), 3:] * COLOR, atol=0.01)
    assert np.abs(changed[:, column_of(1.0), :3] - changed[:, column_of(1.0), 3:] * COLOR).max() > 0.02


def test_what_is_no_file_of_labels_is_refused_in_a_sentence(owner, refused, tmp_path):
    (tmp_path / "short.raw").write_bytes(bytes(17))
    owner.rle_splat.label_file = str(tmp_path / "short.raw")
    refused(bpy.ops.rle_splat.load_segments, "one whole number for each")
    owner.rle_splat.label_file = str(tmp_path / "missing.raw")
    refused(bpy.ops.rle_splat.load_segments, "choose the file")
    np.arange(N**3, dtype=np.uint16).tofile(tmp_path / "scan.raw")
    owner.rle_splat.label_file = str(tmp_path / "scan.raw")
    refused(bpy.ops.rle_splat.load_segments, "729 different values")


def test_the_path_of_the_labels_follows_the_blend(owner, tmp_path):
    bpy.ops.rle_splat.load_segments()
    owner.rle_splat.labels[1].show = False
    before = scenes.picture()
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "a.blend"))
    assert scenes.stored(folder / "a.blend", "objects", owner.name).rle_splat.label_file.startswith("//")
    bpy.ops.wm.open_mainfile(filepath=str(folder / "a.blend"))
    np.testing.assert_array_equal(scenes.picture(), before)


def test_the_segments_of_another_file_take_nothing_of_those_before(owner, tmp_path):
    rows = owner.rle_splat.labels
    bpy.ops.rle_splat.load_segments()
    rows[1].label_name, rows[1].show, first = "liver", False, tuple(rows[1].color)
    other = np.zeros((N, N, N), np.uint8)
    other[:, :, :3], other[:, :, 6:] = 3, 4
    other.tofile(tmp_path / "other.raw")
    owner.rle_splat.label_file = str(tmp_path / "other.raw")
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    assert [(row.label, row.label_name, row.show) for row in rows] == [
        (0, "Background", True), (3, "Segment 3", True), (4, "Segment 4", True)]  # fmt: skip
    colors = np.array([row.color for row in rows])
    apart = np.abs(colors[:, np.newaxis] - colors).max(axis=-1)
    assert apart[~np.eye(3, dtype=bool)].min() > 0.2 and tuple(rows[1].color) == first


@pytest.mark.parametrize("size, hides", [(3, True), (1, False)])
def test_an_import_shows_the_segments_beside_the_scan(size, hides, addon, tmp_path, capfd):
    """In colors by their names, without the rest of the scan if they are a good part of it."""
    nibabel = pytest.importorskip("nibabel")
    scan, labels = np.full((N, N, N), 100, np.uint8), np.zeros((N, N, N), np.uint8)
    labels[:, :size, :size] = 2
    nibabel.save(nibabel.Nifti1Image(scan, np.eye(4)), tmp_path / "ct.nii.gz")
    nibabel.save(nibabel.Nifti1Image(labels, np.eye(4)), tmp_path / "ct_seg.nii.gz")
    (tmp_path / "ct_seg.txt").write_text('2 255 0 0 1 1 1 "liver"\n')
    for asked in (True, False):
        assert bpy.ops.rle_splat.import_volume(filepath=str(tmp_path / "ct.nii.gz"), use_segments=asked) == {"FINISHED"}
        properties = bpy.context.view_layer.objects.active.rle_splat
        found = [(row.label_name, row.show, row.look) for row in properties.labels]
        assert found == ([("Background", not hides, "OWN"), ("liver", True, "SOLID")] if asked else [])
    # Of segments elsewhere, and of two maps, the scan comes without.
    away = np.eye(4)
    away[:3, 3] = 90.0
    nibabel.save(nibabel.Nifti1Image(labels, away), tmp_path / "ct_seg.nii.gz")
    assert bpy.ops.rle_splat.import_volume(filepath=str(tmp_path / "ct.nii.gz"), use_segments=True) == {"FINISHED"}
    assert not bpy.context.view_layer.objects.active.rle_splat.labels
    assert "The segmentation file lies elsewhere" in capfd.readouterr().out
    (tmp_path / "ct_label.nii.gz").write_bytes((tmp_path / "ct_seg.nii.gz").read_bytes())
    assert bpy.ops.rle_splat.import_volume(filepath=str(tmp_path / "ct.nii.gz"), use_segments=True) == {"FINISHED"}
    assert not bpy.context.view_layer.objects.active.rle_splat.labels
    assert "Several segmentations lie beside the scan (ct_label.nii.gz, ct_seg.nii.gz)" in capfd.readouterr().out


def test_a_segment_fades_out_by_keyframes(owner):
    bpy.ops.rle_splat.load_segments()
    row, scene = owner.rle_splat.labels[1], bpy.context.scene
    for frame, opacity in ((1, 1.0), (10, 0.0)):
        row.opacity = opacity
        row.keyframe_insert("opacity", frame=frame)
    shown = []
    for frame in (1, 10):
        scene.frame_set(frame)
        shown.append(scenes.picture()[20:28, column_of(0.5), 3].max())
    assert shown[1] < 0.01 < 0.3 < shown[0]
