"""Panels: drawn into a layout that only records, in every state the user can be in.

The module bpy has no window, so this proves that each panel draws without an error and touches no file; how it looks
is seen in a real Blender.
"""

import builtins
import sys
from itertools import pairwise

import bpy
import numpy as np
import pytest


class Recorder:
    """A layout that remembers texts, operators and properties; properties that do not exist are errors."""

    def __init__(self, log):
        self.__dict__["log"] = log

    def __setattr__(self, name, value):
        self.log.append((name, value))

    def _child(self, *_args, **_options):
        return Recorder(self.log)

    row = column = box = split = _child

    def separator(self, **_options):
        pass

    def label(self, text="", icon="NONE", **_options):
        self.log.append(("label", text))

    def prop(self, data, name, **_options):
        assert name in data.bl_rna.properties, name
        self.log.append(("prop", name))

    def operator(self, name, text="", icon="NONE", **_options):
        group, action = name.split(".")
        kind = getattr(getattr(bpy.ops, group), action).get_rna_type()
        self.log.append(("operator", name))
        return OperatorProperties({entry.identifier for entry in kind.properties})

    def menu(self, name, **_options):
        assert hasattr(bpy.types, name), name
        self.log.append(("menu", name))

    def template_icon(self, icon_value, scale=1.0):
        self.log.append(("icon", icon_value))

    def template_curve_mapping(self, data, name, **_options):
        assert len(getattr(data, name).curves) == 1
        self.log.append(("curve", name))

    def template_color_ramp(self, data, name, **_options):
        assert len(getattr(data, name).elements) > 0
        self.log.append(("ramp", name))


class OperatorProperties:
    def __init__(self, names):
        object.__setattr__(self, "names", names)

    def __setattr__(self, name, _value):
        assert name in self.names, name


class Drawing:
    """What stands in for ``self`` of a panel while it draws."""

    def __init__(self, log):
        self.layout = Recorder(log)


def panels(kind=bpy.types.Panel):
    return [cls for cls in kind.__subclasses__() if "rle_splat" in cls.__module__ and cls.is_registered]


def draw_all(monkeypatch) -> list:
    """Draw every panel and menu that shows itself; opening a file while drawing is an error."""

    def no_files(*_args, **_options):
        raise AssertionError("a panel opened a file")

    log = []
    with monkeypatch.context() as patch:
        patch.setattr(builtins, "open", no_files)
        for cls in panels() + panels(bpy.types.Menu):
            if hasattr(cls, "poll") and not cls.poll(bpy.context):
                continue
            for draw in ("draw_header", "draw"):
                if draw in dir(cls) and callable(getattr(cls, draw, None)):
                    function = next((vars(c)[draw] for c in cls.__mro__ if draw in vars(c)), None)
                    if function is not None and hasattr(function, "__code__"):
                        function(Drawing(log), bpy.context)
    return log


def texts(log) -> str:
    return "\n".join(str(value) for kind, value in log if kind == "label")


def test_panels_are_in_the_sidebar_and_in_the_render_tab(addon):
    places = {(cls.bl_space_type, getattr(cls, "bl_category", ""), getattr(cls, "bl_context", "")) for cls in panels()}
    assert places == {("VIEW_3D", "RLE Splat", ""), ("PROPERTIES", "", "render")}


def test_empty_scene_offers_the_import(addon, monkeypatch):
    log = draw_all(monkeypatch)
    assert ("operator", "rle_splat.import_volume") in log
    assert ("ramp", "color_ramp") not in log


def test_volume_shows_facts_curve_ramp_and_buttons(volume_object, monkeypatch, bridge):
    bridge("volumes").forget_all()  # as after a reload: nothing in memory
    log = draw_all(monkeypatch)
    assert "7 × 6 × 5, uint8" in texts(log)
    for wanted in (
        ("curve", "mapping"), ("ramp", "color_ramp"), ("prop", "window_center"), ("prop", "window_width"),
        ("prop", "quality"), ("operator", "rle_splat.render_image"), ("operator", "rle_splat.set_backdrop"),
        ("operator", "rle_splat.composite"), ("operator", "rle_splat.relocate"), ("menu", "RLE_SPLAT_MT_presets"),
    ):
        assert wanted in log, wanted


def test_custom_quality_shows_every_knob(volume_object, monkeypatch, bridge):
    settings = bpy.context.scene.rle_splat
    assert ("prop", "depth_rule") not in draw_all(monkeypatch)
    settings.quality = "custom"
    log = draw_all(monkeypatch)
    for name in ("classification", "depth_rule", "sheet_density", "kernel", "minification", "warp_filter",
                 "termination", "axis_fade", "model"):
        assert ("prop", name) in log
    assert ("prop", "refinement") not in log  # only where there is a finer grid
    settings.classification, settings.refinement = "refined", "3"
    assert ("prop", "refinement") in draw_all(monkeypatch)
    quality = bridge("settings").quality_of(bpy.context.scene)
    assert (quality.classification, quality.refinement) == ("refined", 3)


def test_a_knob_and_the_classification_that_has_it_are_chosen_together(volume_object, monkeypatch, bridge):
    """Post is the default; knobs that it has one value of are greyed out, and choosing another value chooses pre."""
    scene, of_pre = bpy.context.scene, bridge("settings").OF_PRE
    settings, quality_of = scene.rle_splat, bridge("settings").quality_of
    assert quality_of(scene) == quality_of(scene).preset("standard") and quality_of(scene).classification == "post"
    others = {"record": "8", "kernel": "bspline3", "minification": "widen", "model": "opacity"}
    assert set(others) == set(of_pre)
    settings.quality = "custom"
    log = draw_all(monkeypatch)
    greyed = {what[1] for before, what in pairwise(log) if before == ("active", False)}
    assert greyed & {*of_pre, "depth_rule", "sheet_density", "warp_filter", "termination"} == set(of_pre)
    for name, value in others.items():
        setattr(settings, name, value)
        assert settings.classification == "pre" and str(getattr(quality_of(scene), name)) == value
        assert (("active", False), ("prop", name)) not in pairwise(draw_all(monkeypatch))
        settings.classification = "post"  # which takes it back
        assert quality_of(scene).classification == "post" and getattr(settings, name) != value
    settings.quality, settings.kernel = "fine", "bspline3"  # of no account to a quality
    assert quality_of(scene) == quality_of(scene).preset("fine")
    settings.quality = "custom"
    assert settings.classification == "pre"
    settings.depth_rule = "preintegrated"
    assert settings.classification == "post" and quality_of(scene).depth_rule == "preintegrated"
    settings.classification = "refined"
    assert quality_of(scene).depth_rule == "simpson"
    settings.quality = "paper"
    assert ("prop", "classification") not in draw_all(monkeypatch) and quality_of(scene).classification == "pre"


def test_messages_and_reports_are_shown(volume_object, monkeypatch):
    settings = bpy.context.scene.rle_splat
    settings.message = "The volume was deleted."
    settings.last_report = "Splat: 12 ms\nKept voxels: 17"
    shown = texts(draw_all(monkeypatch))
    assert "The volume was deleted." in shown and "Splat: 12 ms" in shown and "Kept voxels: 17" in shown


def test_missing_numba_is_said_loudly(volume_object, monkeypatch, addon):
    monkeypatch.setattr(sys.modules[f"{addon.__name__}.panels.quality"], "NUMBA_PROBLEM", "ImportError: no numba")
    shown = texts(draw_all(monkeypatch))
    assert "SLOW FALLBACK" in shown and "no numba" in shown


def test_histogram_picture_is_drawn_once_for_each_change(volume_object, bridge, monkeypatch):
    previews = bridge("previews")
    calls = []
    draw = previews.histogram_picture.draw
    monkeypatch.setattr(previews.histogram_picture, "draw", lambda *args: calls.append(1) or draw(*args))
    previews.histogram_icons(volume_object)
    previews.histogram_icons(volume_object)
    assert len(calls) == 1
    volume_object.rle_splat.window_center += 10.0
    previews.histogram_icons(volume_object)
    assert len(calls) == 2


def test_histogram_picture_shows_where_the_values_are(bridge, core):
    picture = bridge("histogram_picture")
    stored = bridge("facts").StoredHistogram(np.array([0, 0, 1000, 0]), 0.0, 4.0)
    function = core("classify.transfer_function").TransferFunction(
        opacity=((0.0, 0.0), (4.0, 0.0)), color=((0.0, 1.0, 0.0, 0.0), (4.0, 0.0, 0.0, 1.0)))
    drawn = picture.draw(stored, function, 0.0, 4.0)
    middle = drawn[picture.HEIGHT // 2, :, :3]
    filled = np.abs(middle - picture.GROUND).max(axis=1) > 1e-3
    quarter = picture.WIDTH // 4  # a bin each
    np.testing.assert_array_equal(filled, np.repeat((False, False, True, False), quarter))
    np.testing.assert_allclose(drawn[0, 0, :3], (1.0, 0.0, 0.0), atol=0.05)
    np.testing.assert_allclose(drawn[0, -1, :3], (0.0, 0.0, 1.0), atol=0.05)


def test_greyed_buttons_say_why(volume_object):
    """Without a camera the pictures are refused with a sentence that names what is missing."""
    for name in ("render_image", "set_backdrop", "composite"):
        with pytest.raises(RuntimeError, match="camera"):
            getattr(bpy.ops.rle_splat, name)()
