"""Panels: drawn into a layout that records, in every state the user can be in.

The module bpy has no window, so this proves that each panel draws without an error, names what this Blender has, and
touches no file; window_panels.py draws them for real.
"""

import builtins
import inspect
import sys
from types import SimpleNamespace

import blf
import bpy
import numpy as np
import pytest
from bpy_extras.io_utils import ExportHelper, ImportHelper

from tests.blender import layout_recorder, scenes
from tests.blender.broken_panels import BROKEN, broken_panel
from tests.blender.panel_states import SENTENCE, STATES
from tests.blender.real_blender import MODULE
from tests.blender.scenes import module

pytestmark = pytest.mark.usefixtures("by_numpy")

SENTENCES = (
    SENTENCE,
    "The voxels of 'THORAX_VENOUS' are not those that were imported, because //CT/THORAX_VENOUS.nii has changed; "
    "import it again, or click Relocate to choose the original file.",
    "Against the exact integral of values that are interpolated, then classified, in 8-bit steps: "
    "largest 3.82, RMSE 0.784 at one pixel in each 4 x 4. White in the image is an error of 1 or more.",
)


def draw_all(monkeypatch) -> list:
    """Draw everything of the add-on that Blender would draw now; opening a file while drawing is an error."""

    def no_files(*_args, **_options):
        raise AssertionError("a panel opened a file")

    with monkeypatch.context() as patch:
        patch.setattr(builtins, "open", no_files)
        return layout_recorder.draw_all(MODULE, bpy.context)


def texts(log) -> str:
    return "\n".join(str(value) for kind, value in log if kind == "label")


def of_addon(*bases):
    """The classes of the add-on that are registered under these of Blender's."""
    found = [cls for base in bases for cls in layout_recorder.subclasses(base)]
    return [cls for cls in found if cls.__module__.startswith(MODULE)]


def test_panels_are_in_the_sidebar_and_in_the_properties(addon):
    places = {(cls.bl_space_type, getattr(cls, "bl_category", ""), getattr(cls, "bl_context", ""))
              for cls in of_addon(bpy.types.Panel)}  # fmt: skip
    assert places == {("VIEW_3D", "RLE Splat", ""), ("PROPERTIES", "", "render"), ("PROPERTIES", "", "data")}


@pytest.mark.parametrize("state", STATES)
def test_every_state_is_drawn(state, monkeypatch, tmp_path):
    """Only icons, properties, operators and arguments that this Blender has, and no exception."""
    STATES[state](tmp_path)
    assert texts(draw_all(monkeypatch))


def test_everything_that_draws_is_drawn(volume_object, monkeypatch, addon):
    """Every panel and menu, every dialog and the preferences, and the lines in File > Import and Add > Volume."""
    volume_object.rle_splat.frame_count = 2  # otherwise it has no panel Time
    volume_object.rle_splat.labels.add()
    drawn = {name for kind, name in draw_all(monkeypatch) if kind == "draws"}
    kinds = (bpy.types.Panel, bpy.types.Menu, bpy.types.Header, bpy.types.Operator, bpy.types.AddonPreferences)
    with_draw = {cls.__name__ for cls in of_addon(*kinds) if inspect.isfunction(getattr(cls, "draw", None))}
    assert {"RLE_SPLAT_PT_transfer", "RLE_SPLAT_MT_presets", "RLE_SPLAT_OT_import_volume"} <= with_draw
    assert drawn == with_draw | {"draw_menu_entry", "draw_add_entry", "_draw_overlay"}


def test_buttons_that_open_a_dialog_and_no_others_end_in_an_ellipsis(volume_object, monkeypatch):
    """Three do so depending on their settings.  Blender's own File > Import has no ellipsis either."""
    asking = {cls.bl_idname for cls in of_addon(bpy.types.Operator) if _asks(cls)}
    depending = {f"rle_splat.{name}" for name in ("import_channel", "reload_volume", "change_segment")}
    assert depending < asking and {"rle_splat.turntable", "rle_splat.extract_surface"} < asking
    volume_object.rle_splat.labels.add()
    volume_object.rle_splat.frame_count, volume_object.rle_splat.playback = 2, "FIXED"
    log = draw_all(monkeypatch)
    log = log[: log.index(("draws", "draw_menu_entry"))] + log[log.index(("draws", "draw_menu_entry")) + 5 :]
    drawn = {
        (name, log[i + 1][1]) for i, (kind, name) in enumerate(log) if kind == "operator" and log[i + 1][0] == "text"
    }
    wrong = [pair for pair in drawn if pair[0] not in depending and (pair[0] in asking) != pair[1].endswith("…")]
    assert not wrong
    unnamed = {name for i, (kind, name) in enumerate(log) if kind == "operator" and log[i + 1][0] != "text"}
    assert not unnamed & asking - depending
    texts_of = {text for name, text in drawn if name in depending}
    assert texts_of == {
        "Add Channel from File…", "Add Other Channels of This File", "Reload", "Edit…",
        "Grow…", "Shrink…", "Smooth…", "Fill Holes", "Keep Largest", "Invert",
    }  # fmt: skip


def _asks(cls) -> bool:
    """Whether an operator may open a dialog or a file browser before it does anything."""
    own = "".join(inspect.getsource(cls.invoke)) if inspect.isfunction(getattr(cls, "invoke", None)) else ""
    return issubclass(cls, (ImportHelper, ExportHelper)) or "invoke_props_dialog" in own or "fileselect_add" in own


@pytest.mark.parametrize("flaw", BROKEN)
def test_a_broken_panel_is_noticed(flaw, addon, monkeypatch):
    """The recorder refuses what a window would refuse or complain of."""
    with broken_panel(flaw):
        with pytest.raises((AssertionError, AttributeError, TypeError, ZeroDivisionError), match=BROKEN[flaw][1]):
            draw_all(monkeypatch)


def test_a_deleted_channel_is_marked(monkeypatch, tmp_path):
    STATES["channels"](tmp_path)
    assert "deleted" not in texts(draw_all(monkeypatch))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    STATES["other_objects_deleted"](tmp_path)
    log = draw_all(monkeypatch)
    assert ("alert", True) in log
    assert "The volume channel was deleted; remove" in texts(log)


@pytest.mark.parametrize(
    ("state", "icon"),
    [("one", "OUTLINER_OB_VOLUME"), ("linked", "LIBRARY_DATA_DIRECT"), ("overridden", "LIBRARY_DATA_OVERRIDE")],
)
def test_a_volume_of_another_file_has_the_icon_of_one(state, icon, monkeypatch, tmp_path):
    STATES[state](tmp_path)
    assert ("icon", icon) in draw_all(monkeypatch)


def test_a_volume_without_transfer_function_names_none(monkeypatch, tmp_path):
    STATES["without_transfer"](tmp_path)
    name = bpy.context.object.rle_splat.transfer_name.casefold()
    assert name and name not in {value.casefold() for kind, value in draw_all(monkeypatch) if kind == "text"}


def test_a_preset_is_named_as_in_its_menu(volume_object, monkeypatch):
    assert bpy.ops.rle_splat.apply_preset(preset="ct-bone") == {"FINISHED"}
    assert ("text", "CT Bone") in draw_all(monkeypatch)


def test_minip_advises_a_cut_while_air_is_shown(monkeypatch, tmp_path):
    owner = scenes.import_raw(tmp_path, scenes.ball())
    path = tmp_path / "segments.raw"
    path.write_bytes((scenes.ball() > 100).astype("uint8").tobytes())
    owner.rle_splat.label_file = str(path)
    bpy.ops.rle_splat.load_segments()
    for display, show, said in (("mip", True, False), ("minip", True, True), ("minip", False, False)):
        owner.rle_splat.display, owner.rle_splat.labels[0].show = display, show
        assert ("Air is the smallest value" in " ".join(texts(draw_all(monkeypatch)).split())) == said


def test_effects_have_titles(volume_object, monkeypatch):
    assert {"Gradient Opacity", "Depth of Field"} <= set(texts(draw_all(monkeypatch)).split("\n"))


@pytest.mark.parametrize("width", [280, 380])
@pytest.mark.parametrize("icon", ["NONE", "ERROR"])
def test_paragraphs_fill_their_panel_and_fit_it(width, icon, addon):
    """Measured in the interface's font, in a region as wide as the sidebar, or as Properties."""
    places = module("panels.places")
    context = SimpleNamespace(
        preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=1.0)), region=SimpleNamespace(width=width)
    )
    room = width - 48 - (20 if icon != "NONE" else 0)  # seen in the window
    blf.size(0, 11.0)
    for sentence in SENTENCES:
        log = []
        places.paragraph(context, layout_recorder.Recorder(log), sentence, icon)
        lines = [blf.dimensions(0, text)[0] for kind, text in log if kind == "label"]
        assert 0.8 * room < max(lines) <= room


def test_plans_are_not_cut_off(volume_object):
    """In the sidebar as wide as it is at first, where a list is 235 pixels wide."""
    share = module("panels.accuracy").NAME_SHARE
    blf.size(0, 11.0)
    assert blf.dimensions(0, "midpoint-2 2.0")[0] <= share * 235 - 28  # beside the icon
    assert blf.dimensions(0, "RMSE")[0] <= (1.0 - share) * 235 / 3 - 8


@pytest.fixture
def import_dialog(phantom):
    """The properties that the import dialog shows; cleared afterwards."""
    properties = layout_recorder.operator_properties("rle_splat.import_volume")
    yield properties
    for name in properties.bl_rna.properties.keys():
        properties.property_unset(name)


def test_the_import_dialog_is_drawn_for_each_kind_of_file(import_dialog, monkeypatch, phantom):
    """A raw file with what was guessed of it, several files, a VDB with its grid, and others with what they hold."""
    import_dialog.filepath, import_dialog.guess_text = str(phantom[0]), "The name gives no shape.\nIts size does."
    import_dialog.shape, import_dialog.dtype = (7, 6, 5), "uint8"
    log = draw_all(monkeypatch)
    assert "In memory: 210 bytes" in texts(log) and "Its size does." in texts(log) and ("prop", "header_bytes") in log

    import_dialog.directory = str(phantom[0].parent)
    for name in ("a.nii", "b.nii"):
        import_dialog.files.add().name = name
    log = draw_all(monkeypatch)
    assert "2 files" in texts(log) and ("prop", "header_bytes") not in log

    import_dialog.files.clear()
    import_dialog.filepath = "smoke.vdb"
    log = draw_all(monkeypatch)
    assert ("prop", "grid") in log and ("prop", "header_bytes") not in log

    for name, number in (("a.nii", "first_frame"), ("a.dcm", "only_series"), ("a.zarr", "fitting_level")):
        import_dialog.filepath = name
        assert ("prop", f"use_{number}") in draw_all(monkeypatch)


def test_empty_scene_offers_the_import(monkeypatch):
    log = draw_all(monkeypatch)
    assert ("operator", "rle_splat.import_volume") in log
    assert ("template_color_ramp", "color_ramp") not in log


def test_volume_shows_facts_curve_ramp_and_buttons(volume_object, monkeypatch, bridge):
    bridge("volumes.volumes").forget_all()  # as after a reload: nothing in memory
    log = draw_all(monkeypatch)
    assert "7 × 6 × 5, uint8" in texts(log)
    for wanted in (
        ("template_curve_mapping", "mapping"), ("template_color_ramp", "color_ramp"), ("prop", "window_center"),
        ("prop", "window_width"), ("prop_enum", "quality"), ("prop", "display"), ("prop", "shift_by"),
        ("operator", "rle_splat.render_image"),
        ("operator", "rle_splat.preview_in_camera_view"), ("operator", "rle_splat.show_in_renders"),
        ("operator", "rle_splat.relocate_volume"), ("menu", "RLE_SPLAT_MT_presets"),
    ):  # fmt: skip
        assert wanted in log, wanted


def test_custom_quality_shows_every_knob(volume_object, monkeypatch):
    settings = bpy.context.scene.rle_splat
    assert ("prop", "depth_rule") not in draw_all(monkeypatch)
    settings.quality, settings.classification = "custom", "pre"
    log = draw_all(monkeypatch)
    for name in ("classification", "depth_rule", "sheet_density", "kernel", "minification", "warp_filter",
                 "termination", "axis_fade", "model"):  # fmt: skip
        assert ("prop", name) in log


def test_a_knob_and_the_classification_that_has_it_are_chosen_together(volume_object, monkeypatch, bridge):
    """Post is the default; knobs that it has one value of are not shown, and setting another value chooses pre."""
    scene, of_pre = bpy.context.scene, bridge("data.settings").OF_PRE
    settings, quality_of = scene.rle_splat, bridge("data.settings").quality_of
    assert quality_of(scene) == quality_of(scene).preset("standard") and quality_of(scene).classification == "post"
    others = {"record": "8", "kernel": "bspline3", "minification": "widen", "model": "opacity"}
    assert set(others) == set(of_pre)
    settings.quality = "custom"
    others_shown = {"depth_rule", "sheet_density", "warp_filter", "termination", "rays", "axis_fade"}

    def shown():
        return {what for kind, what in draw_all(monkeypatch) if kind == "prop"} & {*of_pre, *others_shown}

    assert shown() == others_shown
    for name, value in others.items():
        setattr(settings, name, value)
        assert settings.classification == "pre" and str(getattr(quality_of(scene), name)) == value
        assert shown() == {*of_pre, *others_shown} - {"rays"}
        settings.classification = "post"  # which takes it back
        assert quality_of(scene).classification == "post" and getattr(settings, name) != value
    settings.quality, settings.kernel = "fine", "bspline3"  # of no account to a quality
    assert quality_of(scene) == quality_of(scene).preset("fine")
    settings.quality = "custom"
    assert settings.classification == "pre"
    settings.depth_rule = "preintegrated"
    assert settings.classification == "post" and quality_of(scene).depth_rule == "preintegrated"
    settings.classification = "pre"
    assert quality_of(scene).depth_rule == "simpson"
    settings.quality = "paper"
    assert ("prop", "classification") not in draw_all(monkeypatch) and quality_of(scene).classification == "pre"


def test_messages_and_reports_are_shown(volume_object, monkeypatch):
    settings = bpy.context.scene.rle_splat
    settings.message = "The volume was deleted."
    settings.last_report = "Kept voxels: 17\nVoxels to layers: 12 ms"
    shown = texts(draw_all(monkeypatch))
    assert "The volume was deleted." in shown and "Voxels to layers\n12 ms" in shown and "Kept voxels: 17" in shown


def test_missing_numba_is_said_loudly(volume_object, monkeypatch, addon):
    monkeypatch.setattr(sys.modules[f"{addon.__name__}.panels.volume"], "NUMBA_PROBLEM", "ImportError: no numba here")
    shown = " ".join(texts(draw_all(monkeypatch)).split())  # its lines are broken to fit
    assert "No compiled code" in shown and "ImportError: no numba here" in shown


def test_histogram_picture_is_drawn_once_for_each_change(volume_object, bridge, monkeypatch):
    previews = bridge("look.previews")
    heights = []
    draw = previews.histogram_picture.draw
    monkeypatch.setattr(previews.histogram_picture, "draw", lambda *args: heights.append(args[-1]) or draw(*args))
    previews.histogram_icon(volume_object, 0.5)
    previews.histogram_icon(volume_object, 0.5)
    assert heights == [160]
    volume_object.rle_splat.window_center += 10.0
    previews.histogram_icon(volume_object, 0.5)
    previews.histogram_icon(volume_object, 2.0)  # a panel that is narrower than the curve is high
    assert heights == [160, 160, 320]


def test_histogram_picture_shows_where_the_values_are(bridge, core):
    """Blender's icons are squares; what is below the histogram covers nothing of the panel."""
    picture, height = bridge("look.histogram_picture"), 100
    stored = bridge("volumes.facts").StoredHistogram(np.array([0, 0, 1000, 0]), 0.0, 4.0)
    function = core("classify.transfer_function").TransferFunction(
        opacity=((0.0, 0.0), (2.4, 0.0), (2.6, 1.0), (4.0, 1.0)), color=((0.0, 1.0, 0.0, 0.0), (4.0, 0.0, 0.0, 1.0))
    )
    drawn = picture.draw(stored, function, 0.0, 4.0, height)
    at = picture.EDGE + (np.arange(picture.WIDTH) + 0.5) / picture.WIDTH * (1.0 - 2.0 * picture.EDGE)
    clear = np.abs(at - np.array(((0.5,), (0.75,)))).min(axis=0) > 1.0 / picture.WIDTH  # of the bin's two ends
    filled = drawn[..., 3] > 0.0  # rows go up
    np.testing.assert_array_equal(filled[-height // 2][clear], ((at > 0.5) & (at < 0.75))[clear])
    assert not filled[:-height].any() and not filled[-1].any() and drawn[..., 3].max() < 0.5
    bar, gray, colored = drawn[-height // 2, :, :3] / picture.ALPHA, (at > 0.5) & (at < 0.59), (at > 0.66) & (at < 0.75)
    np.testing.assert_allclose(bar[gray] - picture.BAR, 0.0, atol=1e-6)  # nothing is shown of these values
    linear = function.table(4.0 * at[colored])[:, :3:2]  # no green
    np.testing.assert_allclose(bar[colored][:, ::2], 1.055 * linear ** (1.0 / 2.4) - 0.055, atol=1e-3)


def test_the_values_of_the_curves_range_and_of_its_selected_point_are_told(volume_object, monkeypatch):
    properties = volume_object.rle_splat
    properties.window_center, properties.window_width, properties.value_unit = 500.0, 3000.0, "HU"
    points = properties.transfer.nodes["Opacity"].mapping.curves[0].points
    for point in points:
        point.select = False
    shown = texts(draw_all(monkeypatch))
    assert {"-1000", "500", "2000"} <= set(shown.splitlines())
    assert "Selected" not in shown
    points[0].location, points[0].select = (0.25, 0.3), True
    properties.opacity_scale = 0.5
    assert "Selected: -250 HU, opacity 0.15" in texts(draw_all(monkeypatch))
    points[1].select = True
    assert "Selected" not in texts(draw_all(monkeypatch))  # of several points at once


def test_every_window_in_the_menu_has_a_tooltip_of_its_own(volume_object, bridge):
    kind = next(cls for cls in of_addon(bpy.types.Operator) if cls.bl_idname == "rle_splat.window_level")
    presets = bpy.ops.rle_splat.window_level.get_rna_type().properties["preset"].enum_items
    asked = [SimpleNamespace(preset=item.identifier, keep_values=False) for item in presets]
    told = [kind.description(bpy.context, one) for one in (*asked, SimpleNamespace(preset="DATA", keep_values=True))]
    assert len(set(told)) == len(told) == len(presets) + 1 and not any(text.endswith(".") for text in told)


@pytest.mark.parametrize(
    ("unit", "mode", "grays", "of_slices", "offered"),
    [
        ("HU", "composite", True, False, 0), ("HU", "composite", False, True, 7), ("HU", "mip", True, False, 7),
        ("HU", "mip", False, False, 0), ("HU", "xray", True, False, 0), ("SUVbw", "composite", False, False, 4),
        ("SUVbw", "mip", True, True, 4), ("", "mip", True, True, 0),
    ],
)  # fmt: skip
def test_windows_are_those_of_the_unit_and_windows_of_tissues_are_for_grays(
    volume_object, monkeypatch, unit, mode, grays, of_slices, offered
):
    properties = volume_object.rle_splat
    properties.value_unit, properties.mode, properties.use_grays = unit, mode, grays
    properties.slices_follow_window = False
    windows = scenes.module("operators.window_level")
    names = windows.windows_of(properties, of_slices)
    assert len(names) == offered and all(windows.WINDOWS[name][3] == unit for name in names)
    draw_all(monkeypatch)
    for name in names:
        assert bpy.ops.rle_splat.window_level(preset=name, of_slices=of_slices) == {"FINISHED"}
        held = "slice" if of_slices else "window"
        found = getattr(properties, f"{held}_center"), getattr(properties, f"{held}_width")
        assert found == windows.WINDOWS[name][1:3]


def test_grayed_buttons_say_why(volume_object):
    """Without a camera the pictures are refused with a sentence that names what is missing."""
    for name in ("render_image", "preview_in_camera_view", "show_in_renders"):
        with pytest.raises(RuntimeError, match="camera"):
            getattr(bpy.ops.rle_splat, name)()


def test_a_damaged_histogram_is_said_and_a_damaged_record_is_as_none(volume_object, bridge, monkeypatch):
    problem = "The histogram saved in this file is damaged"
    assert problem not in texts(draw_all(monkeypatch))
    for damaged in ("{", "[1]", '{"edges": [0, 1]}', '{"edges": 3, "counts": []}'):
        volume_object.rle_splat.histogram = damaged
        assert problem in " ".join(texts(draw_all(monkeypatch)).split())
    image = bpy.data.images.new("picture", 2, 2)
    freshness = bridge("pictures.outdated")
    for damaged in ("{", "[1, 2, 3, 4]", "7"):
        image[freshness.MADE_FROM] = damaged
        assert freshness.made_from(image) is None
