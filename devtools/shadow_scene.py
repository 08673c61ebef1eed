"""A scan on a floor beside a mirror, in Cycles: without the volume, with ours, and baked to Cycles' own volume.

Runs in an environment with bpy; one JSON job as argument: {"zip", "install": bool, "folder", "size": [width, height],
"samples": int}.  The folder gets the three pictures, side by side in ``shadows.png``, and figures.json: by how much
they differ on the pixels of the floor and of the mirror that show no volume directly.
"""

from __future__ import annotations

import json
import math
import os
import time
from pathlib import Path

import bpy
import gallery_data
import numpy as np
from demo_scene import add_light, box_of, enable, material, named, render_settings, run
from mathutils import Matrix, Vector

KINDS = "none", "ours", "cycles"
SHADED = 0.05  # share of light whose loss counts as shadow


def build(low: Vector, high: Vector) -> None:
    """A floor, a mirror behind, a soft sun, a dim world and a camera; every length is a part of the scan's."""
    size, middle = max(high - low), (low + high) / 2
    floor_z = low.z - 0.05 * size
    bpy.ops.mesh.primitive_plane_add(size=20 * size, location=(middle.x, middle.y, floor_z))
    named("Floor", material("Floor", (0.6, 0.58, 0.55), roughness=0.9))
    bpy.ops.mesh.primitive_plane_add(size=1.0)
    mirror = named("Mirror", material("Mirror", (0.9, 0.9, 0.9), roughness=0.02, metallic=1.0))
    mirror.matrix_world = (
        Matrix.Translation((middle.x - 0.75 * size, middle.y + 0.85 * size, floor_z + 0.62 * size))
        @ Matrix.Rotation(math.radians(-38.0), 4, "Z") @ Matrix.Rotation(math.radians(90.0), 4, "Y")
        @ Matrix.Diagonal((1.2 * size, 1.3 * size, 1.0, 1.0))
    )  # fmt: skip
    eye = middle + size * Vector((1.7, -2.3, 0.95))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene = bpy.context.scene
    scene.collection.objects.link(camera)
    aim = middle + size * Vector((-0.12, 0.1, -0.02))
    camera.matrix_world = Matrix.Translation(eye) @ (aim - eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    camera.data.lens, camera.data.clip_start = 43.0, 0.01 * size
    scene.camera = camera
    sun = middle + size * Vector((1.1, 0.5, 1.8))
    add_light("Sun", "SUN", 3.0, sun, middle, (1.0, 0.96, 0.9), angle=math.radians(3.0))
    scene.world = bpy.data.worlds.new("World")
    if scene.world.node_tree is None:
        scene.world.use_nodes = True
    background = scene.world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (0.30, 0.36, 0.45, 1.0)
    background.inputs["Strength"].default_value = 0.4


def shot(folder: Path, name: str) -> tuple[np.ndarray, float]:
    """Render; return (H, W, 4) scene-linear, row 0 on top, and the seconds that it took."""
    scene = bpy.context.scene
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = str(folder / f"{name}.exr")
    began = time.monotonic()
    bpy.ops.render.render(write_still=True)
    seconds = time.monotonic() - began
    return pixels_of(scene.render.filepath), seconds


def pixels_of(path: str) -> np.ndarray:
    image = bpy.data.images.load(path)
    width, height = image.size
    flat = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(flat)
    bpy.data.images.remove(image)
    return flat.reshape(height, width, 4)[::-1]


def met_by_rays() -> np.ndarray:
    """(H, W) names of the meshes that the pixels' middles show."""
    scene, depsgraph = bpy.context.scene, bpy.context.evaluated_depsgraph_get()
    camera, width, height = scene.camera, scene.render.resolution_x, scene.render.resolution_y
    frame = [camera.matrix_world @ corner for corner in camera.data.view_frame(scene=scene)]
    right_top, right_low, left_low, left_top = frame
    eye, found = camera.matrix_world.translation, np.full((height, width), "", dtype=object)
    for row, column in np.ndindex(height, width):
        across, down = (column + 0.5) / width, (row + 0.5) / height
        through = left_top.lerp(right_top, across).lerp(left_low.lerp(right_low, across), down)
        hit, _, _, _, one, _ = scene.ray_cast(depsgraph, eye, (through - eye).normalized())
        found[row, column] = one.name if hit else ""
    return found


def compared(shots: dict, seen: np.ndarray) -> dict:
    """Figures on the pixels of one mesh: light lost to the volume's shadow in the middle of it, and differences.

    ``shots``: (n, 3) of each of KINDS; ``seen``: (n, 2) column and row of the pixels.
    """
    gray = {kind: shots[kind].mean(axis=1) for kind in KINDS}
    lost = {kind: 1.0 - gray[kind] / gray["none"] for kind in KINDS}
    shaded = np.maximum(np.abs(lost["ours"]), np.abs(lost["cycles"])) > SHADED
    difference = gray["ours"] - gray["cycles"]
    places = [np.average(seen, axis=0, weights=np.abs(lost[kind])) for kind in ("ours", "cycles")]
    return {
        "pixels": len(seen),
        "changed pixels": int(shaded.sum()),
        **{f"mean of {kind}": round(float(gray[kind][shaded].mean()), 4) for kind in KINDS},
        "mean difference": round(float(difference[shaded].mean()), 4),
        "RMS difference": round(float(np.sqrt((difference[shaded] ** 2).mean())), 4),
        "correlation": round(float(np.corrcoef(lost["ours"][shaded], lost["cycles"][shaded])[0, 1]), 4),
        "middles apart, pixels": round(float(np.linalg.norm(places[0] - places[1])), 2),
        "colors of ours": [round(float(c), 3) for c in shots["ours"][shaded].mean(axis=0)],
        "colors of cycles": [round(float(c), 3) for c in shots["cycles"][shaded].mean(axis=0)],
    }


def side_by_side(folder: Path, shots: dict) -> None:
    """The three pictures in a row, through the scene's view transform."""
    rows = np.concatenate([shots[kind] for kind in KINDS], axis=1)[::-1]
    height, width = rows.shape[:2]
    image = bpy.data.images.new("side by side", width, height, float_buffer=True)
    image.pixels.foreach_set(np.ascontiguousarray(rows, np.float32).ravel())
    scene = bpy.context.scene
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "PNG", "8"
    scene.render.image_settings.color_mode = "RGB"
    image.save_render(str(folder / "shadows.png"), scene=scene)


def main(job: dict) -> int:
    folder = Path(job["folder"])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    enable(job["zip"], job["install"])
    scene = bpy.context.scene
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    path, options, source = gallery_data.head(folder)
    bpy.ops.rle_splat.import_volume(filepath=str(path), at_cursor=True, **options)
    owner = bpy.context.view_layer.objects.active
    if source != gallery_data.MADE:  # its slices run from the crown down
        owner.matrix_world = Matrix.Rotation(math.pi, 4, "Y") @ owner.matrix_world  # about the 3D cursor, its middle
    bpy.context.view_layer.update()
    build(*box_of(owner))
    render_settings(scene)
    scene.render.resolution_x, scene.render.resolution_y = job["size"]
    scene.cycles.samples = job["samples"]
    scene.cycles.use_denoising = scene.cycles.caustics_reflective = False
    bpy.context.view_layer.objects.active = owner
    bpy.ops.rle_splat.render_image()
    shots, seconds = {}, {}
    shots["none"], seconds["none"] = shot(folder, "none")
    bpy.ops.rle_splat.show_in_renders()
    shots["ours"], seconds["ours"] = shot(folder, "ours")
    report = json.loads(scene.rle_splat.last_report_json)
    effect = next(entry for entry in report["effects"] if entry["name"] == "shadows on meshes")
    image = next(one for one in bpy.data.images if one.name == scene.rle_splat.image.name)
    flat = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(flat)
    covered = flat.reshape(*shots["none"].shape)[::-1][..., 3] > 0.002
    bpy.ops.rle_splat.remove_from_renders()
    began = time.monotonic()
    bpy.ops.rle_splat.bake_volume(filepath=str(folder / "baked.vdb"))
    seconds["bake"] = time.monotonic() - began
    shots["cycles"], seconds["cycles"] = shot(folder, "cycles")
    meshes, figures = met_by_rays(), {}
    for name in ("Floor", "Mirror"):
        rows, columns = np.nonzero((meshes == name) & ~covered)
        figures[name] = compared(
            {kind: shots[kind][rows, columns, :3] for kind in KINDS}, np.stack((columns, rows), axis=1)
        )
    side_by_side(folder, shots)
    difference = shots["ours"][..., :3] - shots["cycles"][..., :3]
    figures["Volume"] = {
        "pixels": int(covered.sum()),
        "mean difference": round(float(difference[covered].mean()), 4),
        "RMS difference": round(float(np.sqrt((difference[covered] ** 2).mean())), 4),
    }
    report = {"source": source, "blender": bpy.app.version_string, "samples": job["samples"], "size": job["size"],
              "effect": effect, "seconds": {name: round(spent, 2) for name, spent in seconds.items()},
              "cores": os.cpu_count(), **figures}  # fmt: skip
    (folder / "figures.json").write_text(json.dumps(report, indent=1) + "\n")
    return 1 if scene.rle_splat.message else 0


if __name__ == "__main__":
    run(main)
