"""The film of the tutorial "From a scan to a graded film", by its steps in a real window: a plane opens a head.

    python3 dev.py blender --photograph tests/blender/record_film.py --size 1280x800

writes into build/window-shots/record_film its frames, of which devtools/example_figures.py makes how-to-opening.webp,
and film-graded.jpg, a frame before and after the last step, and prints the seconds of a frame.  The scan is HEAD_MR in
tests/blender/data.  The frames from 60 to 120 are those of the way there, so they are not rendered.
"""

import os
import subprocess
import time

import bpy

from tests.blender.guide_steps import HEAD_MR, activate, beside, imported
from tests.blender.scenes import module
from tests.blender.user_steps import settled
from tests.blender.window_driver import SHOTS, drive, in_the_view, passed

TURN, LAST, STEP = 60, 120, 2  # frames of the turn, and of all; each second one is shown
ANGLE, START, LENS = 40.0, 20.0, 78.0  # degrees, and mm
OUTSIDE = 0.09  # meters from the middle to the left
LEVEL, WINDOW = 90.0, 170.0
DARK = (0.012, 0.016, 0.024)  # of the world
GRADED, EXPOSURE = 27, 0.2  # the frame of the picture, which is one of the film's
LIFT, GAIN = (0.99, 1.0, 1.015, 1.0), (1.12, 1.0, 0.88, 1.0)  # bluish shadows, warm lights
PART = "760x600+120+70"  # of the frame, which the picture shows
SAMPLES = 8  # of Cycles, which renders the faces of the cut and the world alone


def turn_and_cut(scene, volume):
    """Steps 2 and 3 of the tutorial."""
    curves_of = module("bridge.render.camera_path").curves_of
    with in_the_view():
        assert bpy.ops.rle_splat.turntable(
            filepath=os.path.join(os.environ[SHOTS], "turn"), frames=TURN, angle=ANGLE, azimuth=START, render=False
        ) == {"FINISHED"}  # fmt: skip
        scene.camera.data.lens = LENS
        scene.frame_set(1)
        pivot = scene.camera.parent
        pivot.keyframe_insert("rotation_euler", index=2, frame=LAST)
        activate(volume)
        assert bpy.ops.rle_splat.add_lights(kind="SKIN") == {"FINISHED"}
        bpy.ops.view3d.view_axis(type="RIGHT")  # of Blender: the patient's left
    yield from settled()
    with in_the_view():
        assert bpy.ops.rle_splat.cut_along_view() == {"FINISHED"}
    plane = bpy.context.view_layer.objects.active
    middle = plane.location.x
    for number, away in ((1, OUTSIDE), (TURN, 0.0), (LAST, OUTSIDE)):
        plane.location.x = middle + away
        plane.keyframe_insert("location", frame=number)
    for one in (pivot, plane):
        for curve in curves_of(one):
            for point in curve.keyframe_points:
                point.interpolation = "BEZIER"
    activate(volume)
    with in_the_view():
        assert bpy.ops.rle_splat.gray_values_on_cut() == {"FINISHED"}
    ours = volume.rle_splat
    ours.slices_follow_window, ours.slice_center, ours.slice_width = False, LEVEL, WINDOW
    yield from settled()


def grade(scene):
    """Steps 5 and 6 of the tutorial, of one frame."""
    folder = os.environ[SHOTS]
    exr = scene.render.filepath = os.path.join(folder, "graded.exr")
    scene.frame_set(GRADED)
    scene.render.image_settings.media_type = "MULTI_LAYER_IMAGE"
    with in_the_view():
        assert bpy.ops.render.render(write_still=True) == {"FINISHED"}
    made = bpy.data.scenes.new("Grade")
    tree = made.compositing_node_group = bpy.data.node_groups.new("Grade", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    image, exposure, balance = (
        tree.nodes.new(f"CompositorNode{kind}") for kind in ("Image", "Exposure", "ColorBalance")
    )
    image.image, image.layer = bpy.data.images.load(exr), "Composite"
    exposure.inputs["Exposure"].default_value = EXPOSURE
    for name, color in (("Lift", LIFT), ("Gain", GAIN)):
        next(one for one in balance.inputs if one.name == name and one.type == "RGBA").default_value = color
    tree.links.new(image.outputs["Combined"], exposure.inputs["Image"])
    tree.links.new(exposure.outputs["Image"], balance.inputs["Image"])
    tree.links.new(balance.outputs["Image"], tree.nodes.new("NodeGroupOutput").inputs["Image"])
    render, view = made.render, made.view_settings
    made.camera, render.engine, render.resolution_x, render.resolution_y = scene.camera, "BLENDER_WORKBENCH", 960, 720
    view.view_transform, view.look = "AgX", "AgX - High Contrast"
    render.image_settings.media_type, render.image_settings.file_format = "IMAGE", "JPEG"
    render.filepath = os.path.join(folder, "graded.jpg")
    with bpy.context.temp_override(scene=made):
        assert bpy.ops.render.render(write_still=True, scene=made.name) == {"FINISHED"}
    plain = os.path.join(folder, f"frame-{GRADED:04}")
    for one in (f"{plain}.png", os.path.join(folder, "graded.jpg")):
        subprocess.run(["convert", one, "-crop", PART, "+repage", f"{os.path.splitext(one)[0]}.jpg"], check=True)
    beside(
        "film-graded", {"As rendered, Standard": os.path.basename(plain), "Graded, AgX with high contrast": "graded"}
    )


def scenario():
    volume = yield from imported("mr-head", HEAD_MR)
    scene, render = bpy.context.scene, bpy.context.scene.render
    bpy.context.preferences.view.smooth_view = 0
    yield from turn_and_cut(scene, volume)
    with in_the_view():
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    scene.rle_splat.quality, scene.frame_start, scene.frame_end, scene.frame_step = "fine", 1, TURN, STEP
    scene.view_settings.view_transform, render.filepath = "Standard", os.path.join(os.environ[SHOTS], "frame-")
    scene.world = bpy.data.worlds.new("World")
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (*DARK, 1.0)
    render.engine, scene.cycles.samples = "CYCLES", SAMPLES
    render.resolution_x, render.resolution_y, render.image_settings.file_format = 960, 720, "PNG"
    ended, began = [], time.perf_counter()
    bpy.app.handlers.render_complete.append(lambda *_: ended.append(True))
    with in_the_view():
        bpy.ops.render.render("INVOKE_DEFAULT", animation=True)
    while not ended or bpy.app.is_job_running("RENDER"):
        yield
    assert not scene.rle_splat.render_problem, scene.rle_splat.render_problem
    print(f"{(time.perf_counter() - began) / len(range(1, TURN + 1, STEP)):.1f} s a frame")
    grade(scene)
    passed("film")


drive(scenario)
