"""The look edited where the picture is, in a real window: window and level dragged by the mouse in the viewport, the
value under the mouse, and the histogram above the curve.  dev.py test runs it."""

import os
import re
import tempfile
from math import radians
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Euler, Vector

from tests.blender.scenes import image_pixels, module
from tests.blender.user_steps import live, settled
from tests.blender.window_driver import (
    SHOTS,
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
MIDDLE = np.zeros(3)
FILE = f"""ObjectType = Image
NDims = 3
BinaryData = True
BinaryDataByteOrderMSB = False
TransformMatrix = 1 0 0 0 1 0 0 0 1
Offset = {-SPACING * (SIDE - 1) / 2} {-SPACING * (SIDE - 1) / 2} {-SPACING * (SIDE - 1) / 2}
AnatomicalOrientation = RAI
ElementSpacing = {SPACING} {SPACING} {SPACING}
DimSize = {SIDE} {SIDE} {SIDE}
ElementType = MET_SHORT
ElementDataFile = LOCAL
"""  # a MetaImage in patient space
RADIUS = 12.0  # voxels
TOOL = "rle_splat.window_tool"
FRAME = 114.0  # gray of the lines around a curve in Blender's own theme


def ball():
    """Values that fall from 1000 in the middle to 0 outward, through 400 at RADIUS."""
    z, y, x = np.mgrid[:SIDE, :SIDE, :SIDE] - (SIDE - 1) / 2
    apart = np.sqrt(x**2 + y**2 + z**2)
    return np.clip(1000.0 - 50.0 * apart, 0.0, None).astype(np.int16)


def set_up():
    yield from new_file()
    scene = bpy.context.scene
    scene.view_settings.view_transform = "Standard"
    with in_the_view():
        path = FOLDER / "ball.mha"
        path.write_bytes(FILE.encode() + ball().tobytes())
        scene.rle_splat.scene_scale = 1.0
        assert bpy.ops.rle_splat.import_volume(filepath=str(path), value_unit="HU") == {"FINISHED"}
        volume = bpy.context.view_layer.objects.active
    functions = module("rle_splat.classify.transfer_function")
    module("bridge.look.transfer").write_transfer(
        volume,
        functions.TransferFunction(
            name="ball",
            unit="HU",
            opacity=((0.0, 0.0), (395.0, 0.0), (405.0, 0.9), (1000.0, 0.9)),
            color=((0.0, 0.1, 0.0, 0.0), (500.0, 0.9, 0.4, 0.2), (1000.0, 1.0, 0.95, 0.8)),
            opacity_unit_distance=1.0,
        ),
    )
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


def pictures_drawn() -> int:
    counts = live().viewports_of(area_of("VIEW_3D"))[0].counts
    return counts["drafts"] + counts["refinements"]


def check_drag(volume):
    """A drag to the right and up widens the window and raises the level; the live picture follows; one undo step."""
    name, before = volume.name, window_now(volume)
    middle = on_screen(MIDDLE)
    drawn = pictures_drawn()
    steps = drag(middle, [(20, 10)] * 4)
    for at in steps:
        if at is not None:
            yield from until(lambda: pictures_drawn() > drawn)  # while the button is held
            yield from photograph("dragging")
            during = window_now(bpy.data.objects[name])
            assert during[0] > before[0] and during[1] > before[1], (before, during)
        else:
            yield
    after = window_now(bpy.data.objects[name])
    print(f"dragged by 80, 40 pixels: level and window {before} -> {after}", flush=True)
    assert after == during
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
    probe = module("bridge.look.probe")
    area = area_of("VIEW_3D")
    yield from settled()
    drawn = pictures_drawn()
    for by in range(4):
        simulate("MOUSEMOVE", at=np.add(on_screen(MIDDLE), by))
        yield
    assert pictures_drawn() == drawn, "reading values draws the volume again"
    line = probe.hovered(area)
    print(f"over the ball: {line}", flush=True)
    value = float(line.split(" HU")[0])
    assert 395.0 < value < 420.0 and "voxel" in line and re.search(r", [LR] \d+\.\d A \d+\.\d [SI] \d+\.\d mm$", line)
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


def check_histogram(volume_name):
    """The histogram at the default, a wide and a narrow sidebar, with large buttons, and with a selected point."""
    sidebar = region_of(area_of("VIEW_3D"), "UI")
    default = sidebar.width
    for name, by in (("default", 0), ("wide", -150), ("narrow", 190)):
        yield from widen_sidebar(by)
        if by:
            assert (sidebar.width - default) * -by > 0, f"{name}: the sidebar is {sidebar.width} pixels wide"
        yield from photograph(f"histogram_{name}")
    yield from widen_sidebar(-40)
    bpy.context.preferences.view.ui_scale = 1.3
    yield
    yield from photograph("histogram_large")
    bpy.context.preferences.view.ui_scale = 1.0
    yield
    yield from click_point(volume_name)


def widen_sidebar(by):
    """Drag the left border of the 3D view's sidebar by so many pixels."""
    if not by:
        return
    sidebar = region_of(area_of("VIEW_3D"), "UI")
    at = sidebar.x, sidebar.y + sidebar.height // 4
    for kind, value, moved in (
        ("MOUSEMOVE", "NOTHING", 3), ("MOUSEMOVE", "NOTHING", 0), ("LEFTMOUSE", "PRESS", 0),
        ("MOUSEMOVE", "NOTHING", by // 2), ("MOUSEMOVE", "NOTHING", by), ("LEFTMOUSE", "RELEASE", by),
    ):  # fmt: skip
        simulate(kind, value, at=(at[0] + moved, at[1]))
        yield


def click_point(volume_name):
    """A click on a point of the curve below the picture, which covers it with nothing, selects it."""
    points = bpy.data.objects[volume_name].rle_splat.transfer.nodes["Opacity"].mapping.curves[0].points
    for point in points:
        point.select = False
    yield from photograph("histogram", looked_at=True)
    place = find_curve()
    at = place[0] + points[2].location.x * (place[2] - place[0]), place[1] + points[2].location.y * (
        place[3] - place[1])  # fmt: skip
    for kind, value in (("MOUSEMOVE", "NOTHING"), ("LEFTMOUSE", "PRESS"), ("LEFTMOUSE", "RELEASE")):
        simulate(kind, value, at=at)
        yield
    yield from photograph("histogram_selected")
    assert [point.select for point in points] == [False, False, True, False], "the click did not reach the curve"


def find_curve():
    """(left, bottom, right, top) of the curve's button in the window, from the photograph: a frame of gray lines."""
    pixels = screen("histogram")
    sidebar = region_of(area_of("VIEW_3D"), "UI")
    gray = np.abs(pixels[:, sidebar.x : sidebar.x + sidebar.width] - FRAME).max(axis=2) < 3.0
    top, bottom = (row for row in range(len(gray)) if longest_run(gray[row]) > 0.7 * sidebar.width)
    line = np.flatnonzero(gray[top])
    return sidebar.x + line[0], len(pixels) - bottom, sidebar.x + line[-1], len(pixels) - top


def longest_run(row) -> int:
    """The largest number of neighbors in a row that are true."""
    edges = np.flatnonzero(np.diff(np.concatenate(((False,), row, (False,))).astype(int)))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def screen(name: str):
    """A photograph of the screen: (H, W, 3) float, 0 to 255, row 0 at the top."""
    image = bpy.data.images.load(str(Path(os.environ[SHOTS]) / f"{name}.png"))
    pixels = image_pixels(image)[..., :3] * 255.0
    bpy.data.images.remove(image)
    return pixels


def check_linked(volume_name):
    """Over a linked volume a press is refused with one sentence and changes nothing."""
    volume = bpy.data.objects[volume_name]
    path = FOLDER / "library.blend"
    bpy.data.libraries.write(str(path), {volume})
    with bpy.data.libraries.load(str(path), link=True) as (_source, target):
        target.objects = [volume_name]
    linked = target.objects[0]
    bpy.data.objects.remove(volume)
    bpy.context.scene.collection.objects.link(linked)
    bpy.context.view_layer.objects.active = linked
    yield from settled()
    before = window_now(linked)
    yield from (None for _ in drag(on_screen(MIDDLE), [(30, 30)]))
    assert window_now(linked) == before
    yield from photograph("linked")


def scenario():
    open_panels("RLE_SPLAT_PT_transfer")
    volume = yield from set_up()
    name = volume.name
    yield from check_histogram(name)
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
    yield from check_linked(name)
    passed("linked")


drive(scenario)
