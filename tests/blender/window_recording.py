"""The live viewport in motion, as a GIF for the documentation: the view turns about a head, then a box cuts it open.

    python3 dev.py blender --photograph tests/blender/window_animation.py --size 1280x800

keeps it as build/window-shots/window_animation/live-viewport.gif.
"""

import os
import subprocess
import tempfile
from importlib import import_module
from math import radians
from pathlib import Path

import bpy
from mathutils import Euler, Vector

from tests.blender.user_steps import settled
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
)

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_animation_")) / "practice-ct"
TURN, CUT = 30, 12  # frames
NEARER = 0.65  # than Frame, which shows the whole box
CENTISECONDS, WIDTH, COLORS = 9, 640, 128  # of a frame


def look_from(turn: float) -> None:
    view = area_of("VIEW_3D").spaces.active.region_3d
    view.view_rotation = Euler((radians(78.0), 0.0, radians(turn))).to_quaternion()


def frame(number: int):
    """Keep what the window shows at once: a draft, as a user sees it while the view moves."""
    yield from photograph(f"frame-{number:02}")


def scenario():
    # Imported when the extension, which brings pydicom, is installed.
    import_module("devtools.practice_ct").write_series(FOLDER)
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_display")
    yield from new_file()
    with in_the_view():
        assert bpy.ops.rle_splat.import_folder(directory=str(FOLDER)) == {"FINISHED"}
        assert bpy.ops.rle_splat.apply_preset(preset="ct-skin-and-bone") == {"FINISHED"}
    look_from(25.0)
    area_of("VIEW_3D").spaces.active.region_3d.view_distance *= NEARER
    yield from settled()
    for number in range(TURN):
        look_from(25.0 + 360.0 * number / TURN)
        yield from frame(number)
    with in_the_view():
        assert bpy.ops.rle_splat.add_clip(kind="BOX") == {"FINISHED"}
    box = bpy.context.view_layer.objects.active
    box.rle_splat.clip_keep = "OUTSIDE"
    look_from(25.0)
    goal = box.location + Vector((0.095, -0.115, 0.125))  # the left, front and upper eighth of the head
    for number in range(CUT):
        box.location = goal + (1.0 - (number + 1) / CUT) * Vector((0.0, -0.1, 0.1))
        yield from frame(TURN + number)
    yield from settled()
    for number in range(TURN + CUT, TURN + 2 * CUT):
        yield from frame(number)  # still, so that the cut can be seen
    save()
    passed("animation")


def save() -> None:
    """Put the photographs together, cut to the viewport, and remove them."""
    folder, region = Path(os.environ[SHOTS]), region_of(area_of("VIEW_3D"), "WINDOW")
    screen = bpy.context.window_manager.windows[0].height
    cut = f"{region.width}x{region.height}+{region.x}+{screen - region.y - region.height}"
    frames = sorted(folder.glob("frame-*.png"))
    words = ["-crop", cut, "+repage", "-resize", f"{WIDTH}x", "+dither", "-colors", str(COLORS), "-layers", "Optimize"]
    goal = folder / "live-viewport.gif"
    subprocess.run(["convert", "-delay", str(CENTISECONDS), "-loop", "0", *map(str, frames), *words, str(goal)],
                   check=True)
    for one in frames:
        one.unlink()


drive(scenario)
