"""Ten steps of a user's first hour, by mouse and keys where a user has them: a photograph of each.

    python3 dev.py blender --photograph tests/blender/window_film.py --size 1280x1000

keeps them in build/window-shots/window_film and prints how long the volume takes to show after its import.
"""

import tempfile
import time
from math import radians
from pathlib import Path

import bpy
import numpy as np
from mathutils import Euler

from tests.blender.user_steps import drag, middle, press, refined, settled, simulate, viewport
from tests.blender.window_driver import (
    area_of,
    drive,
    in_the_view,
    new_file,
    open_panels,
    passed,
    photograph,
    until,
)

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_film_"))
SIDE, SPACING = 128, 2.0  # voxels along each side, mm


def phantom() -> Path:
    """A scan in Hounsfield units: skin, a skull with two holes, and what it holds."""
    z, y, x = (np.mgrid[:SIDE, :SIDE, :SIDE].astype(np.float32) - (SIDE - 1) / 2) / (SIDE / 2)
    apart = np.sqrt((x / 0.7) ** 2 + (y / 0.85) ** 2 + (z / 0.8) ** 2)
    values = np.full(apart.shape, -1000.0, np.float32)
    values[apart < 1.0] = 40.0
    values[(apart < 0.92) & (apart > 0.82)] = 900.0
    values[(x - 0.25) ** 2 + (y + 0.75) ** 2 + z**2 < 0.03] = 40.0
    values[(x + 0.25) ** 2 + (y + 0.75) ** 2 + z**2 < 0.03] = 40.0
    values[apart < 0.6] = 60.0 + 20.0 * np.sin(20.0 * x[apart < 0.6])
    path = FOLDER / f"head_{SIDE}x{SIDE}x{SIDE}_int16.raw"
    values.astype(np.int16).tofile(path)
    labels = (apart < 0.6).astype(np.uint8) + 2 * ((apart >= 0.6) & (apart < 1.0)).astype(np.uint8)
    labels.tofile(FOLDER / f"parts_{SIDE}x{SIDE}x{SIDE}_uint8.raw")
    return path


def default_scene():
    """What a new file of Blender holds: a cube of 2 m in the middle, a light and a camera."""
    yield from new_file()
    with in_the_view():
        bpy.ops.mesh.primitive_cube_add(size=2.0)
    scene = bpy.context.scene
    light = bpy.data.objects.new("Light", bpy.data.lights.new("Light", "POINT"))
    light.location, light.data.energy = (4.1, 1.0, 5.9), 1000.0
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (7.36, -6.93, 4.96), (1.109, 0.0, 0.815)
    for one in (light, camera):
        scene.collection.objects.link(one)
    scene.camera = camera
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.resolution_x, scene.render.resolution_y = 480, 360


def import_steps(path, use_headlight):
    """Import a scan, and print how long it takes until it shows, and until it is refined."""
    began, read, drafted = time.perf_counter(), None, None
    with in_the_view():
        # As the dialog of File > Import does it, whose own button a film cannot know the place of.
        assert bpy.ops.rle_splat.import_volume(
            "INVOKE_DEFAULT", filepath=str(path), value_unit="HU", modality="CT", spacing=(SPACING,) * 3,
            use_dialog=False, use_headlight=use_headlight) == {"RUNNING_MODAL"}  # fmt: skip
    yield from until(lambda: any(one.rle_splat.is_volume for one in bpy.data.objects))
    read = time.perf_counter() - began
    volume = bpy.context.view_layer.objects.active

    def is_drafted():
        nonlocal drafted
        if drafted is None and viewport() is not None and viewport().pictures:
            drafted = time.perf_counter() - began
        return drafted is not None and not viewport().is_busy

    yield from until(is_drafted)
    print(f"read after {read:.1f} s, shown after {drafted:.1f} s, refined after {time.perf_counter() - began:.1f} s "
          "(looked at at each step)", flush=True)  # fmt: skip
    return volume


def orbit():
    before = viewport().counts.copy()
    yield from drag("MIDDLEMOUSE", middle(), [(12, 4)] * 10)
    yield from settled()
    found = {name: viewport().counts[name] - before[name] for name in ("drafts", "refinements")}
    print(f"orbit: {found}", flush=True)
    assert found["drafts"] >= 2 and found["refinements"] >= 1


def window_and_level(volume):
    with in_the_view():
        bpy.ops.rle_splat.use_window_tool()
    width = volume.rle_splat.window_width
    yield from drag("LEFTMOUSE", middle(), [(8, 3)] * 6)
    yield from settled()
    assert volume.rle_splat.window_width != width
    with in_the_view():
        bpy.ops.wm.tool_set_by_id(name="builtin.select_box")
        bpy.ops.rle_splat.apply_preset(preset="ct-bone")
    yield from settled()


def preset(volume):
    with in_the_view():
        assert bpy.ops.rle_splat.apply_preset(preset="ct-skin") == {"FINISHED"}
    yield from settled()
    assert "skin" in volume.rle_splat.transfer_name.lower(), volume.rle_splat.transfer_name


def mesh_through(volume):
    """A sphere, moved by G and the mouse to where it passes through the volume."""
    with in_the_view():
        bpy.ops.mesh.primitive_uv_sphere_add(radius=0.06, segments=32, ring_count=16)
    ball = bpy.context.view_layer.objects.active
    ball.location = volume.matrix_world.translation + volume.matrix_world.to_3x3() @ (0.5 * volume.dimensions)
    ball.location.y -= 0.09
    yield from settled()
    before, place = viewport().counts["drafts"], ball.location.copy()
    yield from press("G", middle())
    for step in range(1, 7):
        simulate("MOUSEMOVE", "NOTHING", middle(10.0 * step, 6.0 * step))
        yield
    yield from press("RET", middle(60.0, 36.0))
    yield from settled()
    assert (ball.location - place).length > 0.0 and viewport().counts["drafts"] > before
    bpy.context.view_layer.objects.active = volume


def cut(volume):
    bpy.data.objects.remove(bpy.data.objects["Sphere"])
    with in_the_view():
        assert bpy.ops.rle_splat.cut_along_view() == {"FINISHED"}
    yield from settled()


def segments(volume):
    for one in list(bpy.context.scene.rle_splat.clip_objects.objects):
        bpy.data.objects.remove(one)
    bpy.context.view_layer.objects.active = volume
    volume.rle_splat.label_file = str(FOLDER / f"parts_{SIDE}x{SIDE}x{SIDE}_uint8.raw")
    with in_the_view():
        assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    yield from settled()
    shells = next(one for one in volume.rle_splat.labels if one.label == 2)
    shells.show = False
    yield from settled()


def slices(volume):
    next(one for one in volume.rle_splat.labels if one.label == 2).show = True
    with in_the_view():
        assert bpy.ops.rle_splat.add_slice(kind="ALL") == {"FINISHED"}
    yield from refined()  # with the pictures of the slices, which the photograph shows


def f12(volume):
    camera = bpy.context.scene.camera
    camera.matrix_world = area_of("VIEW_3D").spaces.active.region_3d.view_matrix.inverted()
    bpy.context.view_layer.objects.active = volume
    with in_the_view():
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    ended = []
    bpy.app.handlers.render_complete.append(lambda *_: ended.append(True))
    yield from press("F12", middle())
    yield from until(lambda: ended and not bpy.app.is_job_running("RENDER"))
    path = FOLDER / "render.png"
    bpy.data.images["Render Result"].save_render(str(path))
    image = bpy.data.images.load(str(path))
    pixels = np.array(image.pixels[:]).reshape(image.size[1], image.size[0], 4)
    assert pixels[..., :3].std() > 0.02, "the render is blank"


def save(_volume):
    with in_the_view():
        assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    yield
    assert bpy.context.scene.rle_splat.image is not None


def scenario():
    bpy.context.preferences.view.render_display_type = "NONE"
    open_panels("RLE_SPLAT_PT_display", "RLE_SPLAT_PT_presets", "RLE_SPLAT_PT_clip_objects", "RLE_SPLAT_PT_labels")
    path = phantom()
    yield from default_scene()
    for use_headlight, name in ((False, "00_scene_lights"), (True, "01_import")):  # the first loads kernels
        yield from default_scene()
        volume = yield from import_steps(path, use_headlight)
        region = area_of("VIEW_3D").spaces.active.region_3d
        region.view_rotation = Euler((radians(75.0), 0.0, radians(25.0))).to_quaternion()
        yield from settled()
        yield from photograph(name)
    assert bpy.context.scene.rle_splat.lighting == "HEADLIGHT"
    passed("import")
    steps = (
        ("orbit", orbit), ("window", lambda: window_and_level(volume)), ("preset", lambda: preset(volume)),
        ("mesh", lambda: mesh_through(volume)), ("cut", lambda: cut(volume)), ("segments", lambda: segments(volume)),
        ("slices", lambda: slices(volume)), ("render", lambda: f12(volume)), ("save", lambda: save(volume)),
    )  # fmt: skip
    for number, (name, step) in enumerate(steps, start=2):
        yield from step()
        yield from photograph(f"{number:02d}_{name}")
        passed(name)


drive(scenario, overlap=False)
