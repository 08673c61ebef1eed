"""The film of the tutorial "From a scan to a graded film", by its steps in a real window: a plane opens a head.

    python3 dev.py blender --photograph tests/blender/record_film.py --size 1280x800

writes into build/window-shots/record_film its frames, of which devtools/example_figures.py makes how-to-opening.webp,
and film-keys.jpg, film-nodes.jpg and film-graded.jpg, the keyframes, the nodes and a frame in several view transforms
and graded, and prints the seconds of a frame.  The scan is HEAD_MR in tests/blender/data.  The frames from 60 to 120
are those of the way there, so they are not rendered.
"""

import os
import time

import bpy

from tests.blender.guide_steps import HEAD_MR, activate, beside, imported, keep, look_from
from tests.blender.scenes import module
from tests.blender.user_steps import settled
from tests.blender.window_driver import SHOTS, area_of, drive, in_the_view, passed, wait_for_rest, window

TURN, LAST, STEP = 60, 120, 2  # frames of the turn, and of all; each second one is shown
ANGLE, START, LENS = 40.0, 20.0, 78.0  # degrees, and mm
NODES = "1250x440+15+215"  # of the window: the nodes alone
KEYED = 40  # the frame of the picture of the keyframes
OUTSIDE = 0.09  # meters from the middle to the left
KEYS = (1, OUTSIDE), (50, 0.0), (70, 0.0), (LAST, OUTSIDE)  # frame, and meters
LEVEL, WINDOW = 90.0, 170.0
WALL, HALF = (0.0, 0.0, -1.6), 0.5  # the background's place before the camera, in meters, and half of its width
EDGE, GLOW = (0.008, 0.011, 0.017, 1.0), (0.055, 0.068, 0.095, 1.0)  # its colors
GRADED, EXPOSURE = 27, 0.3  # the frame of the picture
GRADES = (  # caption, view transform, look; the last is graded
    ("Standard", "Standard", "None"),
    ("AgX", "AgX", "None"),
    ("AgX, High Contrast", "AgX", "AgX - High Contrast"),
    ("Graded, AgX, High Contrast", "AgX", "AgX - High Contrast"),
)
LIFT, GAIN = (0.99, 1.0, 1.015, 1.0), (1.12, 1.0, 0.88, 1.0)  # bluish shadows, warm lights
SAMPLES = 8  # of Cycles, which renders the faces of the cut and the background alone


def turn_and_cut(scene, volume):
    """Section 2 of the tutorial."""
    curves_of = module("bridge.render.camera_path").curves_of
    with in_the_view():
        assert bpy.ops.rle_splat.turntable(
            filepath=os.path.join(os.environ[SHOTS], "turn"), frames=TURN, angle=ANGLE, azimuth=START, render=False
        ) == {"FINISHED"}  # fmt: skip
        scene.camera.data.lens = LENS
        scene.frame_set(1)
        pivot = scene.camera.parent
        pivot.keyframe_insert("rotation_euler", index=2, frame=LAST)
        bpy.ops.view3d.view_axis(type="RIGHT")  # of Blender: the patient's left
    yield from settled()
    with in_the_view():
        assert bpy.ops.rle_splat.cut_along_view() == {"FINISHED"}
    plane = bpy.context.view_layer.objects.active
    middle = plane.location.x
    for number, away in KEYS:
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
    yield from photograph_keys(scene, pivot, plane)


def light(scene, volume):
    """Section 3 of the tutorial: lights, and a plane behind the head that turns with the camera."""
    scene.frame_set(1)
    activate(volume)
    with in_the_view():
        assert bpy.ops.rle_splat.add_lights(kind="SKIN") == {"FINISHED"}
    bpy.ops.mesh.primitive_plane_add()
    wall = bpy.context.view_layer.objects.active
    wall.parent, wall.location, wall.scale = scene.camera, WALL, (HALF, HALF, 1.0)
    paint = bpy.data.materials.new("Background")
    tree = paint.node_tree
    names = "TexCoord", "TexGradient", "ValToRGB", "Emission"
    places, gradient, ramp, emission = (tree.nodes.new(f"ShaderNode{name}") for name in names)
    gradient.gradient_type = "SPHERICAL"
    for element, color in zip(ramp.color_ramp.elements, (EDGE, GLOW)):
        element.color = color
    tree.links.new(places.outputs["Object"], gradient.inputs["Vector"])
    tree.links.new(gradient.outputs["Fac"], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    wall.data.materials.append(paint)


def photograph_keys(scene, *keyed):
    """The plane from the side, with its handle, above the timeline with all keyframes."""
    view = area_of("VIEW_3D")
    with bpy.context.temp_override(window=window(), area=view):
        bpy.ops.screen.area_split(direction="HORIZONTAL", factor=0.2)
    yield
    below = min((one for one in window().screen.areas if one.type == "VIEW_3D"), key=lambda one: one.y)
    below.ui_type = "TIMELINE"
    scene.frame_set(KEYED)
    scene.frame_start, scene.frame_end = 1, LAST
    look_from(70.0, 40.0, 0.62)
    for one in keyed:
        one.select_set(True)
    activate(keyed[-1])
    yield from settled()
    yield from wait_for_rest()
    region = next(one for one in below.regions if one.type == "WINDOW")
    with bpy.context.temp_override(window=window(), area=below, region=region):
        bpy.ops.action.view_all()
    yield from wait_for_rest()
    yield from keep("film-keys")
    with bpy.context.temp_override(window=window(), area=below):
        bpy.ops.screen.area_close()
    yield from settled()


def photograph_nodes(scene):
    """The nodes of the last step."""
    window().scene = scene
    editor = area_of("VIEW_3D")
    editor.ui_type = "CompositorNodeTree"
    editor.spaces.active.show_region_ui = False
    editor.spaces.active.node_tree = scene.compositing_node_group
    yield from wait_for_rest()
    with bpy.context.temp_override(area=editor, region=next(one for one in editor.regions if one.type == "WINDOW")):
        bpy.ops.node.view_all()
    yield from wait_for_rest()
    yield from keep("film-nodes", NODES)


def grade(rendered):
    """Step 6 of the tutorial: the graded frames, and one frame in several view transforms."""
    folder, made = os.environ[SHOTS], bpy.data.scenes.new("Grade")
    tree = made.compositing_node_group = bpy.data.node_groups.new("Grade", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    kinds = "Image", "Exposure", "ColorBalance"
    image, exposure, balance = (tree.nodes.new(f"CompositorNode{kind}") for kind in kinds)
    output = tree.nodes.new("NodeGroupOutput")
    for number, node in enumerate((image, exposure, balance, output)):
        node.location.x = 260.0 * number
    image.image = bpy.data.images.load(rendered.render.frame_path(frame=rendered.frame_start))
    image.image.source, image.layer, image.frame_duration = "SEQUENCE", "Composite", LAST
    exposure.inputs["Exposure"].default_value = EXPOSURE
    for name, color in (("Lift", LIFT), ("Gain", GAIN)):
        next(one for one in balance.inputs if one.name == name and one.type == "RGBA").default_value = color
    tree.links.new(image.outputs["Combined"], exposure.inputs["Image"])
    tree.links.new(exposure.outputs["Image"], balance.inputs["Image"])
    tree.links.new(balance.outputs["Image"], output.inputs["Image"])
    render, view, names = made.render, made.view_settings, {}
    made.camera = rendered.camera
    render.engine, render.resolution_x, render.resolution_y = "BLENDER_WORKBENCH", 960, 720
    render.image_settings.media_type, render.image_settings.file_format = "IMAGE", "JPEG"
    made.frame_set(GRADED)
    for number, (caption, transform, look) in enumerate(GRADES):
        view.view_transform = transform
        view.look = look
        exposure.mute = balance.mute = number < len(GRADES) - 1
        names[caption] = f"graded-{number}"
        render.filepath = os.path.join(folder, f"graded-{number}.jpg")
        with bpy.context.temp_override(scene=made):
            assert bpy.ops.render.render(write_still=True, scene=made.name) == {"FINISHED"}
    beside("film-graded", names, across=2)
    made.frame_start, made.frame_end = rendered.frame_start, rendered.frame_end
    made.frame_step = rendered.frame_step
    render.image_settings.file_format, render.filepath = "PNG", os.path.join(folder, "frame-")
    with bpy.context.temp_override(scene=made):
        assert bpy.ops.render.render(animation=True, scene=made.name) == {"FINISHED"}
    yield from photograph_nodes(made)


def scenario():
    volume = yield from imported("mr-head", HEAD_MR)
    scene, render = bpy.context.scene, bpy.context.scene.render
    view = bpy.context.preferences.view
    view.smooth_view, view.render_display_type = 0, "NONE"
    yield from turn_and_cut(scene, volume)
    light(scene, volume)
    with in_the_view():
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    scene.rle_splat.quality, scene.frame_start, scene.frame_end, scene.frame_step = "fine", 1, TURN, STEP
    scene.view_settings.view_transform, render.filepath = "Standard", os.path.join(os.environ[SHOTS], "head_")
    scene.world = bpy.data.worlds.new("World")  # as in a new file
    render.engine, scene.cycles.samples = "CYCLES", SAMPLES
    render.resolution_x, render.resolution_y = 960, 720
    render.image_settings.media_type = "MULTI_LAYER_IMAGE"
    ended, began = [], time.perf_counter()
    bpy.app.handlers.render_complete.append(lambda *_: ended.append(True))
    with in_the_view():
        bpy.ops.render.render("INVOKE_DEFAULT", animation=True)
    while not ended or bpy.app.is_job_running("RENDER"):
        yield
    assert not scene.rle_splat.render_problem, scene.rle_splat.render_problem
    print(f"{(time.perf_counter() - began) / len(range(1, TURN + 1, STEP)):.1f} s a frame")
    yield from grade(scene)
    passed("film")


drive(scenario)
