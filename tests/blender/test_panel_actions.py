"""What the panels' own buttons and settings do: volumes chosen, modes with their look, segments, cuts, scans edited."""

import os
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from tests.blender import layout_recorder, scenes
from tests.blender.real_blender import MODULE
from tests.blender.scenes import module

pytestmark = pytest.mark.usefixtures("by_numpy")

N = 9


@pytest.fixture
def owner(addon, tmp_path):
    """A volume whose values grow from 0 to 200 along x, seen from above."""
    voxels = np.broadcast_to(np.linspace(0.0, 200.0, N).astype(np.uint8), (N, N, N)).copy()
    found = scenes.import_raw(tmp_path, voxels)
    scenes.add_camera(((N - 1) / 2, (N - 1) / 2, 30.0), type="ORTHO", ortho_scale=N - 1.0)
    render = bpy.context.scene.render
    render.resolution_x = render.resolution_y = 32
    return found


def test_a_chosen_volume_is_the_one_that_buttons_work_on(owner, bridge, tmp_path):
    other = scenes.import_raw(tmp_path, np.zeros((2, 2, 2), np.uint8), name="other")
    assert bridge("volumes.volumes").volume_object(bpy.context) == other
    assert bpy.ops.rle_splat.choose_object(name=owner.name) == {"FINISHED"}
    assert bridge("volumes.volumes").volume_object(bpy.context) == owner
    assert owner.select_get() and not other.select_get()


def test_an_object_that_is_not_there_cannot_be_chosen(owner, refused):
    refused(bpy.ops.rle_splat.choose_object, "not in this view layer", name="nothing")


def state_line(is_on, monkeypatch, viewports=()):
    """What the top of the tab says of a viewport that shows volumes or not."""
    live_view = module("panels.live_view")
    monkeypatch.setattr(live_view.live, "viewports_of", lambda area: viewports)
    log = []
    context = SimpleNamespace(
        area=SimpleNamespace(type="VIEW_3D", regions=()), region=None, preferences=bpy.context.preferences,
        scene=bpy.context.scene, view_layer=bpy.context.view_layer,
        space_data=SimpleNamespace(show_object_viewport_volume=is_on))  # fmt: skip
    live_view.draw_state(context, layout_recorder.Recorder(log))
    return log


def test_the_tab_says_that_another_file_has_the_name_of_the_imported_one(owner, bridge, monkeypatch):
    """As a render does; a viewport reads the file itself when it has changed."""
    viewport = SimpleNamespace(is_busy=False, is_refined=True, waits=False, problem="", halvings=0, pictures=[None])
    assert not any("are not those" in str(value) for _, value in state_line(True, monkeypatch, [viewport]))
    path = Path(owner.rle_splat.filepath)
    path.write_bytes(bytes(path.stat().st_size))
    os.utime(path, ns=(0, 0))
    bridge("volumes.volumes").load_volume(owner)
    shown = "".join(f" {value}" for _, value in state_line(True, monkeypatch, [viewport]))
    assert "are not those" in shown and "Up to date" in shown


def test_a_missing_file_has_its_button_beside_its_sentence(owner, monkeypatch):
    viewport = SimpleNamespace(
        is_busy=False, is_refined=True, waits=False, problem="The file of 'cube' is gone.", halvings=0, pictures=[]
    )
    assert ("operator", "rle_splat.relocate_volume") not in state_line(True, monkeypatch, [viewport])
    Path(owner.rle_splat.filepath).unlink()
    assert ("operator", "rle_splat.relocate_volume") in state_line(True, monkeypatch, [viewport])


def test_the_state_has_one_line_while_a_picture_is_made(owner, monkeypatch):
    for is_busy in (True, False):
        for halvings in (0, 3):
            viewport = SimpleNamespace(
                is_busy=is_busy, is_refined=False, waits=False, problem="", halvings=halvings, pictures=[None]
            )
            assert sum(kind == "label" for kind, _ in state_line(True, monkeypatch, [viewport])) == 1


def test_the_tab_says_whether_what_is_shown_is_up_to_date(owner, monkeypatch):
    for is_busy, is_refined, waits, text in (
        (False, True, True, "Reading files"), (True, False, False, "Refining"), (False, True, False, "Up to date"),
        (False, False, False, "Draft, up to date"),
    ):  # fmt: skip
        viewport = SimpleNamespace(
            is_busy=is_busy, is_refined=is_refined, waits=waits, problem="", halvings=0, pictures=[None]
        )
        assert [("label", text)] == [one for one in state_line(True, monkeypatch, [viewport]) if one[0] == "label"]
    assert ("label", "Not shown in this viewport") in state_line(False, monkeypatch)
    scenes.picture()
    assert ("label", "Not shown in this viewport") in state_line(False, monkeypatch)
    owner.rle_splat.window_width *= 2.0
    log = state_line(False, monkeypatch)
    assert ("operator", "rle_splat.render_image") in log
    assert any("Out of date" in str(value) for kind, value in log if kind == "label")


def test_a_mode_chosen_in_the_panel_is_gray_by_level_and_window(owner, bridge, core):
    settings, properties = owner.rle_splat, owner.rle_splat
    settings.display = "mip"
    properties.window_center, properties.window_width = 100.0, 200.0
    assert (settings.mode, settings.use_grays) == ("mip", True)
    row = scenes.picture()[16]
    np.testing.assert_allclose(row[:, 0], row[:, 3], atol=1e-5)  # white, as opaque as the value is high
    shown = core("scene.color").to_display(row[4:28, 0])
    np.testing.assert_allclose(shown, (np.arange(4, 28) + 0.5) / 32, atol=0.03)
    assert not bridge("pictures.outdated").out_of_date(bpy.context.scene)
    properties.window_center = 50.0
    assert bridge("pictures.outdated").out_of_date(bpy.context.scene)
    settings.display = "composite"
    assert (settings.mode, settings.use_grays) == ("composite", False)
    settings.mode = "mip"  # as scripts do: the look stays
    assert settings.display == "mip" and not settings.use_grays


def test_xray_in_gray_is_brighter_where_values_are_higher(owner):
    bpy.context.scene.rle_splat.display = "xray"
    owner.rle_splat.window_center, owner.rle_splat.window_width = 100.0, 200.0
    alpha = scenes.picture()[16, :, 3]
    assert 0.1 < alpha[28] < 0.9 and (np.diff(alpha[3:29]) > 0.0).all()


def test_a_shift_moves_the_whole_transfer_function_from_where_the_preset_put_it(owner, bridge):
    properties, read = owner.rle_splat, bridge("look.transfer").read_transfer
    before = read(owner)
    assert properties.shift_by == pytest.approx(0.0, abs=1e-4)
    properties.shift_by = 20.0
    after = read(owner)
    moved = [value - earlier for (value, _), (earlier, _) in zip(after.opacity, before.opacity)]
    np.testing.assert_allclose(moved, 20.0, atol=1e-3)
    assert properties.shift_by == properties.shift_finely == pytest.approx(20.0, abs=1e-3)
    properties.property_unset("preset_center")  # a file of an earlier version
    assert properties.shift_by == 0.0
    properties.shift_finely = -20.0
    np.testing.assert_allclose([v for v, _ in read(owner).opacity], [v for v, _ in before.opacity], atol=1e-3)


def test_automatic_is_a_checkbox_over_the_number(owner):
    settings, properties = bpy.context.scene.rle_splat, owner.rle_splat
    properties.opacity_unit_distance = 2.5
    assert not properties.use_smallest_spacing
    properties.use_smallest_spacing = True
    assert properties.opacity_unit_distance == 0.0
    assert not settings.use_max_error
    settings.use_max_error = True
    assert settings.max_error > 0.0
    settings.max_error = 0.5
    settings.use_max_error = True  # again: the number stays
    assert settings.max_error == 0.5
    settings.use_max_error = False
    assert settings.max_error == 0.0
    settings.use_all_cores = False
    assert settings.threads > 0


@pytest.fixture
def segments(owner, tmp_path):
    """The rows of a label file whose left third is 3; the volume's own transfer function shows nothing."""
    scenes.give_transfer(owner, ((0.0, 0.0), (255.0, 0.0)), (1.0, 1.0, 1.0))
    labels = np.zeros((N, N, N), np.uint8)
    labels[:, :, :3] = 3
    labels.tofile(tmp_path / "labels.raw")
    owner.rle_splat.label_file = str(tmp_path / "labels.raw")
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    return owner.rle_splat.labels


def test_a_color_shows_a_segment_that_the_transfer_function_does_not(segments):
    assert scenes.picture()[..., 3].max() == 0.0
    segments[1].show = False
    segments[1].shown_color = (0.0, 0.0, 1.0)
    assert segments[1].show and segments[1].use_color and segments[1].look == "SOLID"
    shown = scenes.picture()[16]
    assert shown[4, 3] > 0.99 and shown[4, 2] > 0.05 and shown[4, 0] < 0.01 and shown[24, 3] < 1e-6
    segments[1].opacity = 0.2  # for each ten voxels, of which there are eight
    assert scenes.picture()[16, 4, 3] == pytest.approx(1.0 - 0.8**0.8, abs=0.02)
    segments[1].look = "OWN"
    assert scenes.picture()[..., 3].max() == 0.0


def test_a_segment_is_shown_alone_and_then_all_again(segments, refused):
    assert [row.label for row in segments] == [0, 3]
    segments[1].show = False
    for shown in ([False, True], [True, True], [False, True]):
        assert bpy.ops.rle_splat.show_segment_alone(label=3) == {"FINISHED"}
        assert [row.show for row in segments] == shown
    refused(bpy.ops.rle_splat.show_segment_alone, "no segment 2", label=2)


def test_segments_are_colored_by_their_names(segments):
    segments[1].label_name = "kidney_left"
    assert bpy.ops.rle_splat.color_by_anatomy() == {"FINISHED"}
    assert [row.show for row in segments] == [False, True]
    assert segments[1].look == "SOLID" and segments[1].use_color
    shown = scenes.picture()[16]
    assert shown[4, 3] > 0.99 and shown[4, 0] > 2.0 * shown[4, 1] and shown[24, 3] < 1e-6
    segments[1].label_name = "something else"
    assert bpy.ops.rle_splat.color_by_anatomy() == {"FINISHED"}
    assert tuple(segments[1].color) == tuple(segments[1].shown_color) and segments[1].opacity == 1.0


def test_clip_objects_are_flipped_and_deleted_by_name(owner, refused):
    assert bpy.ops.rle_splat.add_cutting_object(kind="PLANE") == {"FINISHED"}
    clip = bpy.context.object
    assert not clip.rle_splat.clip_flipped
    clip.rle_splat.clip_flipped = True
    assert clip.rle_splat.clip_keep == "OUTSIDE"
    refused(bpy.ops.rle_splat.delete_cutting_object, "no cutting object", name=owner.name)
    assert bpy.ops.rle_splat.delete_cutting_object(name=clip.name) == {"FINISHED"}
    assert [one.name for one in bpy.data.objects if one.rle_splat.is_volume] == [owner.name]
    assert not bpy.context.scene.rle_splat.clip_objects.objects


def test_a_scan_is_edited_after_the_import(owner, bridge, core):
    properties, key = owner.rle_splat, owner.rle_splat.data_key
    properties.window_center = 77.0
    done = bpy.ops.rle_splat.reload_volume(
        spacing=(1.0, 2.0, 0.5), orientation="RAS", flip=(False, False, True), length_unit_given="cm"
    )
    assert done == {"FINISHED"}
    volume = bridge("volumes.volumes").load_volume(owner)
    np.testing.assert_allclose(volume.spacing, (1.0, 2.0, 0.5))
    assert core("volume.orientation").axis_letters(volume.affine) == ("R", "A", "I") and volume.unit == "cm"
    assert "Spacing: 1 × 2 × 0.5 cm" in properties.facts and properties.space == "patient"
    assert properties.data_key == key and properties.window_center == 77.0
    assert properties.length_unit == "cm" and tuple(properties.found_spacing) == (1.0, 2.0, 0.5)
    assert bpy.ops.rle_splat.reload_volume() == {"FINISHED"}  # with the options that it has
    np.testing.assert_allclose(bridge("volumes.volumes").load_volume(owner).spacing, (1.0, 2.0, 0.5))
    properties.use_file_spacing = True
    assert tuple(properties.spacing) == (0.0, 0.0, 0.0)
    properties.use_file_spacing = False
    assert tuple(properties.spacing) == (1.0, 2.0, 0.5)


def test_a_wrong_orientation_is_refused(owner, refused):
    refused(bpy.ops.rle_splat.reload_volume, "three letters", orientation="LLS")


@pytest.fixture
def preferences(bridge):
    found = bridge("data.preferences").current()
    yield found
    for name in ("threads", "memory_limit", "failed_frame", "show_live", "show_imported", "refine_live", "live_pixels"):
        found.property_unset(name)
    found.memory_limit = 0.0


def test_preferences_count_where_a_scene_sets_nothing(owner, bridge, core, preferences):
    quality_of, settings = bridge("data.settings").quality_of, bpy.context.scene.rle_splat
    preferences.threads = 3
    assert quality_of(bpy.context.scene).threads == 3
    settings.threads = 2
    assert quality_of(bpy.context.scene).threads == 2
    preferences.failed_frame = "STOP"
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"} and settings.on_failed_frame == "STOP"
    settings.on_failed_frame = "PLACEHOLDER"
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"} and settings.on_failed_frame == "PLACEHOLDER"
    available = core("runtime.memory").available_bytes
    preferences.memory_limit = 0.25
    assert available() <= 1 << 28
    preferences.use_free_memory = True
    assert available() > 1 << 28
    preferences.show_live = False
    assert not bridge("live").is_allowed()
    habits = bridge("live.surface").preferred_habits
    assert (habits().refines, habits().least_coarseness) == (True, 0)
    preferences.refine_live, preferences.live_pixels = False, "HALF"
    assert (habits().refines, habits().least_coarseness) == (False, 1)


@pytest.mark.parametrize("is_wanted", (True, False))
def test_an_import_opens_or_closes_the_eyes_of_the_windows_viewports(volume_object, preferences, is_wanted):
    """As the end of an import in a window does; a scene that has volumes already keeps its eyes."""
    window = bpy.context.window_manager.windows[0]
    (space,) = (area.spaces.active for area in window.screen.areas if area.type == "VIEW_3D")
    preferences.show_imported = is_wanted
    importer = SimpleNamespace(was_in_window=True)
    show = module("operators.import_volume").ImportsVolumes._show
    context = SimpleNamespace(window=window, scene=bpy.context.scene)
    space.show_object_viewport_volume = not is_wanted
    show(importer, context, 1)
    assert space.show_object_viewport_volume == is_wanted
    space.show_object_viewport_volume = not is_wanted
    show(importer, context, 0)  # the volume was there before
    assert space.show_object_viewport_volume


def test_the_cache_of_kernels_is_measured_and_cleared(bridge, monkeypatch, tmp_path):
    cache, thumbnails = bridge("data.preferences"), bridge("look.thumbnails")
    used, other, shown = (tmp_path / name for name in ("kernels-1", "kernels-2", thumbnails.FOLDER))
    for folder in (used, other, shown):
        folder.mkdir()
        (folder / ("a.npz" if folder == shown else "a.nbc")).write_bytes(b"x" * 100)
    (tmp_path / "other.log").write_bytes(b"y")
    monkeypatch.setattr(cache, "KERNELS", used)
    for place in (cache, thumbnails):
        monkeypatch.setattr(place, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(cache._FolderSize, "at", -cache.FRESH)
    assert cache.kernels_size() == 301
    assert bpy.ops.rle_splat.clear_cache() == {"FINISHED"}
    assert cache.kernels_size() == 1 and used.is_dir() and not other.exists()


def test_every_choice_has_a_tooltip(addon):
    groups = [bpy.types.Object, bpy.types.Scene]
    groups = [base.bl_rna.properties["rle_splat"].fixed_type for base in groups]
    groups += [entry.fixed_type for group in groups for entry in group.properties if entry.type == "COLLECTION"]
    groups += [getattr(bpy.ops.rle_splat, name).get_rna_type() for name in dir(bpy.ops.rle_splat)]
    groups.append(bpy.context.preferences.addons[MODULE].preferences.bl_rna)
    choices = [
        (group.identifier, entry.identifier, item.identifier, item.description) for group in groups
        for entry in group.properties if entry.type == "ENUM" for item in entry.enum_items
    ]  # fmt: skip
    assert len(choices) > 100
    assert [choice for choice in choices if not choice[-1]] == []


def test_progress_never_runs_backwards(bridge, core, monkeypatch):
    jobs, progress = bridge("loop.jobs"), core("runtime.steps").Progress
    monkeypatch.setattr(jobs, "redraw_sidebars", lambda context: None)
    monkeypatch.setattr(jobs.StepwiseOperator, "_progress", None)
    said = []
    context = SimpleNamespace(
        window_manager=SimpleNamespace(progress_update=said.append),
        workspace=SimpleNamespace(status_text_set=lambda text: None),
    )

    job, done = jobs.StepwiseOperator(), []
    monkeypatch.setattr(jobs.time, "perf_counter", lambda: 0.6 * job.time_budget * len(done))  # so a while is two steps
    for fraction in (0.2, 0.7, 0.4, 0.8):
        job._generator = (done.append(fraction) or progress(fraction, "working") for _ in range(1000))
        job._work_a_while(context)
    assert said == [0.2, 0.7, 0.7, 0.8] and len(done) == 8


def test_the_cut_can_be_switched_off_and_a_box_fitted_again(owner, bridge):
    assert bpy.ops.rle_splat.add_cutting_object(kind="BOX") == {"FINISHED"}
    one = bpy.context.view_layer.objects.active
    fitted = np.array(one.matrix_world)
    one.scale, one.location = (0.3, 0.2, 0.1), (1.0, 2.0, 3.0)
    scenes.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    read = bridge("scene.clip_objects").read_clips
    assert len(read(depsgraph, owner)) == 1
    bpy.context.scene.rle_splat.use_clips = False
    assert read(bpy.context.evaluated_depsgraph_get(), owner) == ()
    assert bpy.ops.rle_splat.fit_cutting_object() == {"FINISHED"}
    scenes.update()
    np.testing.assert_allclose(np.array(one.matrix_world), fitted, atol=1e-5)
    assert bpy.ops.rle_splat.fit_cutting_object(fit="VISIBLE") == {"FINISHED"}
    scenes.update()
    assert one.matrix_world.col[0].length < np.linalg.norm(fitted[:, 0])


def test_fitting_needs_a_box(owner, refused):
    refused(bpy.ops.rle_splat.fit_cutting_object, "Add a cut box")


def test_segments_are_cleared(owner, refused):
    refused(bpy.ops.rle_splat.clear_segments, "has no segments")
    properties = owner.rle_splat
    properties.label_file = "labels.nii"
    properties.labels.add().name = "1"
    assert bpy.ops.rle_splat.clear_segments() == {"FINISHED"}
    assert not properties.label_file and not len(properties.labels)


@pytest.mark.parametrize("pixels, longest, length", ((1.0, 160.0, 100.0), (3.0, 160.0, 50.0), (800.0, 160.0, 0.2)))
def test_a_scale_bar_is_a_round_length(bridge, pixels, longest, length):
    assert bridge("live.bars").length_of_bar(pixels, longest) == pytest.approx(length)


def test_a_color_bar_has_the_colors_of_the_window(owner, bridge):
    colors_of = bridge("live.bars").colors_of
    function, (low, high) = bridge("look.transfer").read_transfer(owner), bridge("look.transfer").window_of(
        owner.rle_splat)  # fmt: skip
    found = colors_of(owner)
    for row, value in ((0, low), (16, 0.5 * (low + high)), (32, high)):
        linear = np.clip(function.color_at(value).reshape(3), 0.0, 1.0)
        expected = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        np.testing.assert_allclose(found[row, :3], expected, atol=1e-5)
    owner.rle_splat.display = "mip"
    found = colors_of(owner)[:, :3]  # proportional to the value on the screen, as the pixels of a MIP
    np.testing.assert_allclose(found[[0, len(found) // 2, -1]], [[0.0] * 3, [0.5] * 3, [1.0] * 3], atol=1e-6)


def test_the_tab_is_shown_once(addon, bridge, monkeypatch):
    preferences, calls = bridge("data.preferences"), []
    show_tab = module("operators.show_tab")
    monkeypatch.setattr(show_tab.viewports, "open_tab", calls.append)
    assert not preferences.current().has_shown_tab
    for _ in range(2):
        show_tab.show_once()
    assert len(calls) == 1 and preferences.current().has_shown_tab
    preferences.current().has_shown_tab = False
