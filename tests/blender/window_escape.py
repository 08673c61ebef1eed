"""Esc, pressed by xdotool, during a turntable in a window: the render ends, and the output settings are put back.

    python3 dev.py blender --photograph tests/blender/window_escape.py --size 1280x800

Events that Blender simulates do not reach its own render, so it is started without them.
"""

import subprocess
import tempfile
from pathlib import Path

import bpy
import numpy as np

from tests.blender import scenes
from tests.blender.window_driver import drive, in_the_view, passed, until

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_escape_"))
FRAMES = 500


def press(key: str):
    """Press a key in Blender's window."""
    command = ("xdotool", "search", "--onlyvisible", "--class", "Blender")
    found = subprocess.run(command, check=True, capture_output=True, text=True)
    subprocess.run(("xdotool", "windowfocus", found.stdout.split()[0]), check=True)
    yield
    subprocess.run(("xdotool", "key", key), check=True)


def browser():
    """(window, area) of the file browser."""
    windows = bpy.context.window_manager.windows
    found = [(one, area) for one in windows for area in one.screen.areas if area.type == "FILE_BROWSER"]
    return found[0] if found else None


def rendering():
    return bpy.app.is_job_running("RENDER")


def settings():
    scene = bpy.context.scene
    return scene.render.filepath, scene.render.image_settings.file_format, scene.frame_end, scene.camera


def pictures():
    return len(list(FOLDER.glob("long_*.png")))


def scenario():
    bpy.context.preferences.view.render_display_type = "NONE"
    bpy.context.preferences.view.filebrowser_display_type = "SCREEN"
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    yield
    with in_the_view():
        z, y, x = np.indices((16, 16, 16)) - 7.5
        scenes.import_raw(FOLDER, (255 * (np.sqrt(x**2 + y**2 + z**2) < 6.0)).astype(np.uint8), name="ball")
    scene = bpy.context.scene
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    scenes.add_camera()
    before = settings()
    with in_the_view():
        bpy.ops.rle_splat.turntable("INVOKE_DEFAULT", filepath=str(FOLDER / "long"), frames=FRAMES, output="PNG")
    yield from until(browser)
    yield
    place, area = browser()
    with bpy.context.temp_override(window=place, area=area):
        bpy.ops.file.execute()
    yield from until(lambda: pictures() > 2)
    assert rendering() and settings() != before
    yield from press("Escape")
    yield from until(lambda: not rendering())
    yield from until(lambda: settings() == before)
    assert 2 < pictures() < FRAMES
    with in_the_view():
        assert bpy.ops.rle_splat.turntable.poll()
    passed(f"Esc after {pictures()} pictures")


drive(scenario)
