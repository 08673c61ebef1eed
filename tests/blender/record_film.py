"""The film of the guide "Animate", by its steps in a real window: a plane opens a skull while the camera turns.

    python3 dev.py blender --photograph tests/blender/record_film.py --size 1280x800

writes how-to-opening.webp into build/window-shots/record_film, and prints the seconds of a frame.  The scan is that of
the tutorial, in tests/blender/data/scan.  The way back is the same frames once more.
"""

import os
import subprocess
import tempfile
import time
from pathlib import Path

import bpy

from tests.blender.guide_steps import activate, imported
from tests.blender.user_steps import settled
from tests.blender.window_driver import SHOTS, drive, in_the_view, passed

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_film_"))
TURN, LAST, STEP = 60, 120, 2  # frames of the turn, and of all; each second one is shown
ANGLE, START, LENS = 40.0, -20.0, 86.0  # degrees, and mm
FRONT, BACK = -0.11, 0.005  # meters from the middle
SHIFT, GROW, OPAQUE, SMOOTH = -100.0, 2.0, 0.05, 2.0  # HU, mm, mm, mm: thin walls are whole and opaque
LEVEL, WINDOW = 400.0, 1200.0  # HU
SAMPLES = 8  # of Cycles, which renders the faces of the cut and the world alone
CENTISECONDS, REST, QUALITY, SIZE = 8, 60, 84, "720x540"


def skull():
    """Steps 1 to 3 of the tutorial."""
    volume = yield from imported("ct-bone", "scan")
    activate(volume)
    with in_the_view():
        assert bpy.ops.rle_splat.remove_table() == {"FINISHED"}
        assert bpy.ops.rle_splat.change_segment(tool="GROW", length=GROW) == {"FINISHED"}
    ours = volume.rle_splat
    ours.shift_by, ours.opacity_unit_distance, ours.smoothness = SHIFT, OPAQUE, SMOOTH
    yield from settled()
    return volume


def turn_and_cut(scene, volume):
    """Steps 2 to 6 of the guide."""
    with in_the_view():
        assert bpy.ops.rle_splat.turntable(
            filepath=str(FOLDER / "turn"), frames=TURN, angle=ANGLE, azimuth=START, render=False
        ) == {"FINISHED"}  # fmt: skip
        scene.camera.data.lens = LENS
        scene.frame_set(1)
        scene.camera.parent.keyframe_insert("rotation_euler", index=2, frame=LAST)
        activate(volume)
        assert bpy.ops.rle_splat.add_lights(kind="SOFT") == {"FINISHED"}
        bpy.ops.view3d.view_axis(type="FRONT")
    yield from settled()
    with in_the_view():
        assert bpy.ops.rle_splat.clip_to_view() == {"FINISHED"}
    plane = bpy.context.view_layer.objects.active
    middle = plane.location.y
    for number, away in ((1, FRONT), (TURN, BACK), (LAST, FRONT)):
        plane.location.y = middle + away
        plane.keyframe_insert("location", frame=number)
    activate(volume)
    with in_the_view():
        assert bpy.ops.rle_splat.gray_on_cut() == {"FINISHED"}
    ours = volume.rle_splat
    ours.slices_follow_window, ours.slices_clear_black = False, True
    ours.slice_center, ours.slice_width = LEVEL, WINDOW
    yield from settled()


def scenario():
    volume = yield from skull()
    scene, render = bpy.context.scene, bpy.context.scene.render
    bpy.context.preferences.view.smooth_view = 0
    yield from turn_and_cut(scene, volume)
    with in_the_view():
        assert bpy.ops.rle_splat.composite() == {"FINISHED"}
    scene.rle_splat.quality, scene.frame_start, scene.frame_end, scene.frame_step = "fine", 1, TURN, STEP
    scene.view_settings.view_transform, render.filepath = "Standard", str(FOLDER / "frame-")
    scene.world = bpy.data.worlds.new("World")  # as in a new file
    render.engine, scene.cycles.samples = "CYCLES", SAMPLES
    render.resolution_x, render.resolution_y, render.image_settings.file_format = 960, 720, "PNG"
    ended, began = [], time.perf_counter()
    bpy.app.handlers.render_complete.append(lambda *_: ended.append(True))
    with in_the_view():
        bpy.ops.render.render("INVOKE_DEFAULT", animation=True)
    while not ended or bpy.app.is_job_running("RENDER"):
        yield
    assert not scene.rle_splat.render_problem, scene.rle_splat.render_problem
    frames = list(map(str, sorted(FOLDER.glob("frame-*.png"))))
    print(f"{len(frames)} frames, {(time.perf_counter() - began) / len(frames):.1f} s each")
    delay, rest = ["-delay", str(CENTISECONDS)], ["-delay", str(REST)]
    first, *between, last = frames
    words = [*rest, first, *delay, *between, *rest, last, *delay, *between[::-1]]
    made = Path(os.environ[SHOTS]) / "how-to-opening.webp"
    subprocess.run(["convert", "-loop", "0", *words, "-resize", SIZE, "-quality", str(QUALITY), "-define",
                    "webp:method=6", str(made)], check=True)  # fmt: skip
    passed("film")


drive(scenario)
