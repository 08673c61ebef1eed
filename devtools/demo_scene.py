"""A scan among meshes in a Blender scene, headless (runs in an environment with bpy; one JSON job as argument).

Job: {"zip", "install": bool, "volume": path, "options": {import_volume's properties}, "folder", "title"}.
Everything is done through the extension's operators, as a user's script would.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from pathlib import Path

import bpy
from mathutils import Matrix, Vector

MODULE = "bl_ext.user_default.rle_splat"
EYE = (-1.05, -2.75, 1.00)  # of the camera, before a patient: from the middle of the scan, in sizes of the scan
SMOKE_OPACITY = 2.5  # thin smoke hides too little of what stands in it
WIDTH, HEIGHT, SAMPLES = 960, 720, 20


def enable(zip_path: str, install: bool) -> None:
    """Install the built zip into this Blender, or enable what an earlier run installed."""
    if install:
        bpy.ops.extensions.package_install_files(
            repo="user_default", filepath=zip_path, enable_on_install=True, overwrite=True
        )
    else:
        bpy.ops.preferences.addon_enable(module=MODULE)
    if MODULE not in bpy.context.preferences.addons:
        raise RuntimeError("The extension could not be enabled in Blender; its words are above.")


def material(name: str, color, roughness=0.5, metallic=0.0, glow=0.0):
    """A Principled material."""
    made = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0, 0):
        made.use_nodes = True
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*color, 1.0)
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Metallic"].default_value = metallic
    if glow:
        shader.inputs["Emission Color"].default_value = (*color, 1.0)
        shader.inputs["Emission Strength"].default_value = glow
    return made


def named(name: str, coat):
    """Name and coat the object that the last primitive operator made."""
    made = bpy.context.object
    made.name = name
    made.data.materials.append(coat)
    if made.type == "MESH" and name != "Floor":
        made.data.shade_smooth()
        made.modifiers.new("Crisp", "EDGE_SPLIT").split_angle = math.radians(40.0)
    return made


def rod(name: str, start, end, radius: float, coat):
    """A cylinder from one point to another."""
    axis = Vector(end) - Vector(start)
    bpy.ops.mesh.primitive_cylinder_add(radius=radius, depth=axis.length, vertices=48)
    made = named(name, coat)
    made.matrix_world = Matrix.Translation((Vector(start) + Vector(end)) / 2) @ axis.to_track_quat("Z", "Y").to_matrix(
    ).to_4x4()  # fmt: skip
    return made


def box_of(volume_object):
    """(low, high): the world's bounds of a volume object's box, which is the box it shows in the viewport."""
    holder = volume_object.instance_collection.objects[0]
    matrix = volume_object.matrix_world @ holder.matrix_world
    corners = [matrix @ vertex.co for vertex in holder.data.vertices]
    low = Vector([min(corner[axis] for corner in corners) for axis in range(3)])
    high = Vector([max(corner[axis] for corner in corners) for axis in range(3)])
    return low, high


def stand_upright(volume_object) -> None:
    """Turn a volume whose y axis points up, as in the VDB files of simulations, about its middle, the 3D cursor."""
    volume_object.matrix_world = Matrix.Rotation(math.radians(90.0), 4, "X") @ volume_object.matrix_world


def bevelled(made, width: float):
    """Round an object's edges off, so that they catch the light."""
    modifier = made.modifiers.new("Bevel", "BEVEL")
    modifier.width, modifier.segments = width, 3
    return made


def add_light(name: str, kind: str, energy: float, spot: Vector, target: Vector, color, **settings):
    """A lamp at ``spot`` that shines toward ``target``."""
    data = bpy.data.lights.new(name, kind)
    data.energy, data.color = energy, color
    for key, value in settings.items():
        setattr(data, key, value)
    holder = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(holder)
    holder.matrix_world = Matrix.Translation(spot) @ (target - spot).to_track_quat("-Z", "Y").to_matrix().to_4x4()


def build_set(low: Vector, high: Vector, title: str) -> None:
    """A pedestal whose stem holds the scan from inside, a ring around it, an electrode into it, a title; floor,
    lights and a camera.  Every length is a part of the scan's, so that millimeters and a cloud look alike."""
    size = max(high - low)
    middle = (low + high) / 2
    stone = material("Stone", (0.035, 0.045, 0.06), roughness=0.28)
    steel = material("Steel", (0.72, 0.74, 0.78), roughness=0.22, metallic=1.0)
    brass = material("Brass", (0.95, 0.66, 0.27), roughness=0.42, metallic=1.0)
    ivory = material("Ivory", (0.80, 0.74, 0.62), roughness=0.4)
    lamp = material("Lamp", (1.0, 0.20, 0.06), glow=2.0)
    ground = material("Floor", (0.11, 0.125, 0.15), roughness=0.55)

    floor_z = low.z - 0.24 * size
    bpy.ops.mesh.primitive_plane_add(size=60 * size, location=(middle.x, middle.y, floor_z))
    named("Floor", ground)
    top = low.z - 0.04 * size
    bpy.ops.mesh.primitive_cylinder_add(
        radius=0.36 * size, depth=top - floor_z, vertices=128, location=(middle.x, middle.y, (top + floor_z) / 2)
    )
    bevelled(named("Pedestal", stone), 0.015 * size)
    bpy.ops.mesh.primitive_torus_add(
        major_radius=0.361 * size, minor_radius=0.007 * size, major_segments=160, minor_segments=16,
        location=(middle.x, middle.y, top - 0.03 * size),
    )  # fmt: skip
    named("Band", brass)
    rod("Stem", (middle.x, middle.y, top), middle, 0.016 * size, brass)

    # the ring is in front of the scan on one side and behind it on the other
    radius, ring_z = 0.60 * size, middle.z - 0.04 * size
    bpy.ops.mesh.primitive_torus_add(
        major_radius=radius, minor_radius=0.016 * size, major_segments=192, minor_segments=24,
        location=(middle.x, middle.y, ring_z),
    )  # fmt: skip
    named("Ring", steel)
    for degrees in (69.0, 189.0, 309.0):
        angle = math.radians(degrees)
        foot = Vector((middle.x + radius * math.cos(angle), middle.y + radius * math.sin(angle), floor_z))
        rod("Post", foot, (foot.x, foot.y, ring_z), 0.010 * size, steel)

    # the electrode goes in from above; the part inside is seen only through what lies before it
    entry = middle + size * Vector((-0.38, -0.32, 0.52))
    tip = middle + size * Vector((-0.06, -0.06, 0.05))
    rod("Electrode", entry, tip, 0.010 * size, brass)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.030 * size, location=entry, segments=48, ring_count=24)
    named("Electrode Head", lamp)

    bpy.ops.object.text_add(location=(0, 0, 0))
    text = named("Title", ivory)
    text.data.body, text.data.size = title, 0.13 * size
    text.data.extrude, text.data.align_x = 0.010 * size, "CENTER"
    text.data.bevel_depth, text.data.space_character = 0.002 * size, 1.15
    toward_camera = math.atan2(EYE[1], EYE[0])
    stand = Vector((middle.x, middle.y, floor_z + 0.002 * size)) + 0.56 * size * Vector(
        (math.cos(toward_camera), math.sin(toward_camera), 0.0)
    )
    lean = Matrix.Rotation(math.radians(75.0), 4, "X")
    text.matrix_world = Matrix.Translation(stand) @ Matrix.Rotation(toward_camera + math.pi / 2, 4, "Z") @ lean

    scene = bpy.context.scene
    eye = middle + size * Vector(EYE)
    aim = Vector((middle.x, middle.y, 0.64 * floor_z + 0.36 * entry.z))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    camera.matrix_world = Matrix.Translation(eye) @ (aim - eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    camera.data.lens = 55.0
    camera.data.clip_start, camera.data.clip_end = 0.01 * size, 100.0 * size
    scene.camera = camera

    def spot(*place):
        return middle + size * Vector(place)

    add_light("Key", "SUN", 2.6, spot(-2.6, -1.6, 2.6), middle, (1.0, 0.95, 0.88), angle=math.radians(6.0))
    add_light("Fill", "AREA", 10.0 * size**2, spot(2.0, -2.2, 0.9), middle, (0.70, 0.82, 1.0), size=1.8 * size)
    add_light("Rim", "AREA", 40.0 * size**2, spot(1.4, 2.4, 1.8), middle, (0.75, 0.85, 1.0), size=1.2 * size)
    scene.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0, 0):
        scene.world.use_nodes = True
    background = scene.world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (0.30, 0.36, 0.45, 1.0)
    background.inputs["Strength"].default_value = 0.35


def render_settings(scene) -> None:
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = SAMPLES
    scene.cycles.use_denoising = bool(getattr(bpy.app.build_options, "openimagedenoise", True))
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "Standard"  # the default, AgX, would change the colors of the scan
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    if hasattr(scene.render, "compositor_device"):
        scene.render.compositor_device = "CPU"


def covered(image) -> float:
    """The fraction of a picture's pixels that shows any of the volume."""
    values = [0.0] * len(image.pixels)
    image.pixels.foreach_get(values)
    alpha = values[3::4]
    return sum(value > 0.01 for value in alpha) / len(alpha)


def main(job: dict) -> int:
    folder = Path(job["folder"])
    clock = {}

    def timed(name, action):
        started = time.monotonic()
        action()
        clock[name] = round(time.monotonic() - started, 3)

    bpy.ops.wm.read_factory_settings(use_empty=True)
    timed("enable", lambda: enable(job["zip"], job["install"]))
    scene = bpy.context.scene
    blend = str(folder / "scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=blend)  # first, so that the volume's path is kept relative to it
    timed("import", lambda: bpy.ops.rle_splat.import_volume(
        filepath=job["volume"], at_cursor=True, **job["options"]))  # fmt: skip
    volume_object = bpy.context.view_layer.objects.active
    if Path(job["volume"]).suffix.lower() == ".vdb":
        stand_upright(volume_object)
        volume_object.rle_splat.opacity_scale = SMOKE_OPACITY
    bpy.context.view_layer.update()
    build_set(*box_of(volume_object), job["title"])
    render_settings(scene)
    bpy.context.view_layer.objects.active = volume_object
    bpy.context.view_layer.update()

    timed("render_image", lambda: bpy.ops.rle_splat.render_image(use_meshes=False))
    splat = scene.rle_splat.image
    report = json.loads(scene.rle_splat.last_report_json or "{}")
    splat.save_render(str(folder / "splat.png"), scene=scene)
    timed("preview_in_camera_view", bpy.ops.rle_splat.preview_in_camera_view)
    timed("show_in_renders", bpy.ops.rle_splat.show_in_renders)
    scene.render.filepath = str(folder / "render.png")
    timed("render", lambda: bpy.ops.render.render(write_still=True))
    scene.render.filepath = "//render.png"
    bpy.ops.wm.save_mainfile()

    report.update(title=job["title"], seconds=clock)
    return finish(folder, report)


def finish(folder: Path, report: dict) -> int:
    """Keep the report, with what the picture shows; the script's exit code, which is 1 where it shows nothing."""
    settings = bpy.context.scene.rle_splat
    fraction = covered(settings.image)
    report.update(blender=bpy.app.version_string, covered_fraction=round(fraction, 4), message=settings.message)
    (folder / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    if fraction == 0.0 or settings.message:
        print(settings.message or "The picture shows nothing of the volume.", file=sys.stderr)
        return 1
    return 0


def run(main) -> None:
    """Do the job that the command line gives, and end the process with its exit code."""
    try:
        code = main(json.loads(sys.argv[1]))
    except RuntimeError as problem:  # what an operator reports comes as a RuntimeError
        print(problem, file=sys.stderr)
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # bpy 4.5 can hang when the interpreter ends with its classes registered


if __name__ == "__main__":
    run(main)
