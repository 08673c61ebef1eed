"""Where the time of a redraw of the live viewport goes: a table for a draft, an unchanged redraw and an edit.

    python3 dev.py blender --photograph tests/blender/record_times.py --size 1280x800

prints medians in milliseconds, for a scan of 256 voxels along each side with a mesh inside, in Solid shading with
overlays; then the walk of an edit, from Blender's event to the redraw, and our functions in an idle second; then among
meshes of 100,352 triangles with scene lights and shadows.  Times are processor time of the main thread, but for the
stages of a picture, which are of the clock.  It asserts no time: what a software driver draws takes
longer than on any graphics card.
"""

import sys
import tempfile
import time
from collections import Counter, defaultdict
from math import radians
from pathlib import Path

import bpy
import numpy as np
from mathutils import Euler

from tests.blender.scenes import module
from tests.blender.user_steps import settled, viewport
from tests.blender.window_driver import area_of, drive, in_the_view, new_file, passed, photograph, window

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_times_"))
SIDE, REDRAWS, WARM = 256, 12, 4
# Parts of a redraw: module of bridge.live, class or "", function.  "depth" holds the one below it.
PARTS = {
    "request": ("surface", "", "request_of"),
    "contents": ("surface", "BlenderSurface", "contents"),
    "depth": ("surface", "BlenderSurface", "ends"),
    "depth to ray ends": ("surface", "", "ray_ends"),
    "compare depths": ("viewport", "", "differ"),
    "place": ("viewport", "", "shot_of"),
    "coarser depths": ("frames", "", "furthest_of_blocks"),
    "upload": ("drawing", "", "texture_of"),
    "draw": ("drawing", "", "draw"),
}


def live(name=""):
    return module(f"bridge.live{'.' if name else ''}{name}")


class Meter:
    """Milliseconds by part of each handler call that drew."""

    def __init__(self):
        self.calls, self.now = [], defaultdict(float)

    def timing(self, name, function):
        def timed(*arguments, **options):
            began = time.thread_time()
            try:
                return function(*arguments, **options)
            finally:
                self.now[name] += 1e3 * (time.thread_time() - began)

        return timed

    def steps(self, function):
        """A picture's steps, the time of which counts for the stages of its report."""

        def timed(*arguments, **options):
            began, work = time.thread_time(), function(*arguments, **options)
            rendering, halvings = yield from work
            self.now["picture"] += 1e3 * (time.thread_time() - began)
            for stage, spent in rendering.report["stages_ms"].items():
                if stage != "total":
                    self.now[f"clock, {stage}"] += spent
            return rendering, halvings

        return timed

    def watch(self):
        """Put clocks around all parts, and one around the two handlers."""
        for name, (part, owner, function) in PARTS.items():
            place = getattr(live(part), owner) if owner else live(part)
            setattr(place, function, self.timing(name, getattr(place, function)))
        live("frames").fitting_steps = self.steps(live("frames").fitting_steps)
        ours = live()
        before, after = ours._before, ours._after

        def timed_after():
            drawn, began = ours.calls["drawn"], time.thread_time()
            after()
            self.now["handler"] += 1e3 * (time.thread_time() - began)
            if ours.calls["drawn"] > drawn:
                self.calls.append(dict(self.now))
            self.now.clear()

        ours._before, ours._after = self.timing("handler", before), timed_after

    def table(self, title: str, counts, wanted) -> None:
        """Print the medians and the least of those calls since the last table for which ``wanted(call)``."""
        calls, self.calls = [call for call in self.calls[WARM:] if wanted(call)], []
        names = sorted({name for call in calls for name in call}, key=lambda name: (name != "handler", name))
        print(f"\n{title}: {len(calls)} calls, {counts}", flush=True)
        print(f"  {'':28s}  median     least", flush=True)
        for name in names:
            found = [call.get(name, 0.0) for call in calls]
            if max(found) >= 0.05:
                print(f"  {name:28s} {np.median(found):7.2f}   {np.min(found):7.2f}", flush=True)


def phantom() -> Path:
    """A scan in Hounsfield units: skin, a skull, and branches of a vessel in it."""
    z, y, x = (np.mgrid[:SIDE, :SIDE, :SIDE].astype(np.float32) - (SIDE - 1) / 2) / (SIDE / 2)
    apart = np.sqrt((x / 0.7) ** 2 + (y / 0.85) ** 2 + (z / 0.8) ** 2)
    values = np.where(apart < 1.0, np.float32(40.0), np.float32(-1000.0))
    values[(apart < 0.92) & (apart > 0.82)] = 900.0
    branches = (np.abs(np.sin(9.0 * x) * np.cos(7.0 * y) + np.sin(8.0 * z)) < 0.12) & (apart < 0.8)
    values[branches] = 300.0
    path = FOLDER / f"head_{SIDE}x{SIDE}x{SIDE}_int16.raw"
    values.astype(np.int16).tofile(path)
    return path


def set_up():
    yield from new_file()
    with in_the_view():
        assert bpy.ops.rle_splat.import_volume(
            filepath=str(phantom()), value_unit="HU", modality="CT", spacing=(1.0, 1.0, 1.0)
        ) == {"FINISHED"}
        bpy.ops.mesh.primitive_uv_sphere_add(radius=0.05, location=(0.06, 0.03, 0.13))
    volume = next(one for one in bpy.data.objects if one.rle_splat.is_volume)
    bpy.context.view_layer.objects.active = volume
    area_of("VIEW_3D").spaces.active.show_region_ui = False
    yield from settled()
    return volume


def redrawn() -> None:
    """Redraw at once, so that no timer works between."""
    with in_the_view():
        area_of("VIEW_3D").tag_redraw()
        bpy.ops.wm.redraw_timer(type="DRAW", iterations=1)


def walk_of(act) -> list:
    """Modules of the bridge that are entered meanwhile, one after the other: its package and name, and the function."""
    found = []

    def note(frame, event, _argument):
        _, _, place = frame.f_code.co_filename.partition("/rle_splat/bridge/")
        if event == "call" and place and (not found or found[-1][0] != place):
            found.append((place, frame.f_code.co_name))

    sys.setprofile(note)
    try:
        act()
    finally:
        sys.setprofile(None)
    return found


def among_meshes(meter):
    """A sun that casts shadows, and a grid of many triangles beneath the scan."""
    with in_the_view():
        bpy.ops.mesh.primitive_grid_add(x_subdivisions=224, y_subdivisions=224, size=1.0, location=(0.0, 0.0, -0.02))
        bpy.ops.object.light_add(type="SUN", rotation=(0.7, 0.3, 0.0))
    settings = bpy.context.scene.rle_splat
    volume = next(one for one in bpy.data.objects if one.rle_splat.is_volume)
    settings.lighting, settings.use_shadows = "SCENE", True  # of all volumes
    bpy.context.view_layer.objects.active = volume
    yield from settled()
    meter.calls.clear()
    for _ in range(2):  # the first time, kernels are loaded
        yield from turn(meter, "draft redraw among 100,352 triangles, scene lights and shadows")
        yield from settled()
    meter.calls.clear()
    before = viewport().counts.copy()
    for _ in range(REDRAWS):
        viewport()._checked = -np.inf  # as half a second after the last look
        redrawn()
    meter.table("look at unchanged triangles", viewport().counts - before, lambda call: "contents" in call)


def follow_an_edit(volume):
    """Print the walk of a curve's point that was moved, from Blender's event to the end of the redraw."""
    curve = volume.rle_splat.transfer.nodes
    curve = next(node.mapping for node in curve if node.bl_idname == "ShaderNodeFloatCurve")
    curve.curves[0].points[0].location[1] += 0.01
    curve.update()
    volume.rle_splat.transfer.update_tag()

    def act():
        bpy.context.view_layer.update()
        redrawn()

    walk = walk_of(act)
    print(f"\nwalk of an edit: {len(walk)} stops, {len({place for place, _ in walk})} modules", flush=True)
    for place, function in walk:
        print(f"  {place}: {function}", flush=True)


def rest():
    """Print our functions that Blender calls in a second without edits, with a backdrop that follows the scene."""
    with in_the_view():
        bpy.ops.object.camera_add(location=(0.13, -0.6, 0.13), rotation=(radians(90.0), 0.0, 0.0))
        bpy.context.scene.camera = bpy.context.object
        bpy.context.view_layer.objects.active = next(one for one in bpy.data.objects if one.rle_splat.is_volume)
        assert bpy.ops.rle_splat.preview_in_camera_view(follow=True) == {"FINISHED"}
    yield from settled()
    timer = module("bridge.loop.timer")
    while bpy.app.timers.is_registered(timer._tick):
        yield
    found, end = Counter(), time.perf_counter() + 1.0

    def note(frame, event, _argument):
        if event == "call" and "/rle_splat/" in frame.f_code.co_filename:
            found[frame.f_code.co_filename.partition("/rle_splat/")[2] + ": " + frame.f_code.co_name] += 1

    sys.setprofile(note)
    while time.perf_counter() < end:
        yield
    sys.setprofile(None)
    print(f"\nidle second: {found.total()} calls {dict(found)}", flush=True)


def has_picture(call: dict) -> bool:
    """Whether a picture was finished in a call; a draft that takes longer than a bite ends in a timer."""
    return "picture" in call


def turn(meter, title="draft redraw"):
    space = area_of("VIEW_3D").spaces.active
    before = viewport().counts.copy()
    for n in range(REDRAWS):
        space.region_3d.view_rotation = Euler((radians(70.0), 0.0, radians(20.0 + 2.0 * n))).to_quaternion()
        redrawn()
        yield
    meter.table(title, viewport().counts - before, has_picture)
    print(f"coarseness {viewport()._coarseness}, region {viewport()._request.matrices.width} x "
          f"{viewport()._request.matrices.height}", flush=True)  # fmt: skip


def scenario():
    window()
    volume = yield from set_up()
    meter = Meter()
    meter.watch()
    for quality in ("first", "again"):
        yield from turn(meter)
        yield from settled()
        yield from photograph(f"turned_{quality}")
    meter.calls.clear()
    before = viewport().counts.copy()
    for _ in range(REDRAWS):
        redrawn()
    meter.table("unchanged redraw", viewport().counts - before, lambda call: "contents" not in call)
    yield from settled()
    before = viewport().counts.copy()
    for n in range(REDRAWS):
        volume.rle_splat.window_center += 1.0 if n % 2 else -1.0
        bpy.context.view_layer.update()
        redrawn()
        yield
    meter.table("edit of the transfer function", viewport().counts - before, has_picture)
    yield from settled()
    follow_an_edit(volume)
    yield from settled()
    yield from rest()
    yield from among_meshes(meter)
    yield from photograph("among_meshes")
    passed("times")


drive(scenario)
