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
EYE = (1.05, 2.75, 0.95)  # of the camera, from the middle of the scan, in sizes of the scan
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


def build_set(low: Vector, high: Vector, title: str) -> None:
    """A pedestal, a ring around the scan, an electrode into it, a title; floor, lights and a camera."""
    size = max(high - low)
    middle = (low + high) / 2
    stone = material("Stone", (0.10, 0.13, 0.17), roughness=0.35)
    steel = material("Steel", (0.72, 0.74, 0.78), roughness=0.22, metallic=1.0)
    brass = material("Brass", (0.85, 0.60, 0.25), roughness=0.3, metallic=1.0)
    lamp = material("Lamp", (1.0, 0.25, 0.08), glow=1.5)
    paper = material("Floor", (0.55, 0.57, 0.60), roughness=0.9)

    floor_z = low.z - 0.20 * size
    bpy.ops.mesh.primitive_plane_add(size=40 * size, location=(middle.x, middle.y, floor_z))
    named("Floor", paper)
    top = low.z - 0.02 * size
    bpy.ops.mesh.primitive_cylinder_add(
        radius=0.42 * size, depth=top - floor_z, vertices=96, location=(middle.x, middle.y, (top + floor_z) / 2)
    )
    named("Pedestal", stone)

    # the ring is in front of the scan on one side and behind it on the other
    radius, ring_z = 0.64 * size, middle.z + 0.02 * size
    bpy.ops.mesh.primitive_torus_add(
        major_radius=radius, minor_radius=0.020 * size, major_segments=160, minor_segments=24,
        location=(middle.x, middle.y, ring_z),
    )  # fmt: skip
    named("Ring", steel)
    for degrees in (10.0, 130.0, 250.0):
        angle = math.radians(degrees)
        foot = Vector((middle.x + radius * math.cos(angle), middle.y + radius * math.sin(angle), floor_z))
        rod("Post", foot, (foot.x, foot.y, ring_z), 0.012 * size, steel)

    # the electrode goes in through the top; the part inside is seen only through what lies before it
    entry = middle + size * Vector((0.42, 0.30, 0.58))
    tip = middle + size * Vector((0.10, 0.12, 0.12))
    rod("Electrode", entry, tip, 0.012 * size, brass)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.035 * size, location=entry, segments=48, ring_count=24)
    named("Electrode Head", lamp)

    bpy.ops.object.text_add(location=(0, 0, 0))
    text = named("Title", brass)
    text.data.body, text.data.size = title, 0.17 * size
    text.data.extrude, text.data.align_x = 0.014 * size, "CENTER"
    text.data.bevel_depth = 0.003 * size
    toward_camera = math.atan2(EYE[1], EYE[0])
    stand = Vector((middle.x, middle.y, floor_z + 0.045 * size)) + 0.62 * size * Vector(
        (math.cos(toward_camera), math.sin(toward_camera), 0.0)
    )
    lean = Matrix.Rotation(math.radians(70.0), 4, "X")
    text.matrix_world = Matrix.Translation(stand) @ Matrix.Rotation(toward_camera + math.pi / 2, 4, "Z") @ lean

    scene = bpy.context.scene
    eye = middle + size * Vector(EYE)
    aim = middle + Vector((0.0, 0.0, -0.17 * size))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    camera.matrix_world = Matrix.Translation(eye) @ (aim - eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    camera.data.lens = 54.0
    camera.data.clip_start, camera.data.clip_end = 0.01 * size, 100.0 * size
    scene.camera = camera

    def light(name, kind, energy, place, color, **settings):
        data = bpy.data.lights.new(name, kind)
        data.energy, data.color = energy, color
        for key, value in settings.items():
            setattr(data, key, value)
        holder = bpy.data.objects.new(name, data)
        scene.collection.objects.link(holder)
        spot = middle + size * Vector(place)
        holder.matrix_world = Matrix.Translation(spot) @ (middle - spot).to_track_quat("-Z", "Y").to_matrix().to_4x4()

    light("Sun", "SUN", 3.0, (2.0, 2.2, 3.0), (1.0, 0.96, 0.90), angle=math.radians(4.0))
    light("Fill", "AREA", 14.0 * size**2, (-2.4, 1.6, 0.8), (0.75, 0.85, 1.0), size=1.6 * size)
    scene.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0, 0):
        scene.world.use_nodes = True
    background = scene.world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (0.30, 0.34, 0.40, 1.0)
    background.inputs["Strength"].default_value = 0.6


def render_settings(scene) -> None:
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = SAMPLES
    scene.cycles.use_denoising = bool(getattr(bpy.app.build_options, "openimagedenoise", True))
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "Standard"  # the default, AgX, would change the colours of the scan
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
    bpy.context.view_layer.update()
    build_set(*box_of(volume_object), job["title"])
    render_settings(scene)
    bpy.context.view_layer.objects.active = volume_object
    bpy.context.view_layer.update()

    timed("render_image", bpy.ops.rle_splat.render_image)
    splat = scene.rle_splat.image
    report = json.loads(scene.rle_splat.last_report_json or "{}")
    splat.save_render(str(folder / "splat.png"), scene=scene)
    timed("set_backdrop", bpy.ops.rle_splat.set_backdrop)
    timed("composite", bpy.ops.rle_splat.composite)
    scene.render.filepath = str(folder / "render.png")
    timed("render", lambda: bpy.ops.render.render(write_still=True))
    scene.render.filepath = "//render.png"
    bpy.ops.wm.save_mainfile()

    fraction = covered(splat)
    report.update(
        blender=bpy.app.version_string, title=job["title"], seconds=clock, covered_fraction=round(fraction, 4),
        message=scene.rle_splat.message,
    )  # fmt: skip
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
