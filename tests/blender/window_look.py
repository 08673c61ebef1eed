"""The look edited where the picture is, in a real window: window and level dragged by the mouse in the viewport, the
value under the mouse, and the histogram above the curve.  dev.py test runs it."""

import tempfile
from importlib import import_module
from math import radians
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Euler, Vector

from tests.blender.real_blender import MODULE
from tests.blender.scenes import import_raw
from tests.blender.window_driver import (
    area_of,
    drive,
    in_the_view,
    new_file,
    open_panels,
    passed,
    photograph,
    region_of,
    until,
    window,
)

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_look_"))
SIDE, SPACING = 33, 2.0
MIDDLE = np.array((SIDE - 1.0,) * 3) * SPACING / 2.0
RADIUS = 12.0  # voxels
TOOL = "rle_splat.window_tool"


def live():
    return import_module(f"{MODULE}.bridge.live")


def settled():
    area_of("VIEW_3D").tag_redraw()
    yield
    yield
    found = live().viewports_of
    yield from until(lambda: found(area_of("VIEW_3D")) and not found(area_of("VIEW_3D"))[0].is_busy, 120.0)
    yield


def ball():
    """Values that fall from 1000 in the middle to 0 outward, through 400 at RADIUS."""
    z, y, x = np.mgrid[:SIDE, :SIDE, :SIDE] - (SIDE - 1) / 2
    apart = np.sqrt(x**2 + y**2 + z**2)
    return np.clip(1000.0 - 50.0 * apart, 0.0, None).astype(np.int16)


def set_up():
    yield from new_file()
    scene = bpy.context.scene
    scene.view_settings.view_transform = "Standard"
    scene.rle_splat.backend = "numpy"
    with in_the_view():
        volume = import_raw(FOLDER, ball(), (SPACING,) * 3, "ball")
    volume.rle_splat.value_unit = "HU"
    functions = import_module(f"{MODULE}.rle_splat.classify.transfer_function")
    import_module(f"{MODULE}.bridge.transfer").write_transfer(volume, functions.TransferFunction(
        name="ball", unit="HU", opacity=((0.0, 0.0), (395.0, 0.0), (405.0, 0.9), (1000.0, 0.9)),
        color=((0.0, 0.1, 0.0, 0.0), (500.0, 0.9, 0.4, 0.2), (1000.0, 1.0, 0.95, 0.8)), opacity_unit_distance=1.0))
    view = area_of("VIEW_3D").spaces.active.region_3d
    view.view_location, view.view_distance = MIDDLE, 150.0
    view.view_rotation = Euler((radians(75.0), 0.0, radians(20.0))).to_quaternion()
    view.update()
    with in_the_view():
        bpy.ops.ed.undo_push(message="ready")
    yield from settled()
    return volume


def simulate(kind, value="NOTHING", at=None, **more):
    window().event_simulate(type=kind, value=value, x=int(at[0]), y=int(at[1]), **more)


def on_screen(point):
    """The window's pixel where the view shows a point of the world."""
    region = region_of(area_of("VIEW_3D"), "WINDOW")
    place = location_3d_to_region_2d(region, area_of("VIEW_3D").spaces.active.region_3d, Vector(point))
    return region.x + int(place.x), region.y + int(place.y)


def drag(begin, steps, end="LEFTMOUSE", **more):
    """Press, move by steps, and release (or press another key)."""
    simulate("MOUSEMOVE", at=begin)
    yield
    simulate("LEFTMOUSE", "PRESS", at=begin)
    yield
    at = begin
    for right, up in steps:
        at = at[0] + right, at[1] + up
        simulate("MOUSEMOVE", at=at, **more)
        yield
    yield at
    if end == "LEFTMOUSE":
        simulate("LEFTMOUSE", "RELEASE", at=at)
    else:
        simulate(end, "PRESS", at=at)
        simulate(end, "RELEASE", at=at)
        simulate("LEFTMOUSE", "RELEASE", at=at)
    yield
    yield


def window_now(volume):
    return volume.rle_splat.window_center, volume.rle_splat.window_width


def choose_tool():
    with in_the_view():
        assert bpy.ops.wm.tool_set_by_id(name=TOOL) == {"FINISHED"}
    yield


def check_drag(volume):
    """A drag to the right and up widens the window and raises the level; the live picture follows; one undo step."""
    name, before = volume.name, window_now(volume)
    middle = on_screen(MIDDLE)
    drafts = live().viewports_of(area_of("VIEW_3D"))[0].counts.copy()
    steps = drag(middle, [(20, 10)] * 4)
    for at in steps:
        if at is not None:
            yield from photograph("dragging")
            during = window_now(bpy.data.objects[name])
            assert during[0] > before[0] and during[1] > before[1], (before, during)
        else:
            yield
    after = window_now(bpy.data.objects[name])
    print(f"dragged by 80, 40 pixels: level and window {before} -> {after}", flush=True)
    assert after == during
    counted = live().viewports_of(area_of("VIEW_3D"))[0].counts
    assert counted["drafts"] + counted["refinements"] > drafts["drafts"] + drafts["refinements"], "nothing was drawn"
    yield from settled()
    yield from photograph("dragged")
    with in_the_view():
        bpy.ops.ed.undo()
    yield
    assert window_now(bpy.data.objects[name]) == before, "one undo does not restore what was before the drag"
    with in_the_view():
        bpy.ops.ed.redo()
    yield
    assert window_now(bpy.data.objects[name]) == after
    with in_the_view():
        bpy.ops.ed.undo()
    yield


def check_fine(volume_name):
    """With Shift the same way changes a tenth."""
    results = []
    for more in ({}, {"shift": True}):
        before = window_now(bpy.data.objects[volume_name])
        yield from (None for _ in drag(on_screen(MIDDLE), [(20, 0)] * 2, **more))
        results.append(window_now(bpy.data.objects[volume_name])[1] - before[1])
        with in_the_view():
            bpy.ops.ed.undo()
        yield
    print(f"40 pixels: {results[0]:g}, with Shift {results[1]:g}", flush=True)
    np.testing.assert_allclose(results[1], 0.1 * results[0], rtol=0.15)


def check_cancel(volume_name):
    """Esc and the right mouse button restore; a click alone changes nothing."""
    before = window_now(bpy.data.objects[volume_name])
    for key in ("ESC", "RIGHTMOUSE"):
        changed = []
        for at in drag(on_screen(MIDDLE), [(30, 30)] * 2, end=key):
            if at is not None:
                changed.append(window_now(bpy.data.objects[volume_name]) != before)
            yield
        assert changed == [True] and window_now(bpy.data.objects[volume_name]) == before, key
    yield from (None for _ in drag(on_screen(MIDDLE), []))
    assert window_now(bpy.data.objects[volume_name]) == before
    yield


def check_value_under_the_mouse():
    """Over the ball the tool tells its value at the surface; beside it that nothing is there."""
    probe = import_module(f"{MODULE}.bridge.probe")
    area = area_of("VIEW_3D")
    simulate("MOUSEMOVE", at=on_screen(MIDDLE))
    yield
    simulate("MOUSEMOVE", at=np.add(on_screen(MIDDLE), 1))
    yield
    line = probe.hovered(area)
    print(f"over the ball: {line}", flush=True)
    value = float(line.split(" HU")[0])
    assert 395.0 < value < 420.0 and "voxel" in line and " mm" in line
    voxel = np.array([int(n) for n in line.split("voxel ")[1].split(",")[0].split()])
    assert abs(np.linalg.norm(voxel - (SIDE - 1) / 2) - RADIUS) < 1.5
    yield from photograph("probe")
    region = region_of(area, "WINDOW")
    simulate("MOUSEMOVE", at=(region.x + 80, region.y + region.height // 5))
    yield
    simulate("MOUSEMOVE", at=(region.x + 82, region.y + region.height // 5))
    yield
    assert probe.hovered(area) == probe.NOTHING
    yield from photograph("probe_nothing")


def check_histogram(volume):
    """The histogram at the default width, at a narrow and a wide sidebar, and with a point of the curve selected."""
    curve = volume.rle_splat.transfer.nodes["Opacity"].mapping.curves[0]
    for point in curve.points:
        point.select = False
    yield from photograph("histogram")
    curve.points[2].select = True
    yield from photograph("histogram_selected")


def scenario():
    open_panels("RLE_SPLAT_PT_transfer")
    volume = yield from set_up()
    name = volume.name
    yield from check_histogram(volume)
    passed("histogram")
    yield from choose_tool()
    yield from check_value_under_the_mouse()
    passed("value under the mouse")
    yield from check_drag(bpy.data.objects[name])
    passed("drag")
    yield from check_fine(name)
    passed("fine")
    yield from check_cancel(name)
    passed("cancel")


drive(scenario)
