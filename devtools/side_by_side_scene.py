"""A CT head under one sun in Blender: by RLE Splat, and baked to Cycles' own volume (runs in an environment with bpy).

One JSON job as argument: {"zip", "install": bool, "folder", "size": [width, height], "samples": int}.  The folder gets
ours.npy and cycles.npy, (height, width, 4) float32, scene-linear and premultiplied, row 0 on top, and scene.json, from
which another renderer makes the same picture.
"""

from __future__ import annotations

import json
import math
import time
from importlib import import_module
from pathlib import Path

import bpy
import gallery_data
import numpy as np
from demo_scene import MODULE, add_light, box_of, enable, render_settings, run
from mathutils import Matrix, Vector
from shadow_scene import pixels_of

TOWARD, SUN = (0.95, -1.75, 0.5), (-0.75, -1.0, 1.1)  # camera and lamp, from the middle of the scan, in its sizes


def look_at(low: Vector, high: Vector) -> bpy.types.Object:
    """The camera and the sun; the world is black.  A white surface that faces the sun is as bright as its color."""
    scene, size, middle = bpy.context.scene, max(high - low), (low + high) / 2
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    eye = middle + size * Vector(TOWARD)
    camera.matrix_world = Matrix.Translation(eye) @ (middle - eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    camera.data.lens, camera.data.sensor_fit = 50.0, "VERTICAL"
    camera.data.clip_start, camera.data.clip_end = 0.01 * size, 100.0 * size
    scene.camera = camera
    add_light("Sun", "SUN", math.pi, middle + size * Vector(SUN), middle, (1.0, 1.0, 1.0), angle=math.radians(1.0))
    return camera


def spent(action) -> float:
    """Processor seconds of all threads."""
    began = time.process_time()
    action()
    return round(time.process_time() - began, 2)


def main(job: dict) -> int:
    folder = Path(job["folder"])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    enable(job["zip"], job["install"])
    scene = bpy.context.scene
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    path, options, source = gallery_data.head(folder)
    bpy.ops.rle_splat.import_volume(filepath=str(path), at_cursor=True, **options)
    owner = bpy.context.view_layer.objects.active
    owner.matrix_world = Matrix.Rotation(math.pi, 4, "Y") @ owner.matrix_world  # its slices run from the crown down
    bpy.context.view_layer.update()
    camera = look_at(*box_of(owner))
    render_settings(scene)
    scene.render.resolution_x, scene.render.resolution_y = job["size"]
    scene.render.film_transparent, scene.cycles.samples = True, job["samples"]
    scene.cycles.use_denoising = False
    scene.cycles.volume_bounces = 4
    bpy.context.view_layer.objects.active = owner
    owner.rle_splat.lighting, scene.rle_splat.use_shadows = "SCENE", True
    bpy.ops.rle_splat.render_image()  # reads the file and loads the kernels
    scene.camera.location.x += 1e-6  # so that nothing of the picture is reused but what does not depend on the view
    seconds = {"ours": spent(bpy.ops.rle_splat.render_image)}
    image = scene.rle_splat.image
    flat = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(flat)
    np.save(folder / "ours.npy", flat.reshape(job["size"][1], job["size"][0], 4)[::-1])
    seconds["bake"] = spent(lambda: bpy.ops.rle_splat.bake_volume(filepath=str(folder / "baked.vdb"), look="CYCLES"))
    owner.hide_render = True
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = str(folder / "cycles.exr")
    seconds["cycles"] = spent(lambda: bpy.ops.render.render(write_still=True))
    np.save(folder / "cycles.npy", pixels_of(scene.render.filepath))
    volumes = import_module(f"{MODULE}.bridge.volumes.volumes")
    volume = volumes.load_volume(owner)
    matrix = np.array(owner.matrix_world, np.float64) @ np.diag((0.001, 0.001, 0.001, 1.0)) @ volume.affine
    report = {
        "source": source, "blender": bpy.app.version_string, "size": job["size"], "samples": job["samples"],
        "file": path.name, "options": {name: options[name] for name in ("shape", "dtype", "spacing")},
        "voxel_to_world": matrix.tolist(), "camera": [list(row) for row in camera.matrix_world],
        "view_angle": math.degrees(camera.data.angle_y), "sun": SUN, "seconds": seconds,
    }  # fmt: skip
    (folder / "scene.json").write_text(json.dumps(report, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    run(main)
