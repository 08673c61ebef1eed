"""Pictures of the how-to guides, photographed in a real window.

    python3 dev.py blender --photograph tests/blender/record_guides.py --size 1280x800

writes how-to-*.jpg into build/window-shots/record_guides.  The scan is the skull of the gallery, its DICOM series in
tests/blender/data/scan.
"""

import os
import subprocess
from math import radians
from pathlib import Path

import bpy
from mathutils import Euler

from tests.blender.user_steps import middle, settled, simulate
from tests.blender.window_driver import (
    SHOTS,
    area_of,
    drive,
    in_the_view,
    new_file,
    open_panels,
    passed,
    photograph,
    window,
)

DATA = Path(__file__).parent / "data"
HEAD = "560x560+190+170"
PANELS = ("transfer", "slices", "shading")  # that are open


def keep(name: str, part: str = ""):
    """A photograph, or the part of it, as JPEG."""
    yield from photograph(name)
    path = Path(os.environ[SHOTS]) / f"{name}.png"
    crop = ["-crop", part, "+repage"] if part else []
    subprocess.run(["convert", str(path), *crop, "-quality", "84", str(path.with_suffix(".jpg"))], check=True)


def beside(name: str, *parts: str) -> None:
    """Pictures in a row, as one."""
    folder = Path(os.environ[SHOTS])
    words = [str(folder / f"{part}.jpg") for part in parts]
    subprocess.run(["convert", *words, "-bordercolor", "black", "-border", "2", "+append", "-resize", "1100x>",
                    "-quality", "84", str(folder / f"{name}.jpg")], check=True)  # fmt: skip
    for part in parts:
        (folder / f"{part}.jpg").unlink()


def look_from(tilt: float, turn: float, nearer: float = 0.6) -> None:
    view = area_of("VIEW_3D").spaces.active.region_3d
    view.view_rotation = Euler((radians(tilt), 0.0, radians(turn))).to_quaternion()
    view.view_distance *= nearer


def begin():
    """A new file whose window has the viewport alone."""
    yield from new_file()
    with bpy.context.temp_override(window=window(), area=area_of("PROPERTIES")):
        bpy.ops.screen.area_close()
    yield


def skull():
    """The skull without its head holder, by the preset Bone; returns the volume."""
    yield from begin()
    with in_the_view():
        assert bpy.ops.rle_splat.import_folder(directory=str(DATA / "scan")) == {"FINISHED"}
        assert bpy.ops.rle_splat.apply_preset(preset="ct-bone") == {"FINISHED"}
        assert bpy.ops.rle_splat.remove_table() == {"FINISHED"}
    look_from(76.0, -30.0, 0.5)
    yield from settled()
    return bpy.context.view_layer.objects.active


def activate(volume) -> None:
    bpy.context.view_layer.objects.active = volume


def set_up_slices():
    volume = yield from skull()
    with in_the_view():
        assert bpy.ops.rle_splat.four_up("EXEC_DEFAULT", True) == {"FINISHED"}
    volume.rle_splat.slice_center, volume.rle_splat.slice_width = 100.0, 1500.0
    activate(volume)
    yield from settled()
    yield from keep("how-to-slices")
    passed("slices")


def window_and_curve():
    volume = yield from skull()
    yield from keep("how-to-curve")
    with in_the_view():
        bpy.ops.rle_splat.use_window_tool()
    simulate("MOUSEMOVE", "NOTHING", middle(150.0, -30.0))
    yield
    simulate("MOUSEMOVE", "NOTHING", middle(151.0, -30.0))
    yield from settled()
    yield from keep("how-to-window")
    with in_the_view():
        bpy.ops.wm.tool_set_by_id(name="builtin.select_box")
    for name, smoothness in (("rough", 0.0), ("smooth", 2.0)):
        volume.rle_splat.smoothness = smoothness
        yield from settled()
        yield from keep(name, HEAD)
    beside("how-to-smoothness", "rough", "smooth")
    passed("window, curve, smoothness")


def lamps(volume) -> None:
    middle_of = volume.matrix_world.translation
    for name, place, color, watts in (
        ("Key", (-0.3, -0.6, 0.45), (1.0, 0.9, 0.78), 14.0), ("Rim", (0.6, 0.35, 0.25), (0.55, 0.72, 1.0), 22.0),
    ):  # fmt: skip
        data = bpy.data.lights.new(name, "AREA")
        data.energy, data.color, data.size = watts, color, 0.15
        made = bpy.data.objects.new(name, data)
        made.location = middle_of + type(middle_of)(place)
        made.rotation_euler = (middle_of - made.location).to_track_quat("-Z", "Y").to_euler()
        bpy.context.scene.collection.objects.link(made)


def light():
    volume = yield from skull()
    volume.rle_splat.lighting = "HEADLIGHT"
    yield from settled()
    yield from keep("headlight", HEAD)
    lamps(volume)
    activate(volume)
    volume.rle_splat.lighting = "SCENE"
    bpy.context.scene.rle_splat.use_shadows = False
    yield from settled()
    yield from keep("lamps", HEAD)
    bpy.context.scene.rle_splat.use_shadows = True
    bpy.context.scene.rle_splat.ambient_occlusion = 0.8
    yield from settled()
    yield from keep("shadows", HEAD)
    beside("how-to-light", "headlight", "lamps", "shadows")
    passed("light")


def scenario():
    bpy.context.preferences.system.use_region_overlap = False  # the sidebar stands beside the view
    open_panels("RLE_SPLAT_PT_volume", *(f"RLE_SPLAT_PT_{name}" for name in PANELS))
    for part in (set_up_slices, window_and_curve, light):
        yield from part()


drive(scenario)
