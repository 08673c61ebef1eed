"""Turntable in a window: from the file browser to the movie, and the output settings afterwards.

Esc is Blender's own: it ends the render, and events that are simulated, as here, do not reach that.  So
window_escape.py presses it.

    python3 dev.py blender --photograph tests/blender/window_turntable.py --size 1280x800
"""

import tempfile
from pathlib import Path

import bpy
import numpy as np

from tests.blender import scenes
from tests.blender.user_steps import refined
from tests.blender.window_driver import (
    drive,
    in_the_view,
    new_file,
    open_panels,
    passed,
    photograph,
    until,
)

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_turntable_"))


def file_browser():
    """(window, area) of the file browser, which Blender opens in a window of its own."""
    for one in bpy.context.window_manager.windows:
        for area in one.screen.areas:
            if area.type == "FILE_BROWSER":
                return one, area
    return None


def confirmed(name, **options):
    """Open the operator's dialog, set its options, and press its button."""
    with in_the_view():
        bpy.ops.rle_splat.turntable("INVOKE_DEFAULT", filepath=str(FOLDER / name), **options)
    yield from until(file_browser)
    yield
    yield from photograph(f"{name}_dialog")
    place, area = file_browser()
    with bpy.context.temp_override(window=place, area=area):
        bpy.ops.file.execute()
    yield


def rendering():
    return bpy.app.is_job_running("RENDER")


def settings():
    render = bpy.context.scene.render
    return render.filepath, render.image_settings.file_format, bpy.context.scene.frame_end, bpy.context.scene.camera


def scenario():
    bpy.context.preferences.view.render_display_type = "NONE"
    bpy.context.preferences.view.filebrowser_display_type = "WINDOW"
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_picture")
    yield from new_file()
    with in_the_view():
        z, y, x = np.indices((16, 16, 16)) - 7.5
        ball = (255 * (np.sqrt(x**2 + y**2 + (0.7 * z) ** 2) < 6.0)).astype(np.uint8)
        scenes.import_raw(FOLDER, ball, name="ball")
    scene = bpy.context.scene
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    camera = scenes.add_camera()
    scene.render.resolution_x, scene.render.resolution_y = 643, 361
    with in_the_view():
        bpy.ops.rle_splat.turntable("INVOKE_DEFAULT", filepath=str(FOLDER / "odd"))
    yield from until(file_browser)
    yield
    yield from photograph("odd size")
    place, area = file_browser()
    chosen = area.spaces.active.active_operator
    assert chosen.output == "PNG", "no movie has so odd a size, and the dialog says so before it is filled in"
    with bpy.context.temp_override(window=place, area=area):
        bpy.ops.file.cancel()
    yield from until(lambda: file_browser() is None)
    passed("an odd size is refused at once")

    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    before, names = settings(), {one.name for one in bpy.data.objects if one.type in ("CAMERA", "EMPTY")}
    yield from confirmed("turn", frames=6)
    yield from until(lambda: (FOLDER / "turn.mp4").exists() and not rendering())
    yield from until(lambda: settings() == before)
    yield from refined()
    yield from photograph("ended")
    assert bpy.data.movieclips.load(str(FOLDER / "turn.mp4")).frame_duration == 6
    assert scene.camera == camera, "the scene's own"
    assert {one.name for one in bpy.data.objects if one.type in ("CAMERA", "EMPTY")} == names, "nothing is left"
    passed("a movie")

    (FOLDER / "turn_0002.png").write_bytes(b"of another volume")
    yield from confirmed("turn", frames=6, output="PNG")
    yield from photograph("refused")
    assert not rendering() and sorted(path.name for path in FOLDER.glob("turn_*")) == ["turn_0002.png"]
    assert settings() == before
    passed("pictures that are there are not replaced")


drive(scenario, overlap=False)
