"""The tutorial "From a DICOM folder to a rendered figure", step by step: a photograph of each for its page.

    python3 dev.py blender --photograph tests/blender/window_tutorial.py --size 1280x1100

keeps them in build/window-shots/window_tutorial as JPEG, and prints how long each step took.  The scan is the DICOM
series in tests/blender/data/scan, if there is such a folder, else the practice CT.
"""

import os
import subprocess
import tempfile
import time
from importlib import import_module
from math import radians
from pathlib import Path

import bpy
from mathutils import Euler

from tests.blender.user_steps import drag, middle, press, settled
from tests.blender.window_driver import (
    SHOTS,
    area_of,
    drive,
    in_the_view,
    new_file,
    open_panels,
    passed,
    photograph,
    until,
    wait_for_rest,
)

SCAN = Path(__file__).parent / "data" / "scan"


def keep(name: str, began: float):
    """A photograph as JPEG, and the seconds of the step."""
    seconds = time.perf_counter() - began
    yield from photograph(name)
    path = Path(os.environ[SHOTS]) / f"{name}.png"
    subprocess.run(["convert", str(path), "-quality", "82", str(path.with_suffix(".jpg"))], check=True)
    path.unlink()
    passed(f"{name}, {seconds:.1f} s,")


def look_from(tilt: float, turn: float, nearer: float = 1.0) -> None:
    view = area_of("VIEW_3D").spaces.active.region_3d
    view.view_distance *= nearer
    view.view_rotation = Euler((radians(tilt), 0.0, radians(turn))).to_quaternion()


def light_and_floor(volume):
    """The lamp and the floor of step 6."""
    with in_the_view():
        bpy.ops.object.light_add(type="AREA", location=(0.6, -0.6, 0.5), rotation=[radians(a) for a in (60, 0, 45)])
        bpy.context.object.data.energy, bpy.context.object.data.size = 15.0, 0.3
        bpy.ops.mesh.primitive_plane_add(size=2.0, location=(0.0, 0.0, -0.09))
    floor = bpy.data.materials.new("Floor")
    floor.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.03, 0.035, 0.045, 1.0)
    bpy.context.object.data.materials.append(floor)
    bpy.context.view_layer.objects.active = volume
    volume.rle_splat.lighting = "SCENE"


def camera_to_view():
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.matrix_world = area_of("VIEW_3D").spaces.active.region_3d.view_matrix.inverted()
    area_of("VIEW_3D").spaces.active.region_3d.view_perspective = "CAMERA"


def rendered(_volume):
    ended = []
    bpy.app.handlers.render_complete.append(lambda *_: ended.append(True))
    yield from press("F12", middle())
    yield from until(lambda: ended and not bpy.app.is_job_running("RENDER"))
    yield
    yield


def scenario():
    folder = SCAN
    if not folder.is_dir():
        folder = Path(tempfile.mkdtemp(prefix="rle_splat_tutorial_")) / "practice-ct"
        # Imported when the extension, which brings pydicom, is installed.
        import_module("devtools.practice_ct").write_series(folder)
    bpy.context.preferences.view.render_display_type = "AREA"
    open_panels(*(f"RLE_SPLAT_PT_{name}" for name in ("volume", "display", "presets", "clip_objects", "slices")))
    yield from new_file()
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 8, "CPU"
    scene.cycles.use_denoising = False
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x, scene.render.resolution_y = 800, 600
    yield from keep("tutorial-1-empty", time.perf_counter())

    began = time.perf_counter()
    with in_the_view():
        assert bpy.ops.rle_splat.import_folder(directory=str(folder), at_cursor=True) == {"FINISHED"}
    volume = bpy.context.view_layer.objects.active
    look_from(80.0, 25.0, 0.6)
    yield from settled()
    yield from keep("tutorial-2-imported", began)

    began = time.perf_counter()
    with in_the_view():
        assert bpy.ops.rle_splat.apply_preset(preset="ct-bone") == {"FINISHED"}
        assert bpy.ops.rle_splat.remove_table() == {"FINISHED"}
    yield from wait_for_rest()  # with the pictures of presets
    yield from keep("tutorial-3-preset", began)

    began = time.perf_counter()
    with in_the_view():
        bpy.ops.rle_splat.use_window_tool()
    yield from drag("LEFTMOUSE", middle(), [(6, 4)] * 5)
    yield from settled()
    yield from keep("tutorial-4-window", began)
    with in_the_view():
        bpy.ops.wm.tool_set_by_id(name="builtin.select_box")
        bpy.ops.rle_splat.apply_preset(preset="ct-bone")

    began = time.perf_counter()
    with in_the_view():
        assert bpy.ops.rle_splat.frame_volume(side="L") == {"FINISHED"}
    yield from settled()
    with in_the_view():
        assert bpy.ops.rle_splat.clip_to_view() == {"FINISHED"}
    bpy.context.view_layer.objects.active = volume
    with in_the_view():
        assert bpy.ops.rle_splat.add_slice(kind="sagittal") == {"FINISHED"}
    bpy.context.view_layer.objects.active = volume
    volume.rle_splat.slices_clear_black = True
    volume.rle_splat.slice_center, volume.rle_splat.slice_width = 700.0, 800.0
    area_of("VIEW_3D").spaces.active.region_3d.view_perspective = "PERSP"
    look_from(62.0, 55.0, 0.42)
    yield from settled()
    yield from keep("tutorial-5-cut", began)

    began = time.perf_counter()
    bpy.context.view_layer.objects.active = volume
    light_and_floor(volume)
    camera_to_view()
    with in_the_view():
        assert bpy.ops.rle_splat.composite() == {"FINISHED"}
    yield from settled()
    yield from keep("tutorial-6-camera", began)

    began = time.perf_counter()
    yield from rendered(volume)
    yield from keep("tutorial-7-rendered", began)


drive(scenario)
