"""The tutorial "From a DICOM folder to a rendered figure", step by step: a photograph of each for its page.

    python3 dev.py blender --photograph tests/blender/window_tutorial.py --size 1280x1100

keeps them in build/window-shots/window_tutorial as JPEG, and prints how long each step took.
"""

import os
import subprocess
import tempfile
import time
from importlib import import_module
from math import radians
from pathlib import Path

import bpy
from mathutils import Euler, Vector

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
)

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_tutorial_")) / "practice-ct"


def keep(name: str, began: float):
    """A photograph as JPEG, and the seconds of the step."""
    seconds = time.perf_counter() - began
    yield from photograph(name)
    path = Path(os.environ[SHOTS]) / f"{name}.png"
    subprocess.run(["convert", str(path), "-quality", "82", str(path.with_suffix(".jpg"))], check=True)
    path.unlink()
    passed(f"{name}, {seconds:.1f} s,")


def look_from(tilt: float, turn: float) -> None:
    view = area_of("VIEW_3D").spaces.active.region_3d
    view.view_rotation = Euler((radians(tilt), 0.0, radians(turn))).to_quaternion()


def light_and_floor(volume):
    """A warm key light, a cool rim light and a floor, as a user adds them."""
    middle_of = volume.matrix_world.translation + volume.matrix_world.to_3x3() @ Vector((0.0, 0.0, -0.01))
    for name, place, color, watts in (
        ("Key", (0.5, -0.7, 0.6), (1.0, 0.85, 0.7), 16.0), ("Rim", (-0.6, 0.5, 0.5), (0.6, 0.75, 1.0), 20.0),
    ):  # fmt: skip
        data = bpy.data.lights.new(name, "AREA")
        data.energy, data.color, data.size = watts, color, 0.4
        one = bpy.data.objects.new(name, data)
        one.location = middle_of + Vector(place)
        one.rotation_euler = (-Vector(place)).to_track_quat("-Z", "Y").to_euler()
        bpy.context.scene.collection.objects.link(one)
    with in_the_view():
        bpy.ops.mesh.primitive_plane_add(size=2.0, location=middle_of - Vector((0.0, 0.0, 0.13)))
    floor = bpy.data.materials.new("Floor")
    floor.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.05, 0.06, 0.08, 1.0)
    bpy.context.view_layer.objects.active.data.materials.append(floor)
    bpy.context.view_layer.objects.active = volume


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
    # Imported when the extension, which brings pydicom, is installed.
    import_module("devtools.practice_ct").write_series(FOLDER)
    bpy.context.preferences.view.render_display_type = "AREA"
    open_panels(*(f"RLE_SPLAT_PT_{name}" for name in ("volume", "display", "presets", "clip_objects", "picture")))
    yield from new_file()
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 16, "CPU"
    scene.cycles.use_denoising = False
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x, scene.render.resolution_y = 800, 600
    yield from keep("tutorial-1-empty", time.perf_counter())

    began = time.perf_counter()
    with in_the_view():
        assert bpy.ops.rle_splat.import_folder(directory=str(FOLDER)) == {"FINISHED"}
    volume = bpy.context.view_layer.objects.active
    look_from(80.0, 25.0)
    yield from settled()
    yield from keep("tutorial-2-imported", began)

    began = time.perf_counter()
    with in_the_view():
        assert bpy.ops.rle_splat.apply_preset(preset="ct-skin-and-bone") == {"FINISHED"}
    yield from settled()
    yield from keep("tutorial-3-preset", began)

    began = time.perf_counter()
    with in_the_view():
        bpy.ops.rle_splat.use_window_tool()
    yield from drag("LEFTMOUSE", middle(), [(6, 4)] * 5)
    yield from settled()
    yield from keep("tutorial-4-window", began)
    with in_the_view():
        bpy.ops.wm.tool_set_by_id(name="builtin.select_box")
        bpy.ops.rle_splat.apply_preset(preset="ct-skin-and-bone")

    began = time.perf_counter()
    with in_the_view():
        assert bpy.ops.rle_splat.add_clip(kind="BOX") == {"FINISHED"}
    box = bpy.context.view_layer.objects.active
    box.rle_splat.clip_keep = "OUTSIDE"
    box.location += Vector((0.095, -0.115, 0.125))  # the left, front and upper eighth of the head
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
