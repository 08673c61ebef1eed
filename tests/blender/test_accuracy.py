"""The accuracy panel's operators: the measured list is of the scene's own picture, a row chosen is a plan set, and the
error map is picture less truth, with the truth's name beside it; all of it through save and load."""

import json

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

SIZE = (24, 20)


@pytest.fixture
def volume(tmp_path):
    """A ball that grows denser inwards, seen obliquely in perspective."""
    z, y, x = np.mgrid[:8, :8, :8] - 3.5
    voxels = np.clip(255.0 - 62.0 * np.sqrt(x**2 + y**2 + z**2), 0.0, 255.0).astype(np.uint8)
    owner = scenes.import_raw(tmp_path, voxels, name="ball")
    scenes.give_transfer(owner, ((0.0, 0.0), (255.0, 0.5)), (0.9, 0.5, 0.2))
    scenes.add_camera((3.5, -5.5, 15.0), (0.6, 0.0, 0.0))
    bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = SIZE
    return owner


@pytest.fixture
def measured(volume):
    assert bpy.ops.rle_splat.measure_accuracy(probes=50, repeats=1) == {"FINISHED"}
    return bpy.context.scene.rle_splat


@pytest.fixture
def listed(volume, bridge, core):
    """A list of a few plans, measured without the operator: quicker."""
    plans, sweeps, scene = core("accuracy.planner.plans"), core("accuracy.planner.measure_plans"), bpy.context.scene
    plain, quality = scenes.read_scene(volume)
    few = [plan for plan in plans.sensible_plans(quality) if plan.name in ("paper", "pre draft", "draft", "strict")]
    sweep = core("runtime.steps").drain(sweeps.sweep_steps(plain, few, quality, probes=60, repeats=1))
    bridge("data.accuracy").note_sweep(scene.rle_splat, sweep.report, "the ball")
    return scene.rle_splat


def test_the_list_is_the_front_and_the_current_plan(measured, bridge):
    accuracy, scene = bridge("data.accuracy"), bpy.context.scene
    rows = list(measured.accuracy_rows)
    current = [row.name for row in rows if accuracy.is_current(scene, row)]
    assert current == [measured.quality] and len(rows) >= 2
    for truth in {row.truth for row in rows}:
        front = [row for row in rows if row.truth == truth and row.on_front]
        assert [row.frame_ms for row in front] == sorted(row.frame_ms for row in front)
        assert [row.rmse for row in front] == sorted((row.rmse for row in front), reverse=True)
    assert all(0.0 <= row.rmse <= row.largest and row.frame_ms > 0.0 for row in rows)
    assert "ball seen by Camera" in measured.accuracy_note and "24 x 20" in measured.accuracy_note


def test_choosing_a_row_sets_its_plan(listed, bridge):
    accuracy, scene = bridge("data.accuracy"), bpy.context.scene
    listed.max_error = 2.0  # chooses plans by itself
    for index, row in enumerate(listed.accuracy_rows):
        assert not accuracy.is_current(scene, row) or index
        assert bpy.ops.rle_splat.choose_plan(index=index) == {"FINISHED"}
        assert [accuracy.is_current(scene, other) for other in listed.accuracy_rows].index(True) == index
        plan = bridge("data.settings").quality_of(scene)
        for name, value in json.loads(row.knobs).items():
            assert getattr(plan, name) == (pytest.approx(value) if isinstance(value, float) else value), name
    with pytest.raises(RuntimeError, match="no measured plan"):
        bpy.ops.rle_splat.choose_plan(index=99)


def test_every_sensible_plan_can_be_chosen(listed, bridge, core):
    """By name where a quality is the same, else knob by knob: none is lost on the way through Blender's properties."""
    accuracy, plans, scene = bridge("data.accuracy"), core("accuracy.planner.plans"), bpy.context.scene
    row, quality = listed.accuracy_rows[0], core("scene").Quality
    for base in (quality(), quality(classification="pre", record=8)):
        for plan in plans.sensible_plans(base):
            row.name, row.knobs = plan.name, json.dumps(plans.knobs_of(plan))
            accuracy.choose(scene, row)
            assert accuracy.is_current(scene, row), plan


def test_a_plan_of_a_classification_that_was_removed(listed, bridge, core):
    plans, scene, row = core("accuracy.planner.plans"), bpy.context.scene, listed.accuracy_rows[0]
    knobs = plans.knobs_of(core("scene").Quality.preset("draft", classification="pre", record=8))
    row.knobs = json.dumps({**knobs, "classification": "refined", "refinement": 3})
    assert bpy.ops.rle_splat.choose_plan(index=0) == {"FINISHED"}
    assert bridge("data.accuracy").is_current(scene, row) and (listed.classification, listed.record) == ("post", "16")
    assert listed.message == "The classification 'refined' was removed; 'post' with the record 16 is used instead."


def test_another_plan_is_measured_beside_and_marked(volume, bridge):
    settings = bpy.context.scene.rle_splat
    settings.quality, settings.sheet_density, settings.depth_rule = "custom", 1.3, "midpoint-2"
    bpy.ops.rle_splat.measure_accuracy(probes=50, repeats=1)
    row = next(row for row in settings.accuracy_rows if row.name == "custom")
    assert bridge("data.accuracy").is_current(bpy.context.scene, row)
    settings.quality = "draft"
    assert not bridge("data.accuracy").is_current(bpy.context.scene, row)


@pytest.mark.parametrize("step", (1, 3))
def test_the_error_map_is_picture_less_truth(volume, bridge, core, step):
    settings = bpy.context.scene.rle_splat
    settings.quality = "draft"
    assert bpy.ops.rle_splat.error_map(step=step) == {"FINISHED"}
    plain, quality = scenes.read_scene(volume)
    rendering = core("pipeline.render").render(plain, quality)
    name = rendering.report["error"]["truth"]
    shading = core("accuracy.lighting").shading_of(plain, name)
    figure_text = core("runtime.figures").figure_text
    true = core("accuracy.truths").truth(plain, name, **shading)[0].reshape(SIZE[1], SIZE[0], 4)
    expected = np.abs(rendering.rgba - true).max(axis=-1)[step // 2 :: step, step // 2 :: step] * 255.0
    image = settings.error_image
    assert image.name == "ball Splat Error" and image.colorspace_settings.name == "Non-Color"
    found = scenes.image_pixels(image)
    np.testing.assert_allclose(found[..., 0], expected, atol=1e-4)
    assert expected.max() > 0.5 and (found[..., 3] == 1.0).all()
    against = core("accuracy.planner.table").TRUTH_TEXTS[name]
    assert f"Against {against}, in 8-bit steps: largest {figure_text(expected.max())}," in settings.error_note


def test_it_survives_save_and_load(listed, tmp_path):
    bpy.ops.rle_splat.error_map()
    names, note = [row.name for row in listed.accuracy_rows], listed.error_note
    before = scenes.image_pixels(listed.error_image)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    settings = bpy.context.scene.rle_splat
    assert [row.name for row in settings.accuracy_rows] == names and settings.error_note == note
    np.testing.assert_array_equal(scenes.image_pixels(settings.error_image), before)


def test_measuring_again_replaces_the_list(listed):
    assert "the ball" in listed.accuracy_note
    assert bpy.ops.rle_splat.measure_accuracy(probes=50, repeats=1) == {"FINISHED"}
    names = [row.name for row in listed.accuracy_rows]
    assert len(set(names)) == len(names) and "the ball" not in listed.accuracy_note


def test_without_a_camera_it_is_refused(volume, refused):
    bpy.context.scene.camera = None
    refused(bpy.ops.rle_splat.measure_accuracy, "camera")
    refused(bpy.ops.rle_splat.error_map, "camera")
    refused(bpy.ops.rle_splat.choose_plan, "measure", index=0)


def test_an_empty_view_is_refused(volume, refused):
    bpy.context.scene.camera.rotation_euler = (np.pi, 0.0, 0.0)
    bpy.context.view_layer.update()
    refused(bpy.ops.rle_splat.measure_accuracy, "camera does not see")
    assert not bpy.context.scene.rle_splat.accuracy_rows


def test_the_panel_shows_the_list_and_the_truth(listed, monkeypatch):
    from tests.blender import test_panels

    log = test_panels.draw_all(monkeypatch)
    shown = test_panels.texts(log)
    assert log.count(("operator", "rle_splat.choose_plan")) == 2 * len(listed.accuracy_rows)  # in both places
    assert "Against the" in shown and ("operator", "rle_splat.measure_accuracy") in log
    assert f"{listed.accuracy_rows[0].frame_ms:.0f}" in shown.split("\n")
    assert ("operator", "rle_splat.error_map") in log and ("prop", "error_image") not in log
    bpy.ops.rle_splat.error_map()
    assert ("prop", "error_image") in test_panels.draw_all(monkeypatch)
