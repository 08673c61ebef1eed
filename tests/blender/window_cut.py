"""Handles of cut boxes and planes in a real window, dragged by a mouse, and slices in Solid and in Cycles.
dev.py test runs it; its photographs are to be looked at."""

import tempfile
from math import radians
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Euler, Vector

from tests.blender import scenes
from tests.blender.scenes import module
from tests.blender.user_steps import middle, press_button
from tests.blender.user_steps import press as press_key
from tests.blender.window_driver import (
    area_of,
    drive,
    in_the_view,
    new_file,
    open_panels,
    passed,
    photograph,
    redraw,
    region_of,
    until,
    window,
)

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_cut_"))
N = 24  # voxels a side


def handles():
    return module("bridge.scene.clip_handles")


def view():
    return area_of("VIEW_3D").spaces.active.region_3d


def look(rotation, distance=70.0):
    held = view()
    held.view_perspective = "PERSP"
    held.view_location, held.view_distance = ((N - 1) / 2,) * 3, distance
    held.view_rotation = Euler(tuple(map(radians, rotation))).to_quaternion()
    held.update()


def settled():
    """Wait until the live picture has been refined."""
    live = module("bridge.live")
    area_of("VIEW_3D").tag_redraw()
    yield
    yield
    yield from until(lambda: not any(one.is_busy for one in live.viewports_of(area_of("VIEW_3D"))))
    assert not live.problem_of(area_of("VIEW_3D"))
    yield


def screen_place(point) -> tuple[int, int]:
    """Where the view shows a point of the world, in pixels of the window."""
    region = region_of(area_of("VIEW_3D"), "WINDOW")
    place = location_3d_to_region_2d(region, view(), Vector(point))
    return int(region.x + place.x), int(region.y + place.y)


def move_mouse(place) -> None:
    window().event_simulate(type="MOUSEMOVE", value="NOTHING", x=place[0], y=place[1])


def press(value: str, place, button: str = "LEFTMOUSE") -> None:
    window().event_simulate(type=button, value=value, x=place[0], y=place[1])


def drag(start, end, name: str, ends_with: str = "LEFTMOUSE"):
    """Drag from one point of the world to another with the mouse, and photograph the middle of it."""
    first, last = np.array(screen_place(start)), np.array(screen_place(end))
    move_mouse(first - 1)
    yield
    move_mouse(first)
    yield
    press("PRESS", first)
    yield
    for share in (0.2, 0.4, 0.6, 0.8, 1.0):
        move_mouse((first + share * (last - first)).astype(int))
        yield
        if share == 0.6:
            yield from photograph(name)
    if ends_with == "LEFTMOUSE":
        press("RELEASE", last)
    else:
        press("PRESS", last, ends_with)
        yield
        press("RELEASE", last, ends_with)
        press("RELEASE", last)
    yield
    redraw()  # in which the end of the drag is noticed
    yield
    yield


def set_up():
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_clip_objects", "RLE_SPLAT_PT_slices")
    yield from new_file()
    z, y, x = np.mgrid[:N, :N, :N]
    shell = np.sqrt((x - 11.5) ** 2 + (y - 11.5) ** 2 + (z - 11.5) ** 2)
    voxels = np.clip(90 + 6 * x + np.where(np.abs(shell - 8) < 1.5, 60, 0) - 8 * np.maximum(shell - 11, 0), 0, 255)
    with in_the_view():
        owner = scenes.import_raw(FOLDER, voxels.astype(np.uint8), name="head")
        scenes.load_color(FOLDER, (0.8, 0.45, 0.3), alpha=0.5)
    bpy.ops.ed.undo_push(message="start")
    look((60.0, 0.0, 30.0))
    yield from settled()
    return owner.name


def faces(box) -> np.ndarray:
    """(3, 2): where the faces of a box are along each axis of the world, which its own are parallel to."""
    matrix = np.array(box.matrix_world)
    half = np.abs(np.diag(matrix[:3, :3])) * box.empty_display_size
    return np.stack((matrix[:3, 3] - half, matrix[:3, 3] + half), axis=1)


def check_box(name):
    """A drag of a face's handle moves that face and no other, as one step of undo; Esc restores."""
    with in_the_view():
        bpy.ops.rle_splat.add_cutting_object("EXEC_DEFAULT", True, kind="BOX")
    yield from settled()
    yield from photograph("box")
    box = bpy.context.view_layer.objects.active
    before = faces(box)
    np.testing.assert_allclose(before, [[0.0, N - 1.0]] * 3, atol=1e-4)
    middle = before.mean(axis=1)
    start, end = middle.copy(), middle.copy()
    start[2], end[2] = before[2, 1], before[2, 1] - 8.0
    yield from drag(start, end, "box_drag")
    yield from settled()
    yield from photograph("box_dragged")
    box = bpy.data.objects["Cut Box"]
    after = faces(box)
    print(f"faces before {before.tolist()}, after {after.tolist()}", flush=True)
    expected = before.copy()
    expected[2, 1] -= 8.0
    np.testing.assert_allclose(after, expected, atol=1.0)
    expected[2, 1] = after[2, 1]
    np.testing.assert_allclose(after, expected, atol=1e-3, err_msg="another face was moved")
    assert after[2, 1] < before[2, 1] - 4.0
    with in_the_view():
        bpy.ops.ed.undo()
    yield
    np.testing.assert_allclose(faces(bpy.data.objects["Cut Box"]), before, atol=1e-4)
    assert "Cut Box" in bpy.data.objects, "the drag was undone together with the box"
    with in_the_view():
        bpy.ops.ed.redo()
    yield
    np.testing.assert_allclose(faces(bpy.data.objects["Cut Box"]), after, atol=1e-4)
    start[2] = after[2, 1]
    yield from drag(start, end - (0, 0, 6.0), "box_cancelled", ends_with="RIGHTMOUSE")
    np.testing.assert_allclose(faces(bpy.data.objects["Cut Box"]), after, atol=1e-3)


def check_volume_shows_handles(name):
    """The handles of its box show while the volume is active, and none when another object is."""
    scenes.activate(bpy.data.objects[name])
    yield from settled()
    yield from photograph("box_of_active_volume")
    assert handles().active_box(bpy.context).name == "Cut Box"
    bpy.data.objects["Cut Box"].hide_set(True)
    assert handles().active_box(bpy.context) is None
    bpy.data.objects.remove(bpy.data.objects["Cut Box"])
    yield


def check_plane(name):
    """Cut Along View from the view as it is; its handle moves it along its normal."""
    scenes.activate(bpy.data.objects[name])
    look((55.0, 0.0, 25.0))
    yield
    with in_the_view():
        assert bpy.ops.rle_splat.cut_along_view("EXEC_DEFAULT", True, through="VIEW") == {"FINISHED"}
    yield from settled()
    yield from photograph("plane_facing")
    plane = bpy.context.view_layer.objects.active
    back = view().view_rotation @ Vector((0.0, 0.0, 1.0))
    np.testing.assert_allclose(plane.matrix_world.to_3x3().col[2].normalized(), back, atol=1e-5)
    np.testing.assert_allclose((plane.matrix_world.translation - view().view_location).dot(back), 0.0, atol=1e-4)
    look((75.0, 0.0, 80.0))
    yield from settled()
    yield from photograph("plane_from_the_side")
    start = plane.matrix_world.translation.copy()
    yield from drag(start, start - 5.0 * back, "plane_drag")
    yield from settled()
    yield from photograph("plane_dragged")
    step = bpy.data.objects["Cut Plane"].matrix_world.translation - start
    print(f"the plane moved by {tuple(step)}, along its normal by {step.dot(back)}", flush=True)
    np.testing.assert_allclose(step.dot(back), -5.0, atol=1.0)
    assert (step - step.dot(back) * back).length < 1e-3
    with in_the_view():
        bpy.ops.ed.undo()
    yield
    np.testing.assert_allclose(bpy.data.objects["Cut Plane"].matrix_world.translation, start, atol=1e-4)
    yield from check_ring("Cut Plane")
    scene = bpy.context.scene
    scene.cursor.location = Vector(((N - 1) / 2,) * 3) + 4.0 * back
    look((55.0, 0.0, 25.0))
    yield
    scenes.activate(bpy.data.objects["Cut Plane"])
    with in_the_view():
        assert bpy.ops.rle_splat.cut_along_view("EXEC_DEFAULT", True, through="CURSOR") == {"FINISHED"}
    yield from settled()
    yield from photograph("plane_at_cursor")
    assert [one.name for one in scene.rle_splat.clip_objects.objects] == ["Cut Plane"], "a second plane was added"


def check_gray_values(name):
    """A click on Gray Values on Cut puts a slice on the plane, which a drag of the plane takes along; it goes with the
    plane, and undo brings both back."""

    def values():
        return [one for one in bpy.data.objects if one.rle_splat.is_slice]

    scenes.activate(bpy.data.objects[name])
    yield from settled()
    yield from press_button("bpy.ops.rle_splat.gray_values_on_cut")
    yield from settled()
    yield from photograph("gray_on_plane")
    (one,) = values()
    plane = bpy.data.objects["Cut Plane"]
    before = scenes.image_pixels(one.rle_splat.slice_image)
    assert 0.05 < before[..., 3].mean() < 0.9 and before[..., 0].max() > 0.1
    scenes.activate(plane)
    start, back = plane.matrix_world.translation.copy(), plane.matrix_world.col[2].to_3d().normalized()
    look((75.0, 0.0, 80.0))
    yield from settled()
    yield from drag(start, start - 6.0 * back, "gray_drag")
    yield from settled()
    yield from photograph("gray_dragged")
    assert (plane.matrix_world.translation - start).length > 3.0
    assert not np.array_equal(scenes.image_pixels(one.rle_splat.slice_image), before)
    scenes.activate(plane)
    yield from press_key("X", middle())
    yield from press_key("RET", middle())
    yield from until(lambda: not values())
    yield from photograph("gray_deleted")
    assert "Cut Plane" not in bpy.context.scene.objects
    with in_the_view():
        bpy.ops.ed.undo()
    yield from settled()
    (one,) = values()
    assert one.parent == bpy.data.objects["Cut Plane"]
    scenes.activate(bpy.data.objects[name])
    yield from press_button("bpy.ops.rle_splat.gray_values_on_cut")
    yield from settled()
    assert not values()


def check_ring(name):
    """A drag along a ring tilts the plane about one of its own axes, after the mouse, as one step of undo."""
    before = bpy.data.objects[name].matrix_world.copy()
    middle, axis = handles().tilt_axis(bpy.data.objects[name], 0)
    right, up = (view().view_rotation @ Vector(one) for one in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    pixels = screen_place(middle + right)[0] - screen_place(middle)[0]  # in a unit of the world, at the plane's middle
    arm = 75.0 * 0.8 / pixels * before.col[1].to_3d().normalized()  # Blender's size of handles, and ours
    path = axis.cross(arm)
    yield from drag(middle + arm, middle + arm + 0.5 * path, "plane_tilting")
    yield from settled()  # with a redraw, in which the end of the drag becomes a step of undo
    after = bpy.data.objects[name].matrix_world.copy()
    turned = axis.dot(before.col[2].to_3d().normalized().cross(after.col[2].to_3d().normalized()))
    print(f"tilted by sine {turned}; the drag is {path.dot(up)} up", flush=True)
    assert turned > 0.1, "the ring was missed, or turns against the mouse"
    assert (after.translation - before.translation).length < 1e-3
    with in_the_view():
        bpy.ops.ed.undo()
    yield
    np.testing.assert_allclose(np.array(bpy.data.objects[name].matrix_world), np.array(before), atol=1e-4)


def check_slices(name):
    """Slices in Solid and in Cycles; the handle of one moves it, and its picture follows; undo brings both back."""
    for one in tuple(bpy.context.scene.rle_splat.clip_objects.objects):
        bpy.data.objects.remove(one)
    yield
    owner = bpy.data.objects[name]
    scenes.activate(owner)
    scene = bpy.context.scene
    scene.view_settings.view_transform = "Standard"
    with in_the_view():
        bpy.ops.rle_splat.window_level(center=128.0, width=256.0)
        assert bpy.ops.rle_splat.add_slice("EXEC_DEFAULT", True, kind="ALL") == {"FINISHED"}
    look((65.0, 0.0, 35.0))
    space = area_of("VIEW_3D").spaces.active
    for shading, engine in (("SOLID", "BLENDER_WORKBENCH"), ("RENDERED", "CYCLES")):
        scene.render.engine, space.shading.type = engine, shading
        yield from settled()
        yield from photograph(f"slices_{shading.lower()}")
    space.shading.type = "SOLID"
    space.show_object_viewport_volume = False
    yield
    yield from photograph("slices_alone")
    space.show_object_viewport_volume = True
    one = next(one for one in bpy.data.objects if one.name.endswith("Axial"))
    scenes.activate(one)
    yield from settled()
    before = scenes.image_pixels(one.rle_splat.slice_image)
    start = one.matrix_world.translation.copy()
    yield from drag(start, start + Vector((0.0, 0.0, 6.0)), "slice_drag")
    yield from settled()
    yield from photograph("slice_dragged")
    moved = one.matrix_world.translation - start
    print(f"the slice moved by {tuple(moved)}", flush=True)
    np.testing.assert_allclose(tuple(moved), (0.0, 0.0, 6.0), atol=1.0)
    assert not np.allclose(scenes.image_pixels(one.rle_splat.slice_image), before)
    with in_the_view():
        bpy.ops.ed.undo()
    yield
    yield
    one = next(one for one in bpy.data.objects if one.name.endswith("Axial"))
    np.testing.assert_allclose(scenes.image_pixels(one.rle_splat.slice_image), before, atol=1e-6)


def check_render(name):
    """An animation rendered off the main thread, while the viewport shows the slice, has the slice of each frame."""
    scene = bpy.context.scene
    one = next(one for one in bpy.data.objects if one.name.endswith("Axial"))
    for other in bpy.data.objects:
        other.hide_render = other.rle_splat.is_slice and other != one
    for frame, place in ((1, -8.0), (3, 8.0)):
        one.location.z = place
        one.keyframe_insert("location", frame=frame)
    camera = scenes.add_camera(((N - 1) / 2, (N - 1) / 2, 100.0), type="ORTHO", ortho_scale=N - 2)
    scenes.use_cycles((16, 16), samples=4)
    scene.frame_start, scene.frame_end = 1, 3
    scenes.write_exr(FOLDER / "f")
    scene.frame_set(1)
    ended = []
    bpy.app.handlers.render_complete.append(lambda *_: ended.append(True))
    with in_the_view():
        assert bpy.ops.render.render("INVOKE_DEFAULT", animation=True) == {"RUNNING_MODAL"}
    yield from until(lambda: ended)
    yield
    shown = []
    for frame in (1, 2, 3):
        scene.frame_set(frame)
        yield
        expected = scenes.image_pixels(one.rle_splat.slice_image)[1:-1, 1:-1, 0].mean()
        shown.append((scenes.load_pixels(FOLDER / f"f{frame:04d}.exr")[..., 0].mean(), expected))
    print(f"rendered and expected: {shown}", flush=True)
    np.testing.assert_allclose(*np.array(shown).T, rtol=0.03)
    assert np.ptp(np.array(shown)[:, 1]) > 0.02, "the frames do not differ"
    bpy.data.objects.remove(camera)


def check_deleted(name):
    """Slices of a deleted volume show stripes, and the panel says why."""
    scenes.activate(bpy.data.objects[name])
    with in_the_view():
        bpy.ops.object.delete()
    slices = [one for one in bpy.data.objects if one.rle_splat.is_slice]
    yield from until(lambda: bpy.context.scene.rle_splat.message)
    yield from photograph("slices_of_a_deleted_volume")
    problem = module("bridge.live.slice_pictures").problem_of
    assert len(slices) == 3 and all("not the child of a volume" in problem(one) for one in slices)


def scenario():
    name = yield from set_up()
    for check in (check_box, check_volume_shows_handles, check_plane, check_gray_values, check_slices, check_render,
                  check_deleted):  # fmt: skip
        yield from check(name)
        passed(check.__name__)


drive(scenario)
