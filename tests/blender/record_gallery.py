"""The Blender window in which the gallery's skull is made: the scene that devtools/gallery_skull.py builds.

    python3 dev.py blender --photograph tests/blender/record_gallery.py --size 1600x1000

writes gallery-window.jpg into build/window-shots/record_gallery.  The DICOM series is that of tests/blender/data/scan.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import bpy

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
    window,
)

SCAN = Path(__file__).parent / "data" / "scan"
OUTLINER = 0.35  # of the editors on the right


def scenario():
    sys.path.append(str(Path(__file__).parents[2] / "devtools"))
    from gallery_skull import skull
    from gallery_studio import Stage

    bpy.context.preferences.system.use_region_overlap = False  # the sidebar stands beside the view
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_clip_objects")
    yield from new_file()
    with in_the_view():
        assert bpy.ops.rle_splat.import_dicom_series(directory=str(SCAN)) == {"FINISHED"}
        stage = Stage.of(bpy.context.view_layer.objects.active, Path(tempfile.mkdtemp()))
        list(skull(stage))
    area = area_of("VIEW_3D")
    scene = bpy.context.scene
    scene.render.engine, scene.eevee.taa_samples = "CYCLES", 16
    scene.render.resolution_x, scene.render.resolution_y = 1400, 1050
    for one in bpy.context.view_layer.objects:
        one.select_set(one == stage.volume)
        one.hide_set(one in list(scene.rle_splat.clip_objects.objects))  # with their handles
    bpy.context.view_layer.objects.active = stage.volume
    with bpy.context.temp_override(window=window(), area=area_of("PROPERTIES")):
        bpy.ops.screen.area_split(direction="HORIZONTAL", factor=1.0 - OUTLINER)
    yield  # then the areas know where they are
    upper = max((one for one in window().screen.areas if one.type == "PROPERTIES"), key=lambda one: one.y)
    upper.type = "OUTLINER"
    yield
    view = area.spaces.active
    view.region_3d.view_perspective = "CAMERA"
    view.shading.type = "MATERIAL"
    view.shading.use_scene_lights = view.shading.use_scene_world = True
    view.overlay.show_overlays = False
    yield
    with in_the_view():
        bpy.ops.view3d.view_center_camera()
    yield from settled()
    yield from photograph("draft")  # the shaders of the materials are made
    yield from settled()
    yield from photograph("gallery-window")
    path = Path(os.environ[SHOTS]) / "gallery-window.png"
    subprocess.run(["convert", str(path), "-quality", "86", str(path.with_suffix(".jpg"))], check=True)
    passed("the gallery's window")


drive(scenario)
