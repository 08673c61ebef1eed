"""One scene of the gallery, made headless (runs in an environment with bpy; one JSON job as argument).

Job: {"zip", "install": bool, "scene": a name of gallery_sets.SETS, "folder", "size": [width, height], "samples"}.
Beside its pictures the folder gets the .blend and these scripts; with the extension installed, and another zip to
install or not, they make it anew.  In handed-out/ is the .blend for others, which looks for the scan beside it.
"""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path

import bpy
import gallery_data
from demo_scene import enable, finish, render_settings, run
from gallery_sets import SETS
from gallery_studio import Stage


def main(job: dict) -> int:
    folder, name = Path(job["folder"]), job["scene"]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    enable(job["zip"], job["install"])
    scene = bpy.context.scene
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))  # first: paths are kept relative to it
    path, options, source = getattr(gallery_data, name)(folder)
    bpy.ops.rle_splat.import_volume(filepath=str(path), at_cursor=True, **options)
    stage = Stage.of(bpy.context.view_layer.objects.active, folder)
    render_settings(scene)
    scene.cycles.samples = job["samples"]
    scene.render.resolution_x, scene.render.resolution_y = job["size"]
    reports, parts = [], []
    for picture in SETS[name](stage):
        bpy.context.view_layer.objects.active = stage.volume
        bpy.context.view_layer.update()
        if not reports:
            reports.append(_priced(scene))
            bpy.ops.rle_splat.show_in_renders()
        began = time.monotonic()
        scene.render.filepath = str(folder / f"{picture}.png")
        bpy.ops.render.render(write_still=True)
        parts.append(picture)
        print(f"{picture} {time.monotonic() - began:.1f} s", flush=True)
    (folder / "parts.json").write_text(json.dumps(parts) + "\n")
    scene.render.filepath = "//render.png"
    bpy.ops.wm.save_mainfile()
    code = finish(folder, {**reports[0], "source": source})
    hand_out(stage.volume, path, folder / "handed-out", name)
    return code


def hand_out(volume, scan: Path, folder: Path, name: str) -> None:
    """Save the scene with its segments, and without what renders make again and surfaces that only shape a mesh."""
    folder.mkdir(exist_ok=True)
    ours = volume.rle_splat
    if ours.label_file:
        segments = folder / f"{name}-segments.nii.gz"
        shutil.copyfile(bpy.path.abspath(ours.label_file), segments)
        ours["label_file"] = str(segments)  # as a property it would be read again
    for one in list(bpy.data.objects):
        for modifier in [modifier for modifier in one.modifiers if modifier.type == "SHRINKWRAP"]:
            target = modifier.target
            with bpy.context.temp_override(object=one):
                bpy.ops.object.modifier_apply(modifier=modifier.name)
            bpy.data.objects.remove(target)
    settings = bpy.context.scene.rle_splat
    for image in (settings.image, settings.depth_image):
        bpy.data.images.remove(image)
    for area in (area for screen in bpy.data.screens for area in screen.areas if area.type == "FILE_BROWSER"):
        area.spaces.active.params.directory = b"//"  # not a folder of who made it
    here = folder / scan.name
    here.symlink_to(scan.resolve())
    ours["filepath"] = str(here)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / f"{name}.blend"), compress=True)
    here.unlink()


def _priced(scene) -> dict:
    """The report of the volume's picture, made from nothing; a first picture also loads its kernels."""
    bpy.ops.rle_splat.render_image(use_meshes=True)
    return json.loads(scene.rle_splat.last_report_json)


if __name__ == "__main__":
    run(main)
