"""The extension in a real Blender with a window, on a virtual screen: what only a window does.

F12 renders off the main thread there, long work runs from a timer, and Esc stops it.  dev.py test runs it.
"""

import tempfile
import threading
from math import radians
from pathlib import Path

import bpy
import numpy as np
from mathutils import Euler

from tests.blender.real_blender import (
    SIZE,
    TOLERANCE,
    N,
    add_strip,
    column_of,
    import_cube,
    over,
    pixels_of,
    set_up_scene,
    write_exr,
)
from tests.blender.scenes import module
from tests.blender.window_driver import area_of, drive, in_the_view, passed, until, window

LARGE = 4096  # pixels a side of a picture that takes longer than a step
FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_window_"))
on_main_thread: list[bool] = []  # of each splatting for a render
completed: list[bool] = []


def watch_renders() -> None:
    handlers = module("bridge.render.over_render")
    splat = handlers.splat_over_render

    def watched(*arguments):
        on_main_thread.append(threading.current_thread() is threading.main_thread())
        splat(*arguments)

    handlers.splat_over_render = watched
    bpy.app.handlers.render_complete.append(lambda *_: completed.append(True))


def check_f12():
    """Predicted pixels of a still that was rendered off the main thread, with meshes before, in and behind."""
    scene = bpy.context.scene
    strips = [(0.0, 1.5, 15.0, (1.0, 0.1, 0.1)), (2.0, 3.5, 2.3, (0.1, 1.0, 0.1)), (6.0, 7.0, -5.0, (0.1, 0.1, 1.0))]
    for strip in strips:
        add_strip(*strip)
    write_exr(FOLDER / "still.exr")
    with in_the_view():
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
        assert bpy.ops.render.render("INVOKE_DEFAULT", write_still=True) == {"RUNNING_MODAL"}
    yield from until(lambda: completed)
    row = pixels_of(bpy.data.images.load(str(FOLDER / "still.exr")))[SIZE // 2]
    lengths = (0.0, N - 0.5 - 2.3, N)
    for (x0, _x1, _z, color), length in zip(strips, lengths):
        np.testing.assert_allclose(row[column_of(x0 + 0.8)], over(length, color, 1.0), atol=TOLERANCE)
    np.testing.assert_allclose(row[column_of(4.8)], over(N), atol=TOLERANCE)
    assert on_main_thread == [False] and scene.rle_splat.message == ""


def check_animation():
    """Each frame is splatted anew: between the two the volume leaves the picture."""
    scene = bpy.context.scene
    for strip in [other for other in bpy.data.objects if other.name.startswith("strip")]:
        bpy.data.objects.remove(strip)
    volume = next(other for other in bpy.data.objects if other.rle_splat.is_volume)
    for frame, x in ((1, 0.0), (2, 100.0)):
        volume.location.x = x
        volume.keyframe_insert("location", frame=frame)
    scene.frame_start, scene.frame_end = 1, 2
    write_exr(FOLDER / "frame_#.exr")
    completed.clear()
    on_main_thread.clear()
    with in_the_view():
        bpy.ops.render.render("INVOKE_DEFAULT", animation=True)
    yield from until(lambda: completed)
    shown = [
        pixels_of(bpy.data.images.load(str(FOLDER / f"frame_{frame}.exr")))[SIZE // 2, SIZE // 2, 3] for frame in (1, 2)
    ]
    np.testing.assert_allclose(shown, (over(N)[3], 0.0), atol=TOLERANCE)
    assert on_main_thread == [False, False]
    volume.animation_data_clear()
    volume.location.x = 0.0


def check_blurred_f12():
    """A still that is rendered off the main thread is blurred as Render to Image is, and reading the motion fires no
    frame-change handler."""
    scene = bpy.context.scene
    volume = next(other for other in bpy.data.objects if other.rle_splat.is_volume)
    for frame, x in ((1, 0.0), (5, 4.0)):
        volume.location.x = x
        volume.keyframe_insert("location", frame=frame)
    scene.frame_set(3)
    scene.render.use_motion_blur = True
    write_exr(FOLDER / "blurred.exr")
    completed.clear()
    with in_the_view():
        assert bpy.ops.render.render("INVOKE_DEFAULT", write_still=True) == {"RUNNING_MODAL"}
    yield from until(lambda: completed)
    assert scene.rle_splat.effect_rows["motion blur"].on and scene.rle_splat.message == ""
    fired = []
    bpy.app.handlers.frame_change_post.append(lambda *_: fired.append(True))
    with in_the_view():
        assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    bpy.app.handlers.frame_change_post.pop()
    assert not fired
    np.testing.assert_array_equal(pixels_of(scene.rle_splat.composite_image), pixels_of(scene.rle_splat.image))
    scene.render.use_motion_blur = False
    volume.animation_data_clear()
    volume.location.x = 0.0


def check_render_image():
    """The picture made little by little is the one made at once."""
    settings = bpy.context.scene.rle_splat
    jobs = module("bridge.loop.jobs").StepwiseOperator
    with in_the_view():
        assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
        at_once = pixels_of(settings.image).copy()
        settings.image.pixels.foreach_set(np.zeros(SIZE * SIZE * 4, np.float32))
        assert bpy.ops.rle_splat.render_image("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    yield from until(lambda: not jobs._running)
    np.testing.assert_array_equal(pixels_of(settings.image), at_once)


def check_escape():
    """Esc stops a large picture and leaves the one of before."""
    scene = bpy.context.scene
    before = pixels_of(scene.rle_splat.image).copy()
    scene.render.resolution_x = scene.render.resolution_y = LARGE
    scene.rle_splat.quality = "strict"
    operators = module("bridge.loop.jobs").StepwiseOperator
    with in_the_view():
        assert bpy.ops.rle_splat.render_image("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    assert operators._running
    window().event_simulate(type="ESC", value="PRESS")
    window().event_simulate(type="ESC", value="RELEASE")
    yield from until(lambda: not operators._running)
    np.testing.assert_array_equal(pixels_of(scene.rle_splat.image), before)


def check_letters():
    """The letters beside a volume in patient space are drawn without a complaint of Blender's."""
    import nibabel

    path = FOLDER / "patient.nii"
    nibabel.save(nibabel.Nifti1Image(np.arange(60, dtype=np.uint8).reshape(3, 4, 5), np.eye(4)), path)
    with in_the_view():
        assert bpy.ops.rle_splat.import_volume("EXEC_DEFAULT", filepath=str(path)) == {"FINISHED"}
    letters = module("bridge.live.letters")
    drawn, draw = [], letters.blf.draw
    letters.blf.draw = lambda font, letter: drawn.append(letter)
    view = area_of("VIEW_3D").spaces.active.region_3d
    before = view.view_rotation.copy()
    for turn, expected in ((35.0, {"RA", "LP", "S", "I"}), (0.0, {"R", "L", "S", "I"})):
        view.view_rotation = Euler((radians(90.0), 0.0, radians(turn))).to_quaternion()
        drawn.clear()
        yield from until(lambda expected=expected: set(drawn) >= expected)
        assert set(drawn) == expected
    letters.blf.draw, view.view_rotation = draw, before
    with in_the_view():
        bpy.ops.object.delete()


def check_drafts():
    """A picture that takes long shows a draft first, in its own image, and then is the one made at once."""
    scene = bpy.context.scene
    jobs = module("bridge.loop.jobs").StepwiseOperator
    module("bridge.pictures.drafts").QUICK = -1.0
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.rle_splat.quality = "standard"
    with in_the_view():
        assert bpy.ops.rle_splat.preview_in_camera_view(place="FRONT") == {"FINISHED"}
    image = bpy.data.images[next(name for name in bpy.data.images.keys() if name.endswith("Backdrop"))]
    at_once, shown, show = pixels_of(image).copy(), [], jobs._show

    def watched(job, context, draft):
        show(job, context, draft)
        shown.append(pixels_of(image).copy())

    jobs._show = watched
    with in_the_view():
        assert bpy.ops.rle_splat.preview_in_camera_view("INVOKE_DEFAULT", place="FRONT") == {"RUNNING_MODAL"}
    yield from until(lambda: not jobs._running)
    assert len(shown) == 1 and np.abs(shown[0] - at_once).max() > TOLERANCE
    np.testing.assert_array_equal(pixels_of(image), at_once)
    jobs._show = show


def check_following():
    """A backdrop that follows gets drafts while the animation plays, and the picture itself once it rests.

    It needs no timer after that.
    """
    scene = bpy.context.scene
    work = module("bridge.loop.work")
    volume = next(other for other in bpy.data.objects if other.rle_splat.is_volume)
    scene.frame_start, scene.frame_end = 1, 50
    for frame, x in ((1, 0.0), (50, 4.0)):
        volume.location.x = x
        volume.keyframe_insert("location", frame=frame)
    with in_the_view():
        assert bpy.ops.rle_splat.preview_in_camera_view(place="FRONT", follow=True) == {"FINISHED"}
    image = bpy.data.images[next(name for name in bpy.data.images.keys() if name.endswith("Backdrop"))]
    with in_the_view():
        bpy.ops.screen.animation_play()
    yield from until(lambda: work._pictures)
    assert window().screen.is_animation_playing
    with in_the_view():
        bpy.ops.screen.animation_cancel(restore_frame=False)
    draft = pixels_of(image).copy()
    yield from until(lambda: not work._pictures)
    refined = pixels_of(image).copy()
    assert np.abs(refined - draft).max() > TOLERANCE
    scene.frame_set(scene.frame_current)
    np.testing.assert_array_equal(pixels_of(image), refined)
    timer = module("bridge.loop.timer")
    yield from until(lambda: not bpy.app.timers.is_registered(timer._tick))


def redraws(region, act):
    """Wait until the 3D view rests, act as a script does in it, and wait until that region of it is drawn again."""
    drawn, before = [], -1
    handler = bpy.types.SpaceView3D.draw_handler_add(lambda: drawn.append(True), (), region, "POST_PIXEL")
    while before != len(drawn):
        before = len(drawn)
        yield
    with in_the_view():
        act()
    yield from until(lambda: len(drawn) > before)
    bpy.types.SpaceView3D.draw_handler_remove(handler, region)


def check_B83_remove_backdrop_redraws():
    """From a script, which Blender does not redraw anything for by itself."""
    with in_the_view():
        assert bpy.ops.rle_splat.preview_in_camera_view() == {"FINISHED"}
    yield from redraws("WINDOW", bpy.ops.rle_splat.remove_from_camera_view)
    with in_the_view():
        assert bpy.ops.rle_splat.preview_in_camera_view() == {"FINISHED"}


def check_B84_measure_accuracy_redraws():
    """The sidebar, when measuring little by little has ended."""
    jobs = module("bridge.loop.jobs").StepwiseOperator
    area = next(area for area in bpy.context.window_manager.windows[0].screen.areas if area.type == "VIEW_3D")
    area.spaces.active.show_region_ui = True
    scene = bpy.context.scene
    scene.render.resolution_x = scene.render.resolution_y = 16
    with in_the_view():
        assert bpy.ops.rle_splat.measure_accuracy("INVOKE_DEFAULT", probes=2, repeats=1) == {"RUNNING_MODAL"}
    drawn, rows = [], scene.rle_splat.accuracy_rows
    handler = bpy.types.SpaceView3D.draw_handler_add(lambda: drawn.append(len(rows)), (), "UI", "POST_PIXEL")
    yield from until(lambda: not jobs._running)
    yield from until(lambda: drawn and drawn[-1] == len(rows))
    bpy.types.SpaceView3D.draw_handler_remove(handler, "UI")
    assert len(rows)


def steps():
    watch_renders()
    with in_the_view():
        set_up_scene()
        import_cube(FOLDER)
    yield
    for check in (
        check_f12, check_animation, check_blurred_f12, check_render_image, check_B83_remove_backdrop_redraws,
        check_B84_measure_accuracy_redraws, check_escape, check_letters, check_drafts, check_following):  # fmt: skip
        yield from check()
        passed(check.__name__)
        yield


drive(steps)
