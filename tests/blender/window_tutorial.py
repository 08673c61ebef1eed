"""The tutorial "From a scan to a figure", step by step: a photograph of each for its page, and the figure.

    python3 dev.py blender --photograph tests/blender/window_tutorial.py --size 1280x900

keeps them in build/window-shots/window_tutorial as JPEG, and prints how long each step took.  The scan is the DICOM
series in tests/blender/data/scan, if there is such a folder, else the practice CT.
"""

import json
import os
import subprocess
import tempfile
import time
from importlib import import_module
from math import radians
from pathlib import Path

import bpy
from mathutils import Euler

from tests.blender.guide_steps import fold, keep, numbers, save
from tests.blender.user_steps import hover, middle, press, scroll_sidebar, settled
from tests.blender.window_driver import (
    SHOTS,
    area_of,
    drive,
    in_the_view,
    new_file,
    open_panels,
    passed,
    until,
    wait_for_rest,
    window,
)

SCAN = Path(__file__).parent / "data" / "scan"
PANELS = ("display", "presets", "material", "picture")  # that are open
SHIFT, GROW, OPAQUE = -100.0, 2.0, 0.05  # HU, mm, mm: thin walls are whole and opaque
DULL = 0.0, 0.75  # specular and diffuse: a cut that faces the headlight is not burnt white
GLOSSY = 0.12, 0.84  # again, under lights: those of the preset
LEVEL, WINDOW = 400.0, 1200.0  # HU, of the slice
DARK = (0.012, 0.016, 0.024)  # of the world, from the render on
DOWN = 14  # turns of the wheel from the first panel to Lighting, Cut and Render


def step(name: str, began: float, *places):
    """A photograph with numbers at these pixels, and the seconds of the step."""
    seconds = time.perf_counter() - began
    if places:
        yield from hover(middle())  # no tooltip covers them
    yield from keep(name, words=numbers(*places))
    passed(f"{name}, {seconds:.1f} s,")


def look_from(tilt: float, turn: float, nearer: float = 1.0) -> None:
    view = area_of("VIEW_3D").spaces.active.region_3d
    view.view_distance *= nearer
    view.view_rotation = Euler((radians(tilt), 0.0, radians(turn))).to_quaternion()


def add_camera(scene) -> None:
    """As in a new file, which has a cube and a light, too."""
    scene.camera = camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    camera.location, camera.rotation_euler = (7.36, -6.93, 4.96), (radians(63.6), 0.0, radians(46.7))


def camera_to_view(scene) -> None:
    scene.camera.matrix_world = area_of("VIEW_3D").spaces.active.region_3d.view_matrix.inverted()
    area_of("VIEW_3D").spaces.active.region_3d.view_perspective = "CAMERA"


def rendered(scene):
    ended = []
    bpy.app.handlers.render_complete.append(lambda *_: ended.append(True))
    yield from press("F12", middle())
    yield from until(lambda: ended and not bpy.app.is_job_running("RENDER"))
    yield from wait_for_rest()  # with what the compositor has made
    assert not scene.rle_splat.render_problem, scene.rle_splat.render_problem


def scenario():
    folder = SCAN
    if not folder.is_dir():
        folder = Path(tempfile.mkdtemp(prefix="rle_splat_tutorial_")) / "practice-ct"
        # Imported when the extension, which brings pydicom, is installed.
        import_module("devtools.practice_ct").write_series(folder)
    bpy.context.preferences.view.render_display_type = "AREA"
    open_panels(*(f"RLE_SPLAT_PT_{name}" for name in PANELS))
    yield from new_file()
    with bpy.context.temp_override(window=window(), area=area_of("PROPERTIES")):
        bpy.ops.screen.area_close()
    area_of("VIEW_3D").spaces.active.overlay.show_relationship_lines = False
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")  # as in a new file
    add_camera(scene)
    scene.render.resolution_x, scene.render.resolution_y = 800, 600
    yield from step("tutorial-1-empty", time.perf_counter(), (2, 1267, 330), (3, 991, 192))

    began = time.perf_counter()
    with in_the_view():
        assert bpy.ops.rle_splat.import_dicom_series(directory=str(folder), hide_table=True) == {"FINISHED"}
    volume = bpy.context.view_layer.objects.active
    save("Skull.blend")
    look_from(80.0, 25.0, 0.6)
    yield from settled()
    yield from wait_for_rest()  # with the pictures of presets
    yield from step("tutorial-2-imported", began)

    began = time.perf_counter()
    with in_the_view():
        assert bpy.ops.rle_splat.apply_preset(preset="ct-bone") == {"FINISHED"}
        if folder != SCAN:  # the practice scan has no head holder that the import would hide
            assert bpy.ops.rle_splat.hide_table() == {"FINISHED"}
        assert bpy.ops.rle_splat.change_segment(tool="GROW", length=GROW) == {"FINISHED"}
    volume.rle_splat.shift_by, volume.rle_splat.opacity_unit_distance = SHIFT, OPAQUE
    yield from wait_for_rest()
    if folder == SCAN:  # panels of another scan are elsewhere
        yield from fold(400, 542, 430)  # Presets; Segments, Color and Opacity
    yield from scroll_sidebar(5)
    yield from step("tutorial-3-preset", began, (1, 991, 88), (2, 991, 612), (3, 991, 816))

    began = time.perf_counter()
    with in_the_view():
        assert bpy.ops.rle_splat.frame_volume(side="A") == {"FINISHED"}
    yield from settled()
    with in_the_view():
        assert bpy.ops.rle_splat.cut_along_view() == {"FINISHED"}
    bpy.context.view_layer.objects.active = volume
    yield from scroll_sidebar(-9)
    if folder == SCAN:
        yield from fold(430, 542, 486)  # Color and Opacity, Segments; Cut
    yield from step("tutorial-4-plane", began, (1, 1127, 177), (2, 991, 541))
    if folder == SCAN:
        yield from fold(458)  # Lighting
    scene.rle_splat.ambient_occlusion = 1.0
    volume.rle_splat.specular, volume.rle_splat.diffuse = DULL
    scene.rle_splat.quality, scene.rle_splat.antialias = "fine", True
    area_of("VIEW_3D").spaces.active.region_3d.view_perspective = "ORTHO"
    look_from(90.0, 0.0, 0.42)
    yield from scroll_sidebar(DOWN)
    yield from step("tutorial-4-cut", began, (1, 991, 119), (2, 991, 328), (3, 991, 832), (4, 191, 62))

    began = time.perf_counter()
    figure = Path(os.environ[SHOTS]) / "tutorial-figure.png"
    with in_the_view():
        assert bpy.ops.rle_splat.save_figure(filepath=str(figure), view="VIEWPORT") == {"FINISHED"}
    assert figure.is_file() and json.loads(figure.with_suffix(".figure.json").read_text())
    subprocess.run(["convert", str(figure), "-resize", "1004x", str(figure)], check=True)
    passed(f"tutorial-figure, {time.perf_counter() - began:.1f} s,")

    began = time.perf_counter()
    with in_the_view():
        assert bpy.ops.rle_splat.gray_values_on_cut() == {"FINISHED"}
    volume.rle_splat.slices_clear_black = True
    volume.rle_splat.slice_center, volume.rle_splat.slice_width = LEVEL, WINDOW
    area_of("VIEW_3D").spaces.active.region_3d.view_perspective = "PERSP"
    look_from(62.0, -20.0, 1.25)
    scene.view_settings.view_transform = "Standard"
    area_of("VIEW_3D").spaces.active.shading.type = "MATERIAL"
    yield from settled()
    yield from wait_for_rest()  # with the shaders of the slice
    yield from settled()
    yield from step("tutorial-5-slice", began, (1, 991, 581), (2, 991, 617), (4, 1190, 62))
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (*DARK, 1.0)

    began = time.perf_counter()
    bpy.context.view_layer.objects.active = volume
    look_from(62.0, -20.0, 1.85)  # a camera sees half of what a viewport does
    yield from settled()
    camera_to_view(scene)
    with in_the_view():
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
        assert bpy.ops.rle_splat.add_letters() == {"FINISHED"}
        assert bpy.ops.rle_splat.add_lights(kind="SOFT") == {"FINISHED"}
    volume.rle_splat.specular, volume.rle_splat.diffuse = GLOSSY
    yield from settled()
    passed(f"camera, {time.perf_counter() - began:.1f} s,")

    began = time.perf_counter()
    yield from rendered(scene)
    yield from step("tutorial-7-rendered", began)


drive(scenario, overlap=False)
