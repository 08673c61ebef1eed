"""A tour by mouse and keys through all that a user does, again and again for some minutes, in a real window.

    python3 dev.py blender --photograph tests/blender/long_tour.py --size 1600x1000

A job of its own, which takes RLE_SPLAT_TOUR minutes, ten if that is not set.  Nothing may print a traceback.  It prints
the memory after each round with the types of objects that have become more, and the parts of each redraw that took us
longer than 30 ms of processor time.  Its own notes are arrays, so that they do not count as blocks of Python.
"""

import gc
import os
import resource
import sys
import tempfile
import time
from array import array
from collections import Counter
from pathlib import Path

import bpy
import gpu
import numpy as np

from tests.blender import scenes
from tests.blender.scenes import module
from tests.blender.user_steps import drag, middle, press, settled
from tests.blender.window_driver import (
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
# What a redraw consists of: module of bridge.live, name, and what it is called in a line.  What is left of "depth" is
# the driver's: reading waits until it has drawn what Blender asked for, on a software driver in the same thread.
PARTS = (
    ("surface", "request_of", "request"), ("surface", "BlenderSurface.contents", "contents"),
    ("surface", "BlenderSurface.ends", "depth"), ("surface", "ray_ends", "ray ends"),
    ("viewport", "shot_of", "cut"), ("viewport", "Viewport._advance", "draft"),
    ("drawing", "texture_of", "upload"), ("drawing", "draw", "quads"),
)  # fmt: skip
_redraws, _with_driver = array("d"), array("d")  # seconds of processor time that are ours, and with the driver's
_steps = array("d")  # seconds of processor time of each call of the one timer
_longest_step = [0.0, ""]  # and its function
_parts: dict = {}  # of the redraw that runs: name -> seconds of processor time
_longest: dict = {}  # of the redraw or the call of the timer that runs: steps from where to where -> the longest
_doing = [""]  # what the user does


def watch_redraws():
    """Note what each redraw of a viewport takes in our two draw handlers, in processor time of its thread."""
    live = module("bridge.live")

    def timed(function, name):
        def call(*arguments, **named):
            began = time.thread_time()
            try:
                return function(*arguments, **named)
            finally:
                _parts[name] = _parts.get(name, 0.0) + time.thread_time() - began

        return call

    def begin_redraw():
        _parts.clear()  # of the timer's work since the last redraw
        _longest.clear()
        before()

    def note_redraw():
        drawn = live.calls["drawn"]
        after()
        if live.calls["drawn"] > drawn:
            driver = _parts.get("depth", 0.0) - _parts.get("ray ends", 0.0)
            _with_driver.append(_parts["before"] + _parts["after"])
            _redraws.append(_with_driver[-1] - driver)
            if _redraws[-1] > SLOW:
                listed = ", ".join(f"{name} {1e3 * part:.1f}" for name, part in _parts.items())
                print(f"slow: {1e3 * _redraws[-1]:.0f} ms and the driver {1e3 * driver:.0f}, {_doing[0]}: {listed}; "
                      f"{list_longest()}", flush=True)  # fmt: skip

    for part, name, called in PARTS:
        place = module(f"bridge.live.{part}")
        *owner, name = name.split(".")
        place = getattr(place, owner[0]) if owner else place
        setattr(place, name, timed(getattr(place, name), called))
    before, after = timed(live._before, "before"), timed(live._after, "after")
    live._before, live._after = begin_redraw, note_redraw


def list_longest() -> str:
    """The three longest steps, in milliseconds."""
    found = sorted(_longest.items(), key=lambda part: -part[1])[:3]
    return "; ".join(f"{part} {1e3 * seconds:.0f}" for part, seconds in found)


def watch_steps():
    """Note what each call of the one timer takes, whom it calls, and which of its parts took longest."""
    timer = module("bridge.loop.timer")
    tick, shares = timer._tick, {}

    def note(name, seconds):
        _longest[name] = max(_longest.get(name, 0.0), seconds)

    def place_of(steps):
        """Where a generator waits: the innermost function and its line."""
        frame = None
        while (inner := getattr(steps, "gi_frame", None)) is not None:
            frame = inner
            steps = steps.gi_yieldfrom or frame.f_locals.get("steps")
        return f"{frame.f_code.co_name}:{frame.f_lineno}" if frame is not None else "its end"

    def timed_steps(function):
        def call(*arguments, **named):
            steps, message = function(*arguments, **named), "the beginning"
            while True:
                begin, began = place_of(steps), time.thread_time()
                try:
                    progress = next(steps)
                except StopIteration as finished:
                    note(f"after {message} from {begin} to its end", time.thread_time() - began)
                    return finished.value
                note(f"after {message} from {begin} to {place_of(steps)}", time.thread_time() - began)
                message = progress.message
                yield progress

        return call

    def summed(function, name):
        def call(*arguments, **named):
            began = time.thread_time()
            try:
                return function(*arguments, **named)
            finally:
                shares[name] = shares.get(name, 0.0) + time.thread_time() - began

        return call

    def timed_tick():
        function = min(timer._due, key=timer._due.get, default=tick)
        _longest.clear()
        shares.clear()
        began, start = time.thread_time(), time.perf_counter()
        again = tick()
        spent, wall = time.thread_time() - began, time.perf_counter() - start
        name = f"{function.__module__.rpartition('.')[2]}.{function.__name__}"
        _steps.append(spent)
        _longest_step[:] = max(_longest_step, [spent, name])
        if spent > SLOW:
            listed = [list_longest(), *(f"{part} {1e3 * seconds:.0f}" for part, seconds in shares.items())]
            print(f"slow step: {1e3 * spent:.0f} ms ({1e3 * wall:.0f} by the clock), {_doing[0]}, {name}: "
                  f"{'; '.join(listed)}", flush=True)  # fmt: skip
        return again

    def note_garbage(phase, _info, began=[0.0]):  # noqa: B006
        if phase == "start":
            began[0] = time.thread_time()
        else:
            shares["garbage"] = shares.get("garbage", 0.0) + time.thread_time() - began[0]

    gc.callbacks.append(note_garbage)
    for part, name in (("live.viewport", "picture_steps"), ("loop.work.loading", "load_steps")):
        place = module(f"bridge.{part.removesuffix('.loading')}")
        place = getattr(place, "loading", place) if part.endswith("loading") else place
        setattr(place, name, timed_steps(getattr(place, name)))
    cache = module("rle_splat.runtime.kernel_cache").KernelCache
    cache.load_overload = summed(cache.load_overload, "loading kernels")
    live = module("bridge.live")
    live._find_mesh_before = summed(live._find_mesh_before, "mesh before")
    timer.stop_all()
    timer._tick = timed_tick


def time_driver():
    """Print what reading depth waits for in a file without a volume, while the view turns."""
    spent = []

    def read():
        region = bpy.context.region
        buffer = gpu.types.Buffer("FLOAT", (region.height, region.width))
        began = time.thread_time()
        framebuffers[-1].read_depth(0, 0, region.width, region.height, data=buffer)
        spent.append(time.thread_time() - began)

    framebuffers = []
    space = bpy.types.SpaceView3D
    handles = [space.draw_handler_add(lambda: framebuffers.append(gpu.state.active_framebuffer_get()), (), "WINDOW",
                                      "PRE_VIEW"), space.draw_handler_add(read, (), "WINDOW", "POST_VIEW")]  # fmt: skip
    with in_the_view():
        bpy.ops.mesh.primitive_uv_sphere_add()
    yield from orbit()
    for handle in handles:
        space.draw_handler_remove(handle, "WINDOW")
    print(f"the driver without a volume: {len(spent)} redraws, median {1e3 * np.median(spent):.0f} ms, "
          f"longest {1e3 * max(spent):.0f} ms", flush=True)  # fmt: skip


def memory() -> tuple:
    """MiB: resident at most so far, and held by the extension's store and stages."""
    held = module("bridge.scene.render_scene").KEPT.nbytes
    held += module("bridge.loop.store").nbytes()
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0, held / 2.0**20


def grown(before: Counter) -> str:
    """Types of which there are more objects than before, the most first; ``before`` becomes the counts of now."""
    now = Counter(type(one).__name__ for one in gc.get_objects())
    more = (now - before).most_common(4) if before else []
    before.clear()
    before.update(now)
    return ", ".join(f"{count} {name}" for name, count in more)


def add_volume(name: str, radius: float, labels: int):
    """A ball with so many labels, of names of their own."""
    away = np.sqrt(sum((axis - SIDE / 2) ** 2 for axis in np.ogrid[:SIDE, :SIDE, :SIDE]))
    owner = scenes.import_raw(FOLDER, np.clip(250.0 - 100.0 * away / radius, 0.0, 255.0).astype(np.uint8), name=name)
    path = FOLDER / f"{name} labels.raw"
    np.minimum(away / SIDE * 2.0 * labels, labels).astype(np.uint8).tofile(path)
    owner.rle_splat.label_file = str(path)
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
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
        bpy.ops.rle_splat.add_slice(kind="AXIAL")
        scenes.activate(bpy.data.objects[name])
        if bpy.context.scene.camera is None:
            scenes.add_camera((SIDE / 2, -80.0, SIDE / 2), (np.pi / 2, 0.0, 0.0))
        scenes.use_cycles((64, 48))
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
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
    assert module("bridge.live").problem_of(area_of("VIEW_3D")) == ""
    bpy.ops.wm.open_mainfile(filepath=str(folder / "tour.blend"))
    yield
    area_of("VIEW_3D").tag_redraw()
    yield from settled()


def scenario():
    yield from new_file()
    yield from time_driver()
    watch_redraws()
    watch_steps()
    until_then, number, objects = time.monotonic() + 60.0 * MINUTES, 0, Counter()
    while time.monotonic() < until_then or number < 1:
        yield from new_file()
        region_of(area_of("VIEW_3D"), "WINDOW")
        _doing[0] = "look"
        first, second = yield from look(number)
        _doing[0] = "edit"
        yield from edit(second)
        _doing[0] = "split"
        yield from split()
        _doing[0] = "f12"
        yield from f12(first)
        if number == 0:
            yield from photograph("tour")
        _doing[0] = "save_elsewhere"
        yield from save_elsewhere(number)
        number += 1
        gc.collect()
        resident, held = memory()
        ours, all_of, steps = (np.array(one) for one in (_redraws, _with_driver, _steps))
        print(f"round {number}: {resident:.0f} MiB at most, {held:.0f} held by us, "
              f"{sys.getallocatedblocks()} blocks of Python; {len(ours)} redraws, {np.sum(ours > SLOW)} above "
              f"{1e3 * SLOW:.0f} ms, median {1e3 * np.median(ours):.1f}, longest {1e3 * ours.max():.0f} ms; "
              f"with the driver {np.sum(all_of > SLOW)} above; {len(steps)} steps, {np.sum(steps > SLOW)} above, "
              f"longest {1e3 * steps.max():.0f} ms, {_longest_step[1]}; more objects: {grown(objects)}",
              flush=True)  # fmt: skip
    passed("the tour")


drive(scenario)
