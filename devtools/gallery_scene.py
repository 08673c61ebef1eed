"""One scene of the gallery, made headless (runs in an environment with bpy; one JSON job as argument).

Job: {"zip", "install": bool, "scene": a name of gallery_sets.SETS, "folder", "size": [width, height]}.  Beside its
picture the folder gets the .blend and these scripts; with the extension installed, and another zip to install or not,
they make it anew.
"""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path

import bpy
import gallery_data
from demo_scene import MODULE, enable, finish, render_settings, run
from gallery_sets import DATA_OF, SETS


def main(job: dict) -> int:
    folder, name = Path(job["folder"]), job["scene"]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    enable(job["zip"], job["install"])
    scene = bpy.context.scene
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))  # first: paths are kept relative to it
    path, options, source = getattr(gallery_data, DATA_OF[name])(folder)
    bpy.ops.rle_splat.import_volume(filepath=str(path), at_cursor=True, **options)
    volume_object = bpy.context.view_layer.objects.active
    render_settings(scene)
    scene.render.resolution_x, scene.render.resolution_y = job["size"]
    SETS[name](volume_object, folder)
    bpy.context.view_layer.objects.active = volume_object
    bpy.context.view_layer.update()

    # The second picture, made from nothing once more, has the prices: the first one also loads kernels.
    bpy.ops.rle_splat.render_image(use_meshes=True)
    import_module(f"{MODULE}.bridge.render_scene").forget_stages()
    bpy.ops.rle_splat.render_image(use_meshes=True)
    report = json.loads(scene.rle_splat.last_report_json)
    report["source"] = source
    bpy.ops.rle_splat.composite()
    scene.render.filepath = str(folder / "render.png")
    bpy.ops.render.render(write_still=True)
    scene.render.filepath = "//render.png"
    bpy.ops.wm.save_mainfile()
    return finish(folder, report)


if __name__ == "__main__":
    run(main)
