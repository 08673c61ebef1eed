"""A recording for the README in a real window, by simulated mouse and keys: import, preset, cut, gray values, F12.

    python3 dev.py blender --photograph tests/blender/record_readme.py --size 920x700

writes recording.webp into build/window-shots/record_readme.  The scan is that of
tests/blender/data/scan, files named *.dcm, if there is such a folder, else the practice CT.  An arrow is drawn where
the simulated mouse is.  Every frame shows a refined picture: what was waited for is cut out.
"""

import os
import shutil
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

from tests.blender.guide_steps import arrow
from tests.blender.scenes import module
from tests.blender.user_steps import find_button, middle, press, scroll_sidebar, settled, simulate
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
SHOWN = Path("/scans/Head CT")  # of the small system: a path that a reader could have
FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_recording_"))
CENTISECONDS, HOLD = 7, 20  # of a frame; frames for which a step stands still
QUALITY = 84
FONT = "/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf"
STEPS, DOWN, FURTHER = 22, 12, 5  # of a drag; turns of the wheel to Cut, and to its lower buttons
TOWARD = (-1.5, -1.55, 0.66)  # where the camera is, from the middle of the scan, in sizes of it
NEARER = 0.42  # than Frame, which shows the whole box
OPAQUE, SHIFT, GROW, SMOOTH = 0.05, -100.0, 2.0, 2.0  # mm, HU, mm, mm: thin walls are whole and opaque
COLUMNS = 45, 105, 190  # of buttons, pixels from the sidebar's right edge
LEVEL, WINDOW = 400.0, 1000.0  # HU, of the values on the cut
RIGHT = 320  # of the dialogs, which the captions leave free, in pixels
OPEN = "480x500+90+150"  # of a frame
# Over the seconds that a render took, which are those of a busy machine: the background beside them.
NO_SECONDS = "( +clone -crop 300x22+400+55 +repage ) -geometry +12+55 -composite".split()
shown = []  # of each photograph: how long it is shown, in frames, its caption, and the pixel of the mouse
mouse = []


def point(kind: str, value: str, at) -> None:
    """Simulate an event of the mouse, and remember where."""
    simulate(kind, value, at)
    mouse[:] = at


def frame(times: int = 1, caption: str = ""):
    """Keep what the window shows.  Without a ``caption`` the one before stays."""
    yield from photograph(f"frame-{len(shown):03}")
    shown.append((times, caption or shown[-1][1], tuple(mouse)))


def drag(button: str, begin, end, caption: str, steps: int = STEPS):
    """Drag from one pixel of the window to another, a frame for each step."""
    begin, end = np.array(begin, float), np.array(end, float)
    for at in (begin - 1, begin):
        point("MOUSEMOVE", "NOTHING", at)
        yield
    yield from frame(4, caption)
    point(button, "PRESS", begin)
    yield
    for step in range(1, steps + 1):
        point("MOUSEMOVE", "NOTHING", begin + (end - begin) * step / steps)
        yield
        yield from settled()
        yield from frame()
    point(button, "RELEASE", end)
    yield
    yield from settled()


def click(command: str, argument: str, caption: str):
    """Press a button of the sidebar."""
    at = yield from find_button(command, argument, COLUMNS)
    point("MOUSEMOVE", "NOTHING", at)
    yield from frame(HOLD // 3, caption)
    yield from press("LEFTMOUSE", at)
    yield from settled()


def pixel_of(place) -> np.ndarray:
    """Where the view shows a point of the world, in pixels of the window."""
    area = area_of("VIEW_3D")
    region = region_of(area, "WINDOW")
    found = location_3d_to_region_2d(region, area.spaces.active.region_3d, Vector(place))
    return np.array((region.x + found.x, region.y + found.y))


def corners_of(one) -> tuple[Vector, Vector]:
    corners = module("bridge.volumes.box").world_corners(one)
    return Vector(corners.min(axis=0)), Vector(corners.max(axis=0))


def studio(volume) -> None:
    """A floor, lights and a camera for the render, and the viewport through it."""
    sys.path.append(str(Path(__file__).parents[2] / "devtools"))
    from gallery_studio import COLD, Stage, softbox_world

    stage, settings = Stage.of(volume, FOLDER), bpy.context.scene.rle_splat
    stage.camera(TOWARD, lens=60.0, aim=(0.04, -0.06, -0.07))
    stage.sweep(TOWARD, stage.foot, (0.05, 0.055, 0.065))
    stage.key(2.9, (-1.73, -0.9, 1.5))
    stage.area("Rim", 60.0, (1.6, 1.4, 1.2), COLD)
    softbox_world(((0.02, 0.02, 0.022), (0.05, 0.055, 0.065), (0.25, 0.27, 0.3)), (), 0.6)
    bpy.context.view_layer.objects.active = volume
    volume.rle_splat.lighting = "SCENE"
    settings.use_shadows, settings.ambient_occlusion, settings.quality = True, 0.5, "fine"
    view = area_of("VIEW_3D").spaces.active
    view.shading.type, view.overlay.show_extras, view.show_gizmo = "MATERIAL", False, False
    view.shading.use_scene_lights = view.shading.use_scene_world = True
    view.region_3d.view_perspective = "CAMERA"
    with in_the_view():
        bpy.ops.view3d.view_center_camera()


def cut(volume):
    """A box whose right face is dragged by its handle to the middle of the head, and gray values on the cut."""
    yield from scroll_sidebar(DOWN)
    yield from click("bpy.ops.rle_splat.add_cutting_object", "BOX", "Add a box")
    box = bpy.context.view_layer.objects.active
    before = box.matrix_world.copy()
    face = box.matrix_world @ Vector((-1.0, 0.0, 0.0))
    middle_of = sum(corners_of(volume), Vector()) / 2
    yield from drag(
        "LEFTMOUSE", pixel_of(face), pixel_of((middle_of.x - 0.006, face.y, face.z)), "Drag a side of the box"
    )
    assert box.matrix_world != before, "the handle was missed"
    yield from frame(HOLD)
    ours = volume.rle_splat
    ours.slices_follow_window, ours.slices_clear_black = False, True
    ours.slice_center, ours.slice_width = LEVEL, WINDOW
    yield from scroll_sidebar(FURTHER)
    yield from click("bpy.ops.rle_splat.gray_values_on_cut", "", "Show gray values on the cut")
    yield from settled()
    yield from frame(HOLD)


def rendered():
    ended = []
    bpy.app.handlers.render_complete.append(lambda *_: ended.append(True))
    yield from press("F12", middle())
    yield from until(lambda: ended and not bpy.app.is_job_running("RENDER"))
    yield
    yield


def scenario():
    # Imported when the extension, which brings pydicom, is installed.
    if SCAN.is_dir():
        shutil.copytree(SCAN, SHOWN, dirs_exist_ok=True)
    else:
        import_module("devtools.practice_ct").write_series(SHOWN)
    bpy.context.preferences.view.render_display_type = "AREA"
    bpy.context.preferences.system.use_region_overlap = False  # the sidebar stands beside the view
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_display", "RLE_SPLAT_PT_presets", "RLE_SPLAT_PT_clip_objects")
    yield from new_file()
    with bpy.context.temp_override(window=window(), area=area_of("PROPERTIES")):
        bpy.ops.screen.area_close()
    scene, view = bpy.context.scene, area_of("VIEW_3D").spaces.active
    scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 64, "CPU"
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x, scene.render.resolution_y = 880, 570
    view.overlay.show_relationship_lines = False
    point("MOUSEMOVE", "NOTHING", middle(60.0))
    yield from frame(HOLD, "Blender, an empty scene")
    with in_the_view():  # as Blender calls it for a file that is dropped
        bpy.ops.rle_splat.import_volume("INVOKE_DEFAULT", filepath=str(min(SHOWN.iterdir())))
    yield
    yield from frame(HOLD, "Drop a file of a DICOM series")
    yield from press("RET", middle(60.0))
    yield from until(lambda: any(one.rle_splat.is_volume for one in bpy.data.objects))
    volume = bpy.context.view_layer.objects.active
    view.region_3d.view_rotation = Euler((radians(76.0), 0.0, radians(30.0))).to_quaternion()
    view.region_3d.view_distance *= NEARER
    yield from settled()
    yield from wait_for_rest()  # with the pictures of presets
    volume.select_set(False)  # its frame is orange while it is selected
    yield from settled()
    yield from frame(HOLD, "True scale, head holder hidden")
    yield from click("bpy.ops.rle_splat.apply_preset", "ct-soft-tissue", "Click a preset")
    yield from frame(HOLD)
    yield from click("bpy.ops.rle_splat.apply_preset", "ct-bone", "Click a preset")
    yield from frame(HOLD)
    assert volume.rle_splat.transfer_name == "CT Bone"
    with in_the_view():
        assert bpy.ops.rle_splat.change_segment(tool="GROW", length=GROW) == {"FINISHED"}
    ours = volume.rle_splat
    ours.shift_by, ours.opacity_unit_distance, ours.smoothness = SHIFT, OPAQUE, SMOOTH
    yield from settled()
    yield from wait_for_rest()  # with the pictures of presets, which show the grown segment
    yield from frame(HOLD, "Shift -100 HU for thin bone")
    yield from drag("MIDDLEMOUSE", middle(-50.0), middle(120.0), "Turn the view", STEPS // 2)
    yield from frame(HOLD // 2)
    yield from cut(volume)
    studio(volume)
    mouse.clear()
    yield from settled()
    yield from frame(HOLD, "Add lights, a floor and a camera")
    with in_the_view():
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
        assert bpy.ops.rle_splat.add_letters() == {"FINISHED"}
    yield from settled()
    yield from frame(HOLD, "Show in Renders, letters, a scale bar")
    yield from rendered()
    yield from frame(2 * HOLD, "F12")
    save()
    passed("recording")


def save() -> None:
    """Put the photographs together as an animation."""
    folder = Path(os.environ[SHOTS])
    pictures = []
    for number, (times, caption, at) in enumerate(shown):
        path = folder / f"captioned-{number:03}.png"
        words = arrow(at) if at else []
        words += ["-stroke", "none", "-font", FONT, "-gravity", "SouthWest", "-pointsize", "24",
                  "-fill", "white", "-undercolor", "#000c", "-annotate", f"+{RIGHT}+30", f" {caption} "]  # fmt: skip
        words = [*NO_SECONDS, *words] if caption == "F12" else words
        subprocess.run(["convert", str(folder / f"frame-{number:03}.png"), *words, str(path)], check=True)
        pictures += ["-delay", str(CENTISECONDS * times), str(path)]
    subprocess.run(["convert", "-loop", "0", *pictures, "-quality", str(QUALITY), "-define", "webp:method=6",
                    str(folder / "recording.webp")], check=True)  # fmt: skip


drive(scenario)
