"""A tour by mouse and keys through all that a user does, again and again for some minutes, in a real window.

    python3 dev.py blender --photograph tests/blender/long_tour.py --size 1600x1000

A job of its own, which takes RLE_SPLAT_TOUR minutes, ten if that is not set.  Nothing may print a traceback.  It prints
how many redraws of ours took longer than 30 ms of processor time, and the largest resident memory until each round.
"""

import os
import resource
import tempfile
import time
from importlib import import_module
from pathlib import Path

import bpy
import numpy as np

from tests.blender import scenes
from tests.blender.user_steps import drag, middle, press, settled
from tests.blender.window_driver import (
    MODULE,
    area_of,
    drive,
    in_the_view,
    new_file,
    passed,
    photograph,
    region_of,
    until,
    window,
)

MINUTES = float(os.environ.get("RLE_SPLAT_TOUR", "10"))
FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_tour_"))
SIDE, SLOW = 24, 0.03  # voxels; seconds of a redraw
_redraws: list = []  # seconds of processor time of each redraw of ours


def watch_redraws():
    """Note what each redraw of a viewport takes in its handler."""
    viewports = import_module(f"{MODULE}.bridge.live.viewport")
    redraw = viewports.Viewport.redraw

    def timed(self, *arguments):
        began = time.thread_time()
        redraw(self, *arguments)
        _redraws.append(time.thread_time() - began)

    viewports.Viewport.redraw = timed


def resident() -> float:
    """MiB that this process had in memory at most."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def add_volume(name: str, radius: float, labels: int):
    """A ball with so many labels, of names of their own."""
    away = np.sqrt(sum((axis - SIDE / 2) ** 2 for axis in np.ogrid[:SIDE, :SIDE, :SIDE]))
    owner = scenes.import_raw(FOLDER, np.clip(250.0 - 100.0 * away / radius, 0.0, 255.0).astype(np.uint8), name=name)
    path = FOLDER / f"{name} labels.raw"
    np.minimum(away / SIDE * 2.0 * labels, labels).astype(np.uint8).tofile(path)
    owner.rle_splat.label_file = str(path)
    assert bpy.ops.rle_splat.read_labels() == {"FINISHED"}
    assert len(owner.rle_splat.labels) >= labels
    return owner


def orbit(count=4):
    yield from drag("MIDDLEMOUSE", middle(), [(25, 8), (-30, 4)] * count)


def look(number: int):
    """Import two volumes with different labels, frame and orbit them, and look from the front."""
    with in_the_view():
        first = add_volume(f"first {number % 3}", 6.0, 2)
        second = add_volume(f"second {number % 3}", 4.0, 3)
        second.location.x += SIDE
        scenes.activate(first)
        bpy.ops.rle_splat.frame_volume()
        bpy.ops.ed.undo_push(message="tour")
    yield from settled()
    yield from orbit()
    yield from press("NUMPAD_1", middle())
    yield from settled()
    return first.name, second.name


def edit(name: str):
    """Drag a slider, hide a label, move the volume by G, and undo all of it by Ctrl+Z."""
    owner = bpy.data.objects[name]
    for shift in np.linspace(-10.0, 10.0, 6):  # values
        owner.rle_splat.shift_by = shift
        yield
    owner.rle_splat.labels[1].show = False
    with in_the_view():
        bpy.ops.ed.undo_push(message="edit")
    yield from settled()
    yield from press("G", middle())
    window().event_simulate(type="MOUSEMOVE", value="NOTHING", x=int(middle(60)[0]), y=int(middle()[1]))
    yield
    yield from press("RET", middle(60))
    for _ in range(2):
        at = [int(n) for n in middle()]
        window().event_simulate(type="Z", value="PRESS", x=at[0], y=at[1], ctrl=True)
        window().event_simulate(type="Z", value="RELEASE", x=at[0], y=at[1], ctrl=True)
        yield
    yield from settled()


def split():
    """A quad view, and a second window, both orbited and closed again."""
    with in_the_view():
        bpy.ops.screen.region_quadview()
    yield
    yield from orbit(2)
    with in_the_view():
        bpy.ops.screen.region_quadview()
        bpy.ops.wm.window_new()
    yield
    yield from orbit(2)
    other = bpy.context.window_manager.windows[-1]
    with bpy.context.temp_override(window=other):
        bpy.ops.wm.window_close()
    yield


def f12(name: str):
    """Render by F12 with slices and a backdrop."""
    done = []
    bpy.context.preferences.view.render_display_type = "NONE"
    with in_the_view():
        scenes.activate(bpy.data.objects[name])
        bpy.ops.rle_splat.add_slice(kind="axial")
        scenes.activate(bpy.data.objects[name])
        if bpy.context.scene.camera is None:
            scenes.add_camera((SIDE / 2, -80.0, SIDE / 2), (np.pi / 2, 0.0, 0.0))
        scenes.use_cycles((64, 48))
        assert bpy.ops.rle_splat.composite() == {"FINISHED"}
        bpy.app.handlers.render_complete.append(lambda *_: done.append(True))
        bpy.ops.render.render("INVOKE_DEFAULT")
    yield from until(lambda: done and not bpy.app.is_job_running("RENDER"))
    bpy.app.handlers.render_complete.pop()
    assert not bpy.context.scene.rle_splat.render_problem, bpy.context.scene.rle_splat.render_problem
    yield from settled()


def save_elsewhere(number: int):
    """Save As in another folder, undo after it, and open the file."""
    folder = FOLDER / f"place {number % 2}"
    folder.mkdir(exist_ok=True)
    with in_the_view():
        for step in ("rendered", "before saving"):  # so that undo does not go back beyond the import
            bpy.ops.ed.undo_push(message=step)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "tour.blend"))
    yield
    with in_the_view():
        bpy.ops.ed.undo()
    yield from settled()
    assert import_module(f"{MODULE}.bridge.live").problem_of(area_of("VIEW_3D")) == ""
    bpy.ops.wm.open_mainfile(filepath=str(folder / "tour.blend"))
    yield
    area_of("VIEW_3D").tag_redraw()
    yield from settled()


def scenario():
    watch_redraws()
    until_then, number, memory = time.monotonic() + 60.0 * MINUTES, 0, []
    while time.monotonic() < until_then or number < 1:
        yield from new_file()
        region_of(area_of("VIEW_3D"), "WINDOW")
        first, second = yield from look(number)
        yield from edit(second)
        yield from split()
        yield from f12(first)
        if number == 0:
            yield from photograph("tour")
        yield from save_elsewhere(number)
        number += 1
        memory.append(resident())
        slow = sum(spent > SLOW for spent in _redraws)
        print(f"round {number}: {memory[-1]:.0f} MiB, {len(_redraws)} redraws, {slow} above {1e3 * SLOW:.0f} ms, "
              f"median {1e3 * np.median(_redraws):.1f}, longest {1e3 * max(_redraws):.0f} ms", flush=True)
    passed("the tour")


drive(scenario)
