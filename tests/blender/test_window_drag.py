"""Window and level by dragging: what pixels change, and the operator without a window."""

from types import SimpleNamespace

import bpy
import pytest

from tests.blender import scenes
from tests.blender.layout_recorder import Recorder
from tests.blender.scenes import module


@pytest.fixture
def drag_of(bridge):
    return bridge("look.window_drag").WindowDrag


def test_right_widens_the_window_and_up_raises_the_level(drag_of):
    drag = drag_of(50.0, 400.0, -1024.0, 3071.0)
    assert drag.move(100, 0) == (50.0, 500.0)
    assert drag.move(0, -30) == (20.0, 500.0)
    assert drag.move(-100, 30) == (50.0, 400.0)


@pytest.mark.parametrize("scale", (1.0, 2.0))
def test_the_speed_follows_the_window_within_bounds_of_the_volumes_values(drag_of, scale):
    rates = [drag_of(0.0, width, 0.0, 4096.0, scale).rate * scale for width in (80.0, 400.0, 4000.0, 1e6)]
    assert rates == pytest.approx([0.2, 1.0, 10.0, 8192.0 / 400.0])
    assert drag_of(0.0, 1e-3, 0.0, 4096.0).rate == pytest.approx(64.0 / 400.0)
    assert drag_of(0.5, 1.0, 7.0, 7.0).rate == pytest.approx(1.0 / 400.0)  # a volume of one value


def test_shift_is_ten_times_finer_and_does_not_jump(drag_of):
    drag = drag_of(0.0, 400.0, 0.0, 4096.0)
    drag.move(40, 0)
    assert drag.move(40, 0, is_fine=True)[1] == pytest.approx(444.0)
    assert drag.move(1, 0)[1] == pytest.approx(445.0)
    assert drag.move(1, 0, is_fine=True)[1] == pytest.approx(445.1)


def test_the_window_stays_above_zero_and_comes_back_at_once(drag_of):
    drag = drag_of(0.0, 400.0, 0.0, 4096.0)
    assert drag.move(-5000, 0)[1] == pytest.approx(1.0)
    assert drag.move(10, 0)[1] == pytest.approx(11.0)
    narrow = drag_of(0.0, 0.01, 0.0, 4096.0)
    assert narrow.move(-50, 0)[1] == 0.01 and narrow.move(0, 3)[1] == 0.01


def test_values_move_by_round_numbers(drag_of):
    drag = drag_of(0.0, 1600.0, -1024.0, 3071.0)
    for _ in range(7):
        center, width = drag.move(3, 1)
        assert center == round(center) and width == round(width)
    drag = drag_of(0.5, 1.0, 0.0, 1.0)
    assert drag.move(0, 1)[0] == pytest.approx(0.502) and drag.move(1, 0)[1] == pytest.approx(1.002)


def test_without_a_window_the_operator_sets_level_and_window(volume_object):
    properties = volume_object.rle_splat
    for how in ((), ("INVOKE_DEFAULT",)):
        properties.window_center, properties.window_width = 1.0, 2.0
        assert bpy.ops.rle_splat.drag_window(*how, center=90.0, width=40.0) == {"FINISHED"}
        assert (properties.window_center, properties.window_width) == (90.0, 40.0)


def test_over_slices_the_operator_sets_theirs(volume_object):
    properties = volume_object.rle_splat
    properties.slices_follow_window = False
    before = properties.window_center, properties.window_width
    assert bpy.ops.rle_splat.drag_window(center=90.0, width=40.0, of_slices=True) == {"FINISHED"}
    assert (properties.slice_center, properties.slice_width) == (90.0, 40.0)
    assert (properties.window_center, properties.window_width) == before


def test_the_tools_header_shows_level_and_window_of_what_is_under_the_mouse(volume_object, bridge):
    """Those of a slice whose window is its own, and else the volume's."""
    assert bpy.ops.rle_splat.add_slice(kind="AXIAL") == {"FINISHED"}
    one, probe = bpy.context.object, bridge("look.probe")
    scenes.activate(volume_object)
    area = SimpleNamespace(as_pointer=lambda: 1, regions=[])
    context = SimpleNamespace(
        area=area, scene=bpy.context.scene, view_layer=bpy.context.view_layer, object=volume_object
    )

    def shown(under):
        log: list = []
        probe.hover(context, "12, voxel 1 2 3", under)
        module("panels.window_tool").RLE_SPLAT_WT_window.draw_settings(context, Recorder(log), None)
        assert ("label", "12, voxel 1 2 3") in log
        return [name for kind, name in log if kind == "prop"], [text for kind, text in log if kind == "text"][:2]

    try:
        of_volume = ["window_center", "window_width"], ["Level", "Window"]
        assert shown(None) == of_volume
        assert shown(one) == (["slice_center", "slice_width"], ["Slice Level", "Slice Window"])
        volume_object.rle_splat.slices_follow_window = True
        assert shown(one) == of_volume
    finally:
        probe.forget()


def test_slices_that_follow_the_volume_show_its_window_grayed(volume_object):
    properties, draw = volume_object.rle_splat, module("panels.slices").draw_window
    for is_linked, names in ((False, ["slice_center", "slice_width"]), (True, ["window_center", "window_width"])):
        properties.slices_follow_window = is_linked
        log: list = []
        draw(bpy.context, Recorder(log), properties)
        assert [name for kind, name in log if kind == "prop"][:2] == names
        assert [text for kind, text in log if kind == "text"][:2] == ["Slice Level", "Slice Window"]
        assert ("enabled", not is_linked) in log


def test_it_says_what_is_missing(addon, refused):
    refused(bpy.ops.rle_splat.drag_window, "Import a volume first", center=1.0, width=2.0)


def test_a_volume_without_a_transfer_function_is_refused(volume_object, refused):
    volume_object.rle_splat.transfer = None
    refused(bpy.ops.rle_splat.drag_window, "has no transfer function", center=1.0, width=2.0)
    assert volume_object.rle_splat.window_center != 1.0


def test_the_tool_is_in_the_toolbar_of_object_mode_once(addon):
    from bl_ui.space_toolsystem_common import ToolSelectPanelHelper
    from bl_ui.space_toolsystem_toolbar import VIEW3D_PT_tools_active

    def tools():
        listed = ToolSelectPanelHelper._tools_flatten(VIEW3D_PT_tools_active.tools_from_context(bpy.context, "OBJECT"))
        return [tool.idname for tool in listed if tool is not None and "rle_splat" in tool.idname]

    assert tools() == ["rle_splat.window_tool"]
    addon.unregister()
    assert tools() == []
    addon.register()
    assert tools() == ["rle_splat.window_tool"]
