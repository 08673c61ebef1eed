"""Pictures of the guides on light and on renders, photographed in a real window.

    python3 dev.py blender --photograph tests/blender/record_renders.py --size 1280x800

writes how-to-*.jpg, readme-viewport.jpg and readme-first.jpg into build/window-shots/record_renders.  In
tests/blender/data are: ``scan``, the DICOM series of the gallery's skull; ``cta_aorta_labels``, the dissected aorta;
and the files of BRAIN and HEAD_MR.
"""

import os
import shutil
import subprocess
import tempfile
import time
from math import radians
from pathlib import Path

import bpy
from mathutils import Euler

from tests.blender.guide_steps import (
    BRAIN,
    DATA,
    HEAD_MR,
    HEART,
    activate,
    bare,
    begin,
    beside,
    imported,
    keep,
    lamp,
    look_from,
)
from tests.blender.real_blender import MODULE
from tests.blender.user_steps import scroll_sidebar, settled
from tests.blender.window_driver import SHOTS, area_of, drive, in_the_view, open_panels, passed, wait_for_rest

REPORT = "975x695+280+82"
DARK = (0.012, 0.016, 0.024, 1.0)  # of the world


def lights():
    """A brain under the three lights of Add Lights, and the panel Lighting."""
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_shading", "RLE_SPLAT_PT_material")
    volume = yield from imported("mr-brain", BRAIN)
    scene = bpy.context.scene
    activate(volume)
    look_from(78.0, 28.0, 0.5)
    yield from settled()
    with in_the_view():
        assert bpy.ops.rle_splat.add_lights(kind="THREE") == {"FINISHED"}
    scene.rle_splat.quality = "fine"
    scene.view_settings.view_transform = "Standard"
    bare()
    area_of("VIEW_3D").spaces.active.overlay.show_overlays = False
    yield from settled()
    yield from keep("how-to-lighting")
    passed("lights")


def nodes():
    """The compositor, as Show in Renders leaves it."""
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_picture")
    yield from imported("mr-brain", BRAIN)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    with in_the_view():
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    editor = area_of("VIEW_3D")
    editor.ui_type = "CompositorNodeTree"
    yield from wait_for_rest()
    with bpy.context.temp_override(area=editor, region=next(one for one in editor.regions if one.type == "WINDOW")):
        bpy.ops.node.view_all()
    yield from wait_for_rest()
    yield from keep("how-to-nodes", "860x470+60+125")
    editor.ui_type = "VIEW_3D"
    passed("nodes")


def pinned():
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_picture")
    volume = yield from imported("mr-head", HEAD_MR)
    volume.rle_splat.smoothness, bpy.context.scene.rle_splat.quality = 2.0, "fine"
    look_from(80.0, 35.0, 0.5)
    yield from settled()
    scene, region = bpy.context.scene, area_of("VIEW_3D").spaces.active.region_3d
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.clip_start, camera.data.sensor_width = 0.01, 72.0  # that of a viewport
    scene.collection.objects.link(camera)
    scene.camera, camera.matrix_world = camera, region.view_matrix.inverted()
    bare()
    scene.render.resolution_x, scene.render.resolution_y = 800, 600
    bpy.ops.mesh.primitive_torus_add(
        location=(0.0, 0.0, 0.03), major_radius=0.125, minor_radius=0.004, major_segments=96
    )
    bpy.context.view_layer.objects.active.select_set(False)
    activate(volume)
    with in_the_view():
        assert bpy.ops.rle_splat.preview_in_camera_view(place="FRONT") == {"FINISHED"}
    region.view_perspective = "CAMERA"
    bpy.context.preferences.addons[MODULE].preferences.show_live = False  # the picture alone
    yield
    with in_the_view():
        bpy.ops.view3d.view_center_camera()
    yield from wait_for_rest()
    yield from keep("how-to-backdrop")
    bpy.context.preferences.addons[MODULE].preferences.show_live = True
    passed("backdrop")


def reported():
    """The panels Effects and Last Report beside the view, of a heart without segments, under a sun with shadows."""
    open_panels(*(f"RLE_SPLAT_PT_{name}" for name in ("advanced", "diagnostics", "effects", "report")))
    yield from begin()
    with in_the_view():
        assert bpy.ops.rle_splat.import_volume(
            filepath=str(DATA / HEART), preset="ct-angiography"
        ) == {"FINISHED"}  # fmt: skip
    volume = bpy.context.view_layer.objects.active
    volume.select_set(False)
    look_from(76.0, 20.0, 0.8)
    scene, view = bpy.context.scene, area_of("VIEW_3D").spaces.active
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    camera.data.clip_start = 0.01
    scene.rle_splat.quality = "fine"
    view.overlay.show_extras = view.overlay.show_relationship_lines = view.overlay.show_text = False
    yield from settled()
    scene.camera, camera.matrix_world = camera, view.region_3d.view_matrix.inverted()
    activate(volume)
    # As late as this, so that the view has not computed its light before.
    lamp("SUN", "Sun", 3.0, (-0.3, -0.45, 0.4), angle=radians(3.0))
    with in_the_view():
        assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    yield from scroll_sidebar(60)
    yield from keep("how-to-report", REPORT)
    passed("report")


def first_picture():
    """The viewport and the render that the README's steps make of its sample."""
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_display", "RLE_SPLAT_PT_presets")
    yield from begin()
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = DARK
    scan = shutil.copy(DATA / BRAIN, Path(tempfile.mkdtemp()) / "FLAIR.nrrd")
    with in_the_view():
        assert bpy.ops.rle_splat.import_volume(filepath=str(scan)) == {"FINISHED"}
    scene.rle_splat.quality, scene.rle_splat.antialias = "fine", True
    view = area_of("VIEW_3D").spaces.active.region_3d
    view.view_rotation = Euler((1.66, 0.0, 1.75)).to_quaternion()
    view.view_distance *= 0.6
    yield from settled()
    yield from wait_for_rest()  # with the pictures of presets
    yield from keep("readme-viewport")
    view.view_distance *= 1.62  # a camera sees half of what a viewport does
    yield from settled()
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera, camera.matrix_world = camera, view.view_matrix.inverted()
    with in_the_view():
        assert bpy.ops.rle_splat.add_lights(kind="THREE") == {"FINISHED"}
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
        assert bpy.ops.rle_splat.add_letters() == {"FINISHED"}
    scene.view_settings.view_transform, path = "Standard", Path(os.environ[SHOTS]) / "readme-first.png"
    scene.render.filepath = str(path)
    began = time.perf_counter()
    assert bpy.ops.render.render(write_still=True) == {"FINISHED"}
    words = "-resize", "50%", "-quality", "84", str(path.with_suffix(".jpg"))
    subprocess.run(["convert", str(path), *words], check=True)
    passed(f"first picture, {time.perf_counter() - began:.0f} s,")


def transforms():
    """Bone and vessels under three lights, in the view transforms Standard and AgX, and in AgX with more contrast."""
    parts = {}
    for name, preset, scan, turn, nearer in (
        ("Bone", "ct-bone", "scan", 30.0, 0.58),
        ("Angio", "ct-angiography", HEART, 55.0, 0.66),
    ):
        volume = yield from imported(preset, scan)
        ours = volume.rle_splat
        activate(volume)
        with in_the_view():
            if name == "Bone":
                assert bpy.ops.rle_splat.hide_table() == {"FINISHED"}
                ours.shift_by, ours.opacity_unit_distance, ours.smoothness = -100.0, 0.05, 2.0  # thin walls are whole
            else:  # the heart alone
                assert bpy.ops.rle_splat.threshold_segment(low=290.0, high=ours.value_high) == {"FINISHED"}
                assert bpy.ops.rle_splat.change_segment(tool="LARGEST") == {"FINISHED"}
                ours.smoothness = 3.0
                for row in ours.labels:
                    row.show = row.label != 0
            assert bpy.ops.rle_splat.change_segment(tool="GROW", length=2.0) == {"FINISHED"}
        look_from(78.0, turn, nearer)
        yield from settled()
        scene, camera = bpy.context.scene, bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        scene.collection.objects.link(camera)
        scene.camera, camera.matrix_world = camera, area_of("VIEW_3D").spaces.active.region_3d.view_matrix.inverted()
        with in_the_view():
            assert bpy.ops.rle_splat.add_lights(kind="THREE") == {"FINISHED"}
            assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
        scene.rle_splat.quality, scene.rle_splat.antialias = "fine", True
        scene.render.resolution_x = scene.render.resolution_y = 420
        assert bpy.ops.render.render() == {"FINISHED"}
        scene.render.image_settings.file_format, view = "JPEG", scene.view_settings
        for transform, look in (("Standard", "None"), ("AgX", "None"), ("AgX", "AgX - High Contrast")):
            view.view_transform = transform
            view.look = look
            caption = f"{name}, {look.replace(' -', '')}" if look != "None" else f"{name}, {transform}"
            parts[caption] = caption.replace(" ", "-")
            path = Path(os.environ[SHOTS]) / f"{parts[caption]}.jpg"
            bpy.data.images["Render Result"].save_render(str(path))
    beside("how-to-agx", parts, across=3)
    passed("transforms")


def scenario():
    bpy.context.preferences.system.use_region_overlap = False  # the sidebar stands beside the view
    for part in (lights, nodes, pinned, reported, first_picture, transforms):
        yield from part()


drive(scenario)
