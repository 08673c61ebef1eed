"""What 3D views of a real window show after F12 and after an animation, with and without Lock Interface: the volume as
the scene is then.

    python3 dev.py blender --photograph tests/blender/window_after_render.py --size 1280x800
"""

import os
import subprocess
import tempfile
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Euler

from tests.blender import scenes
from tests.blender.real_blender import N, import_cube, pixels_of
from tests.blender.scenes import module
from tests.blender.window_driver import (
    SHOTS,
    area_of,
    drive,
    in_the_view,
    new_file,
    passed,
    photograph,
    region_of,
    until,
    wait_for_rest,
)

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_after_"))
COLOR, DISPLAYED = (0.5, 0.18, 0.05), (188, 118, 63)  # linear, and what Standard makes of it
AWAY = 14.0  # units by which the volume has moved in the last frame
MIDDLE = np.full(3, 0.5 * (N - 1))


def set_up():
    yield from new_file()
    scene = bpy.context.scene
    scene.view_settings.view_transform = "Standard"
    with in_the_view():
        volume = import_cube(FOLDER)
    functions = module("rle_splat.classify.transfer_function")
    module("bridge.look.transfer").write_transfer(volume, functions.TransferFunction(
        name="opaque", unit=None, opacity=((0.0, 0.9), (255.0, 0.9)), color=((0.0, *COLOR), (255.0, *COLOR)),
        opacity_unit_distance=1.0, shade=None))  # fmt: skip
    for frame, x in ((1, 0.0), (4, AWAY)):
        volume.location.x = x
        volume.keyframe_insert("location", frame=frame)
    scene.frame_start, scene.frame_end = 1, 4
    scenes.use_cycles((256, 256), samples=16)
    scenes.add_mesh([(-40, -40, -9), (60, -40, -9), (60, 60, -9), (-40, 60, -9)], [(0, 1, 2, 3)], (0.1, 0.1, 0.1))
    scenes.add_camera((MIDDLE[0], MIDDLE[1], 60.0), type="ORTHO", ortho_scale=2.0 * AWAY)
    scene.frame_set(1)
    space = area_of("VIEW_3D").spaces.active
    space.overlay.show_cursor = space.overlay.show_object_origins = space.overlay.show_extras = False
    view = space.region_3d
    view.view_location, view.view_distance, view.view_rotation = MIDDLE, 60.0, Euler((0.0, 0.0, 0.0)).to_quaternion()
    view.update()
    bpy.context.preferences.view.render_display_type = "NONE"
    with in_the_view():
        bpy.context.view_layer.objects.active = volume
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
        assert bpy.ops.rle_splat.add_slice(kind="AXIAL") == {"FINISHED"}
    cut = bpy.context.view_layer.objects.active
    for frame, z in ((1, cut.location.z), (4, cut.location.z + 3.0 * N)):  # outside of the volume
        cut.location.z = z
        cut.keyframe_insert("location", frame=frame)
    scene.frame_set(1)
    area_of("PROPERTIES").type = "IMAGE_EDITOR"  # draws the picture that a render writes
    area_of("IMAGE_EDITOR").spaces.active.image = scene.rle_splat.composite_image
    yield from photograph("before")


def screen(name: str) -> np.ndarray:
    """The screen as it is, (H, W, 3), 0 to 255, row 0 at the top; nothing is drawn for it."""
    path = Path(os.environ[SHOTS]) / f"{name}.png"
    subprocess.run(["import", "-window", "root", str(path)], check=True)
    return scenes.load_pixels(path)[..., :3] * 255.0


def is_volume(color) -> bool:
    return bool(np.abs(color - DISPLAYED).max() < 6.0)


def seen(name: str) -> list:
    """Whether the screen, as it is, shows the volume where it is in the first frame, and in the last one."""
    pixels = screen(name)
    region, view = region_of(area_of("VIEW_3D"), "WINDOW"), area_of("VIEW_3D").spaces.active.region_3d
    found = []
    for x in (0.0, AWAY):
        place = location_3d_to_region_2d(region, view, MIDDLE + (x + 0.6, 0.7, 0.5 * (N - 1)))
        shown = pixels[len(pixels) - int(region.y + place.y), int(region.x + place.x)]
        print(f"{name}: {x} shows {shown}", flush=True)
        found.append(is_volume(shown))
    return found


def check(animation: bool, lock: bool):
    scene, name = bpy.context.scene, f"{'animation' if animation else 'still'}, {'locked' if lock else 'not locked'}"
    cut = next(one.rle_splat.slice_image for one in scene.objects if one.rle_splat.is_slice)
    scene.render.use_lock_interface = lock
    # Blender crashes at times where it draws an image that an unlocked render writes.
    area_of("IMAGE_EDITOR").spaces.active.image = scene.rle_splat.composite_image if lock else None
    yield
    done, drawn, before = [], [], pixels_of(cut).copy()
    slices = module("bridge.live.slice_drawing")
    draw = slices._draw_picture
    slices._draw_picture = lambda *given: drawn.append(bpy.app.is_job_running("RENDER")) or draw(*given)

    def note(*_):
        done.append(True)

    scenes.write_exr(FOLDER / "frame_#.exr")
    bpy.app.handlers.render_complete.append(note)
    with in_the_view():
        bpy.ops.render.render("INVOKE_DEFAULT", animation=animation)

    redraws = 0
    while not done or bpy.app.is_job_running("RENDER"):
        area_of("VIEW_3D").tag_redraw()  # as the mouse does that moves over it
        redraws += 1
        yield
        yield
    assert redraws > 1, "the render has ended before the view was drawn"
    bpy.app.handlers.render_complete.remove(note)
    yield from wait_for_rest()
    slices._draw_picture = draw
    assert seen(name) == [True, False]
    assert drawn and not any(drawn), f"{drawn}: slices are drawn after a render, and not while it writes their pictures"
    np.testing.assert_array_equal(pixels_of(cut), before)
    assert scene.render.use_lock_interface == lock
    problem = scene.rle_splat.render_problem
    assert not problem if lock else "Lock Interface is off" in problem, problem
    passed(name)


def check_viewport_compositor():
    """A composited viewport shows the picture of the last render, alone and with a sentence; others are live."""
    live, area = module("bridge.live"), area_of("VIEW_3D")
    shading = area.spaces.active.shading
    bpy.context.scene.render.engine = "BLENDER_WORKBENCH"  # has fewer shaders to compile than EEVEE
    solid, shading.type = shading.type, "RENDERED"
    area.spaces.active.show_region_ui = False
    region = region_of(area, "WINDOW")
    row, column = -(region.y + region.height // 2), region.x + region.width // 2 + 105  # of the last frame's volume
    for use, is_live in (("ALWAYS", False), ("CAMERA", True), ("DISABLED", True)):
        shading.use_compositor = use
        area.tag_redraw()
        yield from wait_for_rest()
        if use == "ALWAYS":  # once the compositor has its shaders
            yield from until(lambda: is_volume(screen("composited")[row, column]))
        yield from photograph(f"composited {use.lower()}")
        assert bool(live.viewports_of(area)) == is_live, use
    shading.type = solid
    yield from wait_for_rest()
    passed("viewport compositor")


def check_later_links():
    """A link that is drawn from the Render Layers to another output is led through our Alpha Over by itself."""
    tree = module("bridge.versions").compositor_tree(bpy.context.scene)
    layers = next(node for node in tree.nodes if node.bl_idname == "CompositorNodeRLayers")
    viewer = tree.nodes.new("CompositorNodeViewer")
    area_of("IMAGE_EDITOR").ui_type = "CompositorNodeTree"
    tree.links.new(layers.outputs["Image"], viewer.inputs[0])
    yield from until(lambda: viewer.inputs[0].links[0].from_node.bl_idname == "CompositorNodeAlphaOver")
    yield from photograph("later links")
    passed("later links")


def scenario():
    yield from set_up()
    yield from wait_for_rest()
    assert seen("at first") == [True, False]
    for animation in (False, True):
        for lock in (False, True):
            yield from check(animation, lock)
    yield from check_viewport_compositor()
    yield from check_later_links()


drive(scenario, overlap=False)
