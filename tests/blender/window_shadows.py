"""The volume's shadow on meshes in a real window: its switch and its row in the panels, and F12 on the render thread.

    python3 dev.py blender --photograph tests/blender/window_shadows.py --size 1280x800

It renders with EEVEE, for a Blender built without NanoVDB casts no shadow of a grid in Cycles.
"""

import math
import tempfile
from pathlib import Path

import bpy
import numpy as np

from tests.blender import panel_states, scenes
from tests.blender.scenes import module
from tests.blender.window_driver import (
    drive,
    in_the_view,
    new_file,
    open_panels,
    passed,
    photograph,
    until,
    wait_for_rest,
)

FLOOR = -6.0  # its height below the ball


def folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="rle_splat_shadows_"))


def add_scene():
    """A ball of the panels' states over a white floor, under a sun that comes from the right, seen from the front."""
    owner = panel_states.add_volume(folder())
    scene = bpy.context.scene
    scenes.load_color(folder(), (0.8, 0.2, 0.1), alpha=0.9)
    scenes.add_white_floor(30.0).location.z = FLOOR
    light = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    light.data.energy, light.rotation_euler = math.pi, (0.0, math.radians(50.0), 0.0)
    scene.collection.objects.link(light)
    camera = scene.camera
    camera.location, camera.rotation_euler = (3.5, -30.0, 22.0), (math.radians(55.0), 0.0, 0.0)
    camera.data.ortho_scale = 36.0
    scene.render.engine = "BLENDER_EEVEE" if bpy.app.version >= (5, 0) else "BLENDER_EEVEE_NEXT"
    scene.render.resolution_x, scene.render.resolution_y = 320, 240
    scene.eevee.taa_render_samples = 2
    scene.render.compositor_device = "CPU"
    scene.view_settings.view_transform = "Standard"
    bpy.context.view_layer.objects.active = owner
    return owner


def rendered(path: Path):
    """Press F12 and wait; returns the pixels, (H, W, 4), row 0 on top."""
    done = []

    def note(*_):
        done.append(True)

    bpy.app.handlers.render_complete.append(note)
    bpy.context.preferences.view.render_display_type = "NONE"
    with in_the_view():
        bpy.ops.render.render("INVOKE_DEFAULT")
    yield from until(lambda: done and not bpy.app.is_job_running("RENDER"))
    bpy.app.handlers.render_complete.remove(note)
    scenes.write_exr(path)
    bpy.data.images["Render Result"].save_render(str(path), scene=bpy.context.scene)
    return scenes.load_pixels(path)


def scenario():
    open_panels("RLE_SPLAT_PT_shading", "RLE_SPLAT_PT_picture", "RLE_SPLAT_PT_diagnostics", "RLE_SPLAT_PT_effects")
    yield from new_file()
    shadows = module("bridge.render.mesh_shadows")
    with in_the_view():
        add_scene()
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    scene = bpy.context.scene
    yield
    grid = shadows.grids(scene)[0]
    assert not grid.visible_get()
    pictures = {}
    for state in ("off", "auto"):
        scene.rle_splat.effect_overrides.shadows_on_meshes = state
        yield from until(lambda state=state: bool(shadows.grids(scene)) == (state == "auto"))
        pictures[state] = yield from rendered(folder() / f"{state}.exr")
        row = scene.rle_splat.effect_rows["shadows on meshes"]
        assert row.on == (state == "auto"), row.reason
    passed("F12 on the render thread")
    apart = np.abs(pictures["off"] - pictures["auto"])[..., :3].max(axis=2)[60:100, 135:185]
    print(f"where the ball is the pictures differ by at most {apart.max():.3f}")
    assert apart.max() < 0.02, "the grid or its surface is drawn over the volume"
    lost = (pictures["off"] - pictures["auto"])[..., :3].mean(axis=2)
    print(f"the shadow takes {lost.max():.2f} of the floor's light, on {np.mean(lost > 0.2):.1%} of the picture")
    assert np.mean(lost > 0.2) > 0.005
    with in_the_view():
        assert bpy.ops.rle_splat.list_effects() == {"FINISHED"}
    yield from photograph("panels")
    passed("the panels")
    for area in bpy.context.window.screen.areas:
        if area.type == "PROPERTIES":
            area.type = "IMAGE_EDITOR"
            area.spaces.active.image = bpy.data.images["Render Result"]
    yield from wait_for_rest()
    yield from photograph("picture")
    with in_the_view():
        bpy.ops.ed.undo_push(message="before")
        assert bpy.ops.rle_splat.remove_from_renders() == {"FINISHED"}
        bpy.ops.ed.undo_push(message="removed")
        assert not shadows.grids(bpy.context.scene)
        bpy.ops.ed.undo()
    yield from until(lambda: len(shadows.grids(bpy.context.scene)) == 1)
    passed("undo")


drive(scenario, overlap=False)
