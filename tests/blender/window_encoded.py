"""A folder of tables in a real window: drawn in larger voxels first, then in all; its panels; and when it breaks.

    python3 dev.py blender --photograph tests/blender/window_encoded.py --size 1280x1400

keeps the photographs in build/window-shots/window_encoded.
"""

import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Quaternion

from tests.blender import scenes
from tests.blender.real_blender import MODULE
from tests.blender.scenes import module
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

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_encoded_"))
SIDE = 96


def add_folder() -> Path:
    """A shaded ball with holes as a folder of post-classified tables, which also holds voxels twice as large."""
    z, y, x = np.mgrid[:SIDE, :SIDE, :SIDE] - (SIDE - 1) / 2
    holes = 60.0 * np.cos(0.4 * x) * np.cos(0.4 * y) * np.cos(0.4 * z)
    voxels = np.clip(300.0 - 6.0 * np.sqrt(x**2 + y**2 + z**2) + holes, 0.0, 255.0).astype(np.uint8)
    scan = scenes.import_raw(FOLDER, voxels, name="scan")
    plain, quality = module("bridge.scene.render_scene").read_scene(
        scan, bpy.context.evaluated_depsgraph_get(), with_meshes=False
    )
    encode_folder = module("rle_splat.pipeline.encode_folder")
    encode_folder.COARSE_VOXELS = SIDE**3 // 4
    path = FOLDER / "ball.rle"
    encode_folder.encode_folder(plain, path, quality.classified("post"), source="scan.raw")
    bpy.data.objects.remove(scan)
    return path


def viewports():
    return module("bridge.live").viewports_of(area_of("VIEW_3D"))


def shown_and_refined():
    """2: the picture of a view at rest has all voxels, after a draft."""
    yield from new_file()
    scenes.add_camera((48.0, 48.0, 400.0), type="ORTHO", ortho_scale=150.0)
    path = add_folder()
    with in_the_view():  # as the entry of the menu does after the file was chosen
        assert bpy.ops.rle_splat.import_volume(
            "INVOKE_DEFAULT", filepath=str(path / "header.json"), use_dialog=False
        ) == {"RUNNING_MODAL"}
    yield from until(lambda: bpy.context.view_layer.objects.active is not None)
    assert bpy.context.object.rle_splat.stored_transfer
    yield from until(lambda: any(one.pictures for one in viewports()))
    yield from until(lambda: all(one.is_refined and not one.is_busy for one in viewports()))
    assert viewports()[0].halvings == 0 and viewports()[0].counts["drafts"]
    yield from photograph("2-refined")


def orbited():
    """An orbit shows drafts of the larger voxels, and all voxels at its end."""
    view, shown = area_of("VIEW_3D").spaces.active.region_3d, viewports()[0]
    for _ in range(8):
        before = shown.counts["drafts"]
        view.view_rotation = Quaternion((0.0, 0.0, 1.0), 0.05) @ view.view_rotation
        area_of("VIEW_3D").tag_redraw()
        yield from until(lambda before=before: shown.counts["drafts"] > before)
        assert shown.is_refined or shown.halvings == 1
    yield from until(lambda: shown.is_refined and not shown.is_busy)
    assert shown.halvings == 0


def rendered():
    """F12 makes the picture of all voxels."""
    scene = bpy.context.scene
    scenes.use_cycles((400, 400))
    scene.camera.data.clip_end, ended = 1000.0, []
    scene.render.filepath = str(FOLDER / "render.png")
    bpy.app.handlers.render_complete.append(lambda *_: ended.append(True))
    with in_the_view():
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
        assert bpy.ops.render.render("INVOKE_DEFAULT", write_still=True) == {"RUNNING_MODAL"}
    yield from until(lambda: ended and not bpy.app.is_job_running("RENDER"))
    assert scene.rle_splat.message == "" and scenes.load_pixels(FOLDER / "render.png")[..., 3].max() > 0.9


def drafts_alone():
    """1: the draft has larger voxels, which stay with refining switched off in the preferences."""
    preferences = bpy.context.preferences.addons[MODULE].preferences
    preferences.refine_live = False
    bpy.context.object.rotation_euler.z = 0.1
    yield from until(lambda: viewports()[0].halvings == 1 and not viewports()[0].is_busy)
    yield from photograph("1-larger-voxels")
    preferences.refine_live = True


def cut_while_shown():
    """3: files that are cut are a sentence in the panel, whatever axis the view is along."""
    for path in (FOLDER / "ball.rle").glob("*.scalars"):
        path.write_bytes(path.read_bytes()[:1000])
    bpy.context.object.rotation_euler.z = 0.2
    live = module("bridge.live")
    yield from until(lambda: ".scalars" in live.problem_of(area_of("VIEW_3D")))
    yield from photograph("3-cut")


def scenario():
    open_panels("RLE_SPLAT_PT_display", "RLE_SPLAT_PT_transfer", "RLE_SPLAT_PT_shading", "RLE_SPLAT_PT_scan",
                "RLE_SPLAT_PT_labels")  # fmt: skip
    for step in (shown_and_refined, orbited, rendered, drafts_alone, cut_while_shown):
        yield from step()
        passed(step.__name__)


drive(scenario, overlap=False)
