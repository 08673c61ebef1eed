"""Pictures of the tutorial on organs, photographed in a real window.

    python3 dev.py blender --photograph tests/blender/record_organs.py --size 1280x800

writes organs-*.jpg and how-to-isolate.jpg into build/window-shots/record_organs.  In tests/blender/data is
``cta_aorta_labels``, the dissected aorta with its segments.
"""

import os
import shutil
import subprocess
from pathlib import Path

import bpy
from mathutils import Vector

from tests.blender.guide_steps import (
    AORTA,
    DATA,
    SCANS,
    activate,
    begin,
    beside,
    fold,
    keep,
    look_from,
    masks,
    numbers,
    save,
)
from tests.blender.scenes import module
from tests.blender.user_steps import middle, press, settled
from tests.blender.window_driver import (
    SHOTS,
    area_of,
    drive,
    in_the_view,
    open_panels,
    passed,
    until,
    wait_for_rest,
    window,
)

ORGANS = "540x610+160+140"  # of a photograph
TEXTS = {"Aorta true lumen": "Ascending aorta", "Aorta false lumen": "False lumen",
          "Annulus proper": "Aortic annulus"}  # names before, after  # fmt: skip
DARK = (0.012, 0.016, 0.024)  # of the world
DESCENDING = 0.35  # of the picture's height: how far below the line to the false lumen that of the true lumen ends
ARTERY = "subclavian_artery_left"  # leaves the scan, and enters it again
RINGS = "annulus_proper", "sinotubular_junction"  # thin ones, in a color of their own
SAMPLES = 100  # turns of the window's loop
GROUND, TURQUOISE = 551.0, (0.03, 0.6, 0.5)  # the slice's place in mm; a color


def label(volume, text: str, place) -> None:
    """A label of what the camera sees at a place in the plane of its frame, as a click there adds it."""
    scene = bpy.context.scene
    origin, plane = scene.camera.matrix_world.translation, scene.camera.data.view_frame(scene=scene)[0].z
    toward = (scene.camera.matrix_world @ Vector((*place, plane)) - origin).normalized()
    probe = module("bridge.look.probe")
    ray = probe.Ray(tuple(origin), tuple(toward))
    found = probe.look_along(bpy.context, bpy.context.evaluated_depsgraph_get(), ray, [volume])
    assert bpy.ops.rle_splat.add_name(text=text, point=found.surface.world) == {"FINISHED"}


def label_lumen(volume) -> None:
    """A label of the descending true lumen, below the line to the false one."""
    frame = bpy.context.scene.camera.data.view_frame(scene=bpy.context.scene)
    high, low = frame[0], frame[2]
    x, y = module("operators.callout_objects").end_of(bpy.data.objects["Line to Aorta false lumen"].data)
    label(volume, "True lumen", (x, y - DESCENDING * (high.y - low.y)))


def tutorial_of_organs():
    """From a scan with its masks beside it to a render with names."""
    open_panels("RLE_SPLAT_PT_labels", "RLE_SPLAT_PT_slices", "RLE_SPLAT_PT_picture")
    yield from begin()
    scan = masks().parent / "Aorta.nii.gz"
    shutil.copyfile(DATA / AORTA / "cta_heart_aorta_120x126x164_int16.nii.gz", scan)
    bpy.context.preferences.view.render_display_type = "AREA"
    scene, view = bpy.context.scene, area_of("VIEW_3D").spaces.active
    scene.world = bpy.data.worlds.new("World")  # as in a new file
    scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 16, "CPU"
    scene.render.resolution_x, scene.render.resolution_y = 1400, 900
    scene.view_settings.view_transform = "Standard"
    view.overlay.show_relationship_lines = False
    with in_the_view():
        bpy.ops.rle_splat.import_volume("INVOKE_DEFAULT", filepath=str(scan), at_cursor=True)
    yield from wait_for_rest()
    yield from keep("organs-1-dialog", words=numbers((3, 270, 638), (3, 270, 716), (4, 347, 768)))
    yield from press("RET", middle())
    yield from until(lambda: any(one.rle_splat.is_volume for one in bpy.data.objects))
    volume = bpy.context.view_layer.objects.active
    look_from(76.0, 35.0, 0.55)
    yield from settled()
    yield from wait_for_rest()
    yield from keep("organs-2-imported", words=numbers((1, 991, 528), (2, 991, 649), (3, 991, 553), (4, 991, 447)))
    save("Aorta.blend")
    view.overlay.show_overlays = False  # without box and letters
    yield from wait_for_rest()
    yield from keep("whole", ORGANS)
    ours = volume.rle_splat
    names = [row.label_name for row in ours.labels]
    ours.active_label = names.index(ARTERY)
    with in_the_view():
        assert bpy.ops.rle_splat.change_segment(tool="LARGEST") == {"FINISHED"}
    ours.active_label = names.index("aorta_false_lumen")
    for row in ours.labels:
        if row.label_name in RINGS:
            row.color = TURQUOISE
        row.show = row.label != 0
    yield from settled()
    yield from keep("alone", ORGANS)
    beside("how-to-isolate", {"The whole scan": "whole", "Segments alone": "alone"})
    view.overlay.show_overlays = True
    with in_the_view():
        assert bpy.ops.rle_splat.add_slice(kind="AXIAL") == {"FINISHED"}
    bpy.context.view_layer.objects.active.rle_splat.slice_position = GROUND
    activate(volume)
    yield from settled()
    yield from keep("organs-3-slice", words=numbers((1, 991, 356), (2, 991, 408)))
    yield from fold(515, 325)  # Segments, Slices
    scene.world.color = DARK
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (*DARK, 1.0)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    look_from(80.0, 35.0, 2.2)  # a camera sees half of what a viewport does
    yield from settled()
    scene.camera, camera.matrix_world = camera, view.region_3d.view_matrix.inverted()
    view.region_3d.view_perspective = "CAMERA"
    view.shading.type = "MATERIAL"
    view.shading.use_scene_world = True
    with in_the_view():
        bpy.ops.view3d.view_center_camera()
        assert bpy.ops.rle_splat.add_lights(kind="THREE") == {"FINISHED"}
        activate(volume)
        scene.rle_splat.quality, scene.rle_splat.antialias = "fine", True
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
        assert bpy.ops.rle_splat.add_letters() == {"FINISHED"}
    volume.select_set(False)
    with in_the_view():
        assert bpy.ops.rle_splat.add_names() == {"FINISHED"}
    bpy.data.objects.remove(bpy.data.objects["I"])  # the slice hides a part of it
    for name, text in TEXTS.items():
        bpy.data.objects[name].data.body = text
    activate(volume)
    with in_the_view():
        label_lumen(volume)
    view.overlay.show_overlays = False
    activate(volume)
    yield from settled()
    yield from fold(688)  # Letters and Names
    for shading in ("MATERIAL", "SOLID", "MATERIAL"):  # EEVEE draws names with what it had before it compiled theirs
        view.shading.type = shading
        for _ in range(SAMPLES):
            yield
    yield from keep("organs-4-names", words=numbers((1, 991, 739), (3, 1193, 62)))
    ended = []
    bpy.app.handlers.render_complete.append(lambda *_: ended.append(True))
    yield from press("F12", middle())
    yield from until(lambda: ended and not bpy.app.is_job_running("RENDER"))
    yield from wait_for_rest()
    half = window().width // 2, window().height // 2
    for value in ("PRESS", "RELEASE"):  # the whole picture, as large as the window
        window().event_simulate(type="HOME", value=value, x=half[0], y=half[1], shift=True)
    yield
    yield from wait_for_rest()
    yield from keep("organs-5-rendered")
    path = Path(os.environ[SHOTS]) / "organs-figure.png"
    bpy.data.images["Render Result"].save_render(str(path))
    subprocess.run(["convert", str(path), "-quality", "88", str(path.with_suffix(".jpg"))], check=True)
    shutil.rmtree(SCANS)
    passed("tutorial of organs")


def scenario():
    bpy.context.preferences.system.use_region_overlap = False  # the sidebar stands beside the view
    yield from tutorial_of_organs()


drive(scenario)
