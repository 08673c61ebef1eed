"""One scene of the gallery, made headless (runs in an environment with bpy; one JSON job as argument).

Job: {"zip", "install": bool, "scene": a name of gallery_sets.SETS, "folder", "size": [width, height]}.  Beside its
picture the folder gets the .blend and these scripts; with the extension installed, and another zip to install or not,
they make it anew.
"""

from __future__ import annotations

import json
import os
import sys
from importlib import import_module
from pathlib import Path

import bpy
import gallery_data
from demo_scene import MODULE, covered, enable, render_settings
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
    fraction = covered(scene.rle_splat.image)
    bpy.ops.rle_splat.composite()
    scene.render.filepath = str(folder / "render.png")
    bpy.ops.render.render(write_still=True)
    scene.render.filepath = "//render.png"
    bpy.ops.wm.save_mainfile()
    report.update(blender=bpy.app.version_string, source=source, covered_fraction=round(fraction, 4))
    (folder / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    if fraction == 0.0 or scene.rle_splat.message:
        print(scene.rle_splat.message or "The picture shows nothing of the volume.", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    try:
        code = main(json.loads(sys.argv[1]))
    except RuntimeError as problem:  # what an operator reports comes as a RuntimeError
        print(problem, file=sys.stderr)
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # bpy 4.5 can hang when the interpreter ends with its classes registered
