"""A recording for the README in a real window, by simulated mouse and keys: import, preset, Remove Table, a cut, F12.

    python3 dev.py blender --photograph tests/blender/record_readme.py --size 1280x800

writes recording.gif, and pictures of the how-to guides, into build/window-shots/record_readme.  The scan is that of
tests/blender/data/scan, if there is such a folder, else the practice CT.
"""

import os
import subprocess
import sys
import tempfile
from importlib import import_module
from math import radians
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Euler, Vector

from tests.blender.real_blender import MODULE
from tests.blender.user_steps import middle, press, settled, simulate
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
    wait_for_rest,
    window,
)

SCAN = Path(__file__).parent / "data" / "scan"
FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_recording_"))
CENTISECONDS, WIDTH, COLORS = 12, 840, 96  # of a frame
FONT = "/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf"
HOLD = 8  # frames for which a step stands still
TOWARD = (1.45, -1.6, 0.62)  # where the camera is, from the middle of the scan, in sizes of it
NEARER = 0.6  # than Frame, which shows the whole box
HEAD, OPEN, LIVE, RESULT = "790x510+150+230", "690x540+300+200", "560x420+220+255", "840x525+220+163"  # of a frame
STILLS = {  # pictures of the pages: the frames side by side and the part of each; the height in pixels
    "how-to-table": (((3, HEAD), (4, HEAD)), 376), "how-to-presets": (((2, "1280x800+0+0"),), 688),
    "how-to-cut": (((18, OPEN), (23, OPEN)), 467), "how-to-live": (((12, LIVE), (13, LIVE)), 420),
}  # fmt: skip
shown = []  # of each photograph: how long it is shown, in frames, and its caption


def frame(times: int = 1, caption: str = ""):
    """Keep what the window shows at once: a draft, as a user sees it while something moves.

    Without a ``caption`` the one before stays.
    """
    yield from photograph(f"frame-{len(shown):03}")
    shown.append((times, caption or shown[-1][1]))


def drag(button: str, begin, end, steps: int, caption: str = ""):
    """Drag from one pixel of the window to another, a frame for each step."""
    begin, end = np.array(begin, float), np.array(end, float)
    for value, at in (("NOTHING", begin - 1), ("NOTHING", begin)):
        simulate("MOUSEMOVE", value, at)
        yield
    simulate(button, "PRESS", begin)
    yield
    for step in range(1, steps + 1):
        simulate("MOUSEMOVE", "NOTHING", begin + (end - begin) * step / steps)
        yield
        yield from frame(1, caption)
    simulate(button, "RELEASE", end)
    yield
    yield from settled()


def pixel_of(point) -> np.ndarray:
    """Where the view shows a point of the world, in pixels of the window."""
    area = area_of("VIEW_3D")
    region = region_of(area, "WINDOW")
    place = location_3d_to_region_2d(region, area.spaces.active.region_3d, Vector(point))
    return np.array((region.x + place.x, region.y + place.y))


def corners_of(one) -> tuple[Vector, Vector]:
    corners = import_module(f"{MODULE}.bridge.volumes.box").world_corners(one)
    return Vector(corners.min(axis=0)), Vector(corners.max(axis=0))


def studio(volume) -> None:
    """A floor, lamps and a camera for the render, and the viewport through it."""
    sys.path.append(str(Path(__file__).parents[2] / "devtools"))
    from gallery_studio import COLD, Stage, softbox_world

    stage, settings = Stage.of(volume, FOLDER), bpy.context.scene.rle_splat
    stage.camera(TOWARD, lens=74.0, aim=(-0.06, -0.09, -0.03))
    stage.sweep(TOWARD, stage.foot, (0.05, 0.055, 0.065))
    stage.key(2.9, (1.0, -1.6, 1.5))
    stage.area("Rim", 60.0, (-1.6, 1.4, 1.2), COLD)
    softbox_world(((0.02, 0.02, 0.022), (0.05, 0.055, 0.065), (0.25, 0.27, 0.3)), (), 0.6)
    bpy.context.view_layer.objects.active = volume
    volume.rle_splat.lighting, volume.rle_splat.opacity_unit_distance = "SCENE", 0.05
    settings.use_shadows, settings.ambient_occlusion, settings.quality = True, 0.7, "fine"
    view = area_of("VIEW_3D").spaces.active
    view.shading.type, view.overlay.show_extras, view.show_gizmo = "MATERIAL", False, False
    view.shading.use_scene_lights = view.shading.use_scene_world = True
    view.region_3d.view_perspective = "CAMERA"
    with in_the_view():
        bpy.ops.view3d.view_center_camera()


def cut(volume):
    """A box whose left face is dragged by its handle to the middle of the head."""
    with in_the_view():
        assert bpy.ops.rle_splat.add_clip(kind="BOX") == {"FINISHED"}
    box = bpy.context.view_layer.objects.active
    yield from settled()
    yield from frame(3, "Add a box and drag a face")
    before = box.matrix_world.copy()
    face = box.matrix_world @ Vector((1.0, 0.0, 0.0))
    middle_of = sum(corners_of(volume), Vector()) / 2
    yield from drag("LEFTMOUSE", pixel_of(face), pixel_of((middle_of.x, face.y, face.z)), 8)
    assert box.matrix_world != before, "the handle was missed"


def rendered():
    ended = []
    bpy.app.handlers.render_complete.append(lambda *_: ended.append(True))
    yield from press("F12", middle())
    yield from until(lambda: ended and not bpy.app.is_job_running("RENDER"))
    yield
    yield


def scenario():
    # Imported when the extension, which brings pydicom, is installed.
    scan = SCAN
    if not scan.is_dir():
        scan = FOLDER / "practice-ct"
        import_module("devtools.practice_ct").write_series(scan)
    bpy.context.preferences.view.render_display_type = "AREA"
    bpy.context.preferences.system.use_region_overlap = False  # the sidebar stands beside the view
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_display", "RLE_SPLAT_PT_presets", "RLE_SPLAT_PT_clip_objects")
    yield from new_file()
    with bpy.context.temp_override(window=window(), area=area_of("PROPERTIES")):
        bpy.ops.screen.area_close()
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 8, "CPU"
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x, scene.render.resolution_y = 840, 640
    yield from frame(HOLD // 2, "Drop a DICOM folder into Blender")
    with in_the_view():
        assert bpy.ops.rle_splat.import_folder(directory=str(scan)) == {"FINISHED"}
    volume, view = bpy.context.view_layer.objects.active, area_of("VIEW_3D").spaces.active.region_3d
    view.view_rotation = Euler((radians(76.0), 0.0, radians(-30.0))).to_quaternion()
    view.view_distance *= NEARER
    yield from settled()
    yield from frame(HOLD)
    yield from wait_for_rest()  # with the pictures of presets
    for preset, caption in (("x-ray", "Click a preset"), ("ct-bone", "")):
        with in_the_view():
            assert bpy.ops.rle_splat.apply_preset(preset=preset) == {"FINISHED"}
        yield from settled()
        yield from frame(HOLD, caption)
    with in_the_view():
        assert bpy.ops.rle_splat.remove_table() == {"FINISHED"}
    yield from settled()
    yield from frame(HOLD, "Remove the table")
    yield from drag("MIDDLEMOUSE", middle(100.0), middle(-70.0), 8, "Turn the view: it is live")
    yield from frame(3)
    yield from cut(volume)
    yield from frame(HOLD)
    studio(volume)
    with in_the_view():
        assert bpy.ops.rle_splat.composite() == {"FINISHED"}
    yield from settled()
    yield from frame(HOLD, "Add lamps, a floor and a camera")
    yield from rendered()
    yield from frame(2 * HOLD, "F12")
    save()
    passed("recording")


def save() -> None:
    """Put the photographs together as a GIF that begins with the last one, and some as pictures of the guides."""
    folder = Path(os.environ[SHOTS])
    pictures = []
    for number, (times, caption) in enumerate(shown):
        path = folder / f"captioned-{number:03}.png"
        words = ["-resize", f"{WIDTH}x", "-font", FONT, "-gravity", "SouthWest", "-pointsize", "22", "-fill", "white",
                 "-undercolor", "#000c", "-annotate", "+44+26", f" {caption} "]  # fmt: skip
        crop = ["-crop", RESULT, "+repage"] if number == len(shown) - 1 else []
        subprocess.run(["convert", str(folder / f"frame-{number:03}.png"), *crop, *words, str(path)], check=True)
        pictures.append((times, str(path)))
    frames = [word for times, path in (pictures[-1], *pictures)
              for word in ("-delay", str(CENTISECONDS * times), path)]  # fmt: skip
    words = ["+dither", "-colors", str(COLORS), "-layers", "Optimize"]
    subprocess.run(["convert", "-loop", "0", *frames, *words, str(folder / "recording.gif")], check=True)
    for name, (parts, height) in STILLS.items():
        words = [word for number, part in parts
                 for word in ("(", str(folder / f"frame-{number:03}.png"), "-crop", part, "+repage",
                              "-resize", f"x{height}", ")")]  # fmt: skip
        subprocess.run(["convert", *words, "+append", "-quality", "82", str(folder / f"{name}.jpg")], check=True)


drive(scenario)
