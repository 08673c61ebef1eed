"""A picture of each panel for the page of panels, photographed in a real window.

    python3 dev.py blender --photograph tests/blender/record_reference.py --size 1100x1700

writes panel-*.png and panel-presets.jpg, named after the titles of the panels, into
build/window-shots/record_reference.  In tests/blender/data is ``cta_aorta_labels``, the dissected aorta with its
segments.
"""

import os
import shutil
import subprocess
import tempfile
from functools import partial
from pathlib import Path

import bpy
import numpy as np

from tests.blender import scenes
from tests.blender.guide_steps import DATA, HEART, SCANS, activate, begin, masks
from tests.blender.scenes import module
from tests.blender.user_steps import drag, press, settled
from tests.blender.window_driver import (
    SHOTS,
    area_of,
    drive,
    in_the_view,
    open_panels,
    passed,
    photograph,
    region_of,
    wait_for_rest,
    window,
)

SCALE = 1.25  # of the interface
TAB = "One Panel"
TABS, EDGE = 26, 4  # pixels: of the tabs beside the panels, and of the sidebar's edge
WIDER = 50  # pixels more than the sidebar has at first, for the names of segments
HEADERS = 15, 42, 68  # pixels from the end of Render up to the titles of its closed parts
PHOTOGRAPHS = "Presets"  # is smaller as a JPEG
COLORS, QUALITY = 128, 50  # of a PNG and of a JPEG


def record(name: str):
    """A picture of one panel, open and alone in a tab of its own, with the panels in it closed."""
    made = []
    for one in module("panels").CLASSES:
        if one.__name__ == f"RLE_SPLAT_PT_{name}":
            made.append(alone(one, bl_options=set(), bl_parent_id=""))
        elif getattr(one, "bl_parent_id", "") == f"RLE_SPLAT_PT_{name}":
            made.append(alone(one, bl_options={"DEFAULT_CLOSED"}, bl_parent_id=made[0].__name__))
    yield
    region_of(area_of("VIEW_3D"), "UI").active_panel_category = TAB
    yield from wait_for_rest()
    end = yield from crop(made[0].bl_label)
    if name == "picture":
        for above in HEADERS:
            yield from press("LEFTMOUSE", (region_of(area_of("VIEW_3D"), "UI").x + 100, end + above))
        yield from crop(made[0].bl_label)
    for one in reversed(made):
        bpy.utils.unregister_class(one)
    passed(name)


def alone(panel, **options):
    """A panel as another one has it, in the tab of the pictures."""
    own = {key: value for key, value in vars(panel).items() if key not in ("bl_rna", "__dict__", "__weakref__")}
    made = type(f"{panel.__name__}_alone", panel.__bases__, own | {"bl_category": TAB, **options})
    bpy.utils.register_class(made)
    return made


def crop(title: str):
    """A photograph from the top of the sidebar to the panel's end; returns the height of this end in the window."""
    name = f"panel-{title.lower().replace(' ', '-')}"
    yield from photograph(name)
    path, region = Path(os.environ[SHOTS]) / f"{name}.png", region_of(area_of("VIEW_3D"), "UI")
    above = window().height - region.y - region.height
    shown = scenes.load_pixels(path)[above:][: region.height - EDGE, region.x : region.x + region.width - TABS]
    rows = np.abs(shown - shown[-1, EDGE]).max(axis=(1, 2)) > 0.01
    height = np.flatnonzero(rows).max() + EDGE
    part = f"{path}[{shown.shape[1]}x{height}+{region.x}+{above}]"
    target, words = f"PNG8:{path}", ("-dither", "None", "-colors", COLORS)
    if title == PHOTOGRAPHS:
        target, words = path.with_suffix(".jpg"), ("-quality", QUALITY)
    subprocess.run(["convert", part, "+repage", *map(str, (*words, target))], check=True)
    if title == PHOTOGRAPHS:
        path.unlink()
    return window().height - above - height


def a_scan():
    """A CT with lights, a cut, slices and a channel, which renders show."""
    SCANS.mkdir(parents=True, exist_ok=True)
    heart, lumens = SCANS / "Heart.nii.gz", SCANS / "Lumens.nii.gz"
    shutil.copyfile(DATA / HEART, heart)
    shutil.copyfile(masks() / "aorta_lumens.nii.gz", lumens)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")  # as in a new file
    scene.view_settings.view_transform = "Standard"
    scenes.add_camera((0.0, -1.0, 0.0))
    with in_the_view():
        assert bpy.ops.rle_splat.import_volume(filepath=str(heart), preset="ct-heart") == {"FINISHED"}
        volume = bpy.context.object
        for step in (
            bpy.ops.rle_splat.add_lights,
            partial(bpy.ops.rle_splat.add_cutting_object, kind="BOX"),
            partial(bpy.ops.rle_splat.add_cutting_object, kind="PLANE"),
            partial(bpy.ops.rle_splat.add_slice, kind="ALL"),
            partial(bpy.ops.rle_splat.import_channel, filepath=str(lumens)),
            bpy.ops.rle_splat.show_in_renders,
        ):
            activate(volume)
            assert step() == {"FINISHED"}
        activate(volume)
    yield from settled()
    return volume


def add_segments(volume):
    volume.rle_splat.label_file = str(masks())
    with in_the_view():
        assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
        assert bpy.ops.rle_splat.color_by_anatomy() == {"FINISHED"}
    volume.rle_splat.active_label = 2
    yield from settled()


def a_series():
    """A ball that grows in time."""
    folder = Path(tempfile.mkdtemp(prefix="rle_splat_series_"))
    distance = np.linalg.norm(np.mgrid[:32, :32, :32] - 15.5, axis=0)
    for number in range(1, 13):
        (folder / f"ball_32x32x32_uint8_{number:04}.raw").write_bytes(
            np.uint8(200 * (distance < 5 + number / 2)).tobytes()
        )
    with in_the_view():
        assert bpy.ops.rle_splat.import_volume(
            filepath=str(folder / "ball_32x32x32_uint8_0001.raw"), shape=(32, 32, 32), dtype="uint8", use_sequence=True
        ) == {"FINISHED"}  # fmt: skip
    bpy.context.object.rle_splat.playback = "LOOP"
    yield from settled()


def wide_sidebar():
    """A new file with a sidebar that is wider than at first."""
    yield from begin()
    bpy.context.preferences.view.ui_scale = SCALE
    yield
    sidebar = region_of(area_of("VIEW_3D"), "UI")
    yield from drag("LEFTMOUSE", (sidebar.x, sidebar.y + sidebar.height // 4), [(-WIDER // 2, 0)] * 2)


def scenario():
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_display", "RLE_SPLAT_PT_presets")
    yield from wide_sidebar()
    volume = yield from a_scan()
    yield from wait_for_rest()  # with the pictures of presets
    for name in ("volume", "display", "presets", "transfer", "shading", "material", "clip_objects", "slices"):
        yield from record(name)
    yield from add_segments(volume)
    for name in ("labels", "channels", "picture", "scan"):
        yield from record(name)
    bpy.context.scene.rle_splat.quality = "custom"
    yield from record("advanced")
    yield from wide_sidebar()
    yield from a_series()
    yield from record("playback")
    shutil.rmtree(SCANS)


drive(scenario, overlap=False)
