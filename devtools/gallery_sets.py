"""The five scenes of the gallery, each a function of the imported volume (runs in an environment with bpy).

Lengths are parts of the volume's largest side, so that the scans and what stands in for them look alike.
"""

from __future__ import annotations

import json
import math
from importlib import import_module
from pathlib import Path

import bpy
import numpy as np
from demo_scene import MODULE, SMOKE_OPACITY, add_light, box_of, material, named, stand_upright
from gallery_data import BONE, HEART, LUNGS, organs
from mathutils import Matrix, Vector

BONE_HU = 300.0
PLATE_SCREWS = 6
# Of a chest of 8 bits with contrast: muscle and fat as a veil, blood red, bone ivory.
CHEST_FUNCTION = {
    "name": "chest with contrast", "unit": None,
    "opacity": [[0, 0], [16, 0], [24, 0.01], [40, 0.04], [62, 0.4], [140, 0.5], [165, 0.7], [255, 0.95]],
    "color": [[0, 0.5, 0.3, 0.22], [30, 0.62, 0.36, 0.26], [58, 0.66, 0.2, 0.14], [120, 0.76, 0.1, 0.07],
              [150, 0.8, 0.45, 0.3], [180, 0.88, 0.8, 0.66], [255, 0.97, 0.94, 0.88]],
    "shade": {"ambient": 0.2, "diffuse": 0.8, "specular": 0.3, "shininess": 25},
}  # fmt: skip
ORGAN_COLORS = {
    LUNGS: ("Lungs", (0.25, 0.5, 0.8)), HEART: ("Heart and great vessels", (0.7, 0.07, 0.05)),
    BONE: ("Bones", (0.86, 0.77, 0.62)),
}  # fmt: skip
# Along each ray the largest value counts; bone is not to outshine blood by far.
VESSEL_FUNCTION = {
    "name": "vessels", "unit": None, "opacity": [[0, 0], [25, 0.05], [60, 0.55], [120, 0.9], [255, 1.0]],
    "color": [[0, 0.0, 0.0, 0.0], [40, 0.06, 0.006, 0.006], [90, 0.24, 0.03, 0.02], [150, 0.5, 0.17, 0.08],
              [220, 0.72, 0.46, 0.27], [255, 0.85, 0.7, 0.52]],
    "shade": False,
}  # fmt: skip


def _sized(volume_object) -> tuple[Vector, float]:
    """Middle and largest side of a volume's box."""
    bpy.context.view_layer.update()
    low, high = box_of(volume_object)
    return (low + high) / 2, max(high - low)


def _camera(middle, size: float, toward, lens: float = 70.0, aim=(0.0, 0.0, 0.0)):
    """The active camera, as far along ``toward`` as that is long, looking at ``aim`` from the middle."""
    target, eye = middle + size * Vector(aim), middle + size * Vector(toward)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    bpy.context.scene.collection.objects.link(camera)
    camera.matrix_world = Matrix.Translation(eye) @ (target - eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    camera.data.lens = lens
    camera.data.clip_start, camera.data.clip_end = 0.01 * size, 100.0 * size
    bpy.context.scene.camera = camera
    return camera


def _world(color, strength: float) -> None:
    world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0, 0):
        world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (*color, 1.0)
    background.inputs["Strength"].default_value = strength
    bpy.context.scene.world = world


def _set_function(volume_object, function: dict, folder: Path) -> None:
    path = folder / "transfer_function.json"
    path.write_text(json.dumps(function) + "\n")
    bpy.context.view_layer.objects.active = volume_object
    bpy.ops.rle_splat.load_transfer(filepath=str(path))


def _turned(volume_object, degrees: float, axis: str, middle) -> None:
    turn = Matrix.Translation(middle) @ Matrix.Rotation(math.radians(degrees), 4, axis) @ Matrix.Translation(-middle)
    volume_object.matrix_world = turn @ volume_object.matrix_world


# --- a plate on the skull -----------------------------------------------------------------------------------------


def plate(volume_object, folder: Path) -> None:
    middle, size = _sized(volume_object)
    if volume_object.rle_splat.intercept:  # the scan, whose z runs from the crown down
        _turned(volume_object, 180.0, "X", middle)
        _without_wire()
    _camera(middle, size, (-1.5, 2.1, 0.75), aim=(0.0, 0.0, 0.02))
    titanium = material("Titanium", (0.58, 0.57, 0.56), roughness=0.5, metallic=0.6)
    steel = material("Screws", (0.86, 0.86, 0.88), roughness=0.35, metallic=0.7)
    _bend_plate(volume_object, middle, (-0.75, 0.45, 0.5), titanium, steel)
    add_light("Key", "SUN", 3.0, middle + size * Vector((-0.6, 2.0, 2.2)), middle, (1.0, 0.96, 0.9))
    add_light(
        "Rim", "AREA", 22.0 * size**2, middle + size * Vector((2.2, -0.8, 1.4)), middle, (0.7, 0.82, 1.0), size=size
    )
    _world((0.05, 0.06, 0.08), 0.4)


def _without_wire() -> None:
    """Cut away the wire of the head rest that runs upright through the scan, and stands out above the crown."""
    bpy.context.view_layer.update()
    bpy.ops.rle_splat.add_clip(kind="BOX", keep="OUTSIDE")
    box = bpy.context.view_layer.objects.active
    box.name = "Wire"
    bpy.context.view_layer.update()
    # In the scan's own box, from -1 to 1: about column 193, row 238 of 256.
    box.matrix_world @= Matrix.Translation((0.514, 0.867, 0.0)) @ Matrix.Diagonal((0.055, 0.039, 1.1, 1.0))


def _bend_plate(volume_object, middle, toward, coat, screw_coat) -> None:
    """A strip with screws, bent to the outermost bone that lies ``toward`` from the middle."""
    read_scene = import_module(f"{MODULE}.bridge.render_scene").read_scene
    plain, _ = read_scene(volume_object, bpy.context.evaluated_depsgraph_get(), with_meshes=False)
    scale = float(np.linalg.norm(plain.index_to_world[:3, 0]) / plain.volume.spacing[0])  # world units in a millimeter
    ahead = Vector(toward).normalized()
    along = ahead.cross(Vector((0.0, 0.0, 1.0))).normalized()
    across = along.cross(ahead)
    frame = np.array((ahead, along, across))

    def way(u, v):
        return np.stack((np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)), axis=-1) @ frame

    columns = np.linspace(-0.5, 0.5, 121)
    u, side = np.meshgrid(columns, np.linspace(-1.0, 1.0, 9), indexing="ij")
    half_width = 0.045 * (0.62 + 0.38 * np.abs(np.cos(math.pi * PLATE_SCREWS * (u + 0.5 - 0.5 / PLATE_SCREWS))))
    ends = np.sqrt(np.clip(1.0 - np.clip((np.abs(u) - 0.46) / 0.04, 0.0, 1.0) ** 2, 0.0, 1.0))
    v = side * half_width * np.maximum(ends, 0.05)
    found = _outermost(plain, np.array(middle), way(u, v))
    terms = np.stack([u**i * v**j for i in range(5) for j in range(2)], axis=-1)
    good = np.isfinite(found)
    for _ in range(3):  # sutures and thin bone must not dent the plate
        fit = np.linalg.lstsq(terms[good], found[good], rcond=None)[0]
        off = found - terms @ fit
        good = np.isfinite(found) & (np.abs(off) < 2.5 * np.nanstd(off[good]) + 1e-9)
    lift = np.quantile(off[good], 0.97) + 0.3 * scale
    places = np.array(middle) + (terms @ fit + lift)[..., None] * way(u, v)
    rows, count = places.shape[:2]
    faces = [(r * count + c, (r + 1) * count + c, (r + 1) * count + c + 1, r * count + c + 1)
             for r in range(rows - 1) for c in range(count - 1)]  # fmt: skip
    mesh = bpy.data.meshes.new("Plate")
    mesh.from_pydata([tuple(p) for p in places.reshape(-1, 3)], [], faces)
    made = bpy.data.objects.new("Plate", mesh)
    bpy.context.scene.collection.objects.link(made)
    mesh.materials.append(coat)
    mesh.shade_smooth()
    thick = made.modifiers.new("Thickness", "SOLIDIFY")
    thick.thickness, thick.offset = 1.6 * scale, 1.0 if _faces_out(places, np.array(middle)) else -1.0
    for screw in (np.arange(PLATE_SCREWS) + 0.5) / PLATE_SCREWS - 0.5:
        place = Vector(places[int(np.abs(columns - screw).argmin()), count // 2])
        out = (place - middle).normalized()
        bpy.ops.mesh.primitive_cylinder_add(radius=2.3 * scale, depth=2.4 * scale, vertices=48)
        head = named("Screw", screw_coat)
        head.matrix_world = Matrix.Translation(place + 1.3 * scale * out) @ out.to_track_quat("Z", "Y").to_matrix(
        ).to_4x4()  # fmt: skip


def _outermost(plain, center, ways) -> np.ndarray:
    """Distance from ``center`` of the outermost bone along world directions (..., 3), NaN where there is none."""
    inverse = np.linalg.inv(plain.index_to_world)
    shape = np.array(plain.volume.shape_xyz)
    corner = (plain.index_to_world @ np.append(shape - 1.0, 1.0))[:3]
    far = float(np.linalg.norm(corner - center))
    away = np.linspace(far, 0.0, 2 * int(shape.max()))
    points = center + away[:, None] * ways[..., None, :]
    index = np.rint(points @ inverse[:3, :3].T + inverse[:3, 3]).astype(int)
    inside = ((index >= 0) & (index < shape)).all(axis=-1)
    x, y, z = np.moveaxis(np.clip(index, 0, shape - 1), -1, 0)
    bone = inside & (plain.volume.physical(plain.volume.voxels[z, y, x]) > BONE_HU)
    bone[..., :-2] &= bone[..., 1:-1] & bone[..., 2:]  # a speck of noise is no bone
    return np.where(bone.any(axis=-1), away[bone.argmax(axis=-1)], np.nan)


def _faces_out(places, middle) -> bool:
    """Whether the first face's normal points away from the middle."""
    a, b, c = places[0, 0], places[1, 0], places[1, 1]
    return float(np.cross(b - a, c - a) @ (a - middle)) > 0.0


# --- the others ---------------------------------------------------------------------------------------------------


def chest(volume_object, folder: Path) -> None:
    """The right front of the chest is cut away; lungs, heart and bones have colors of their own by labels."""
    middle, size = _sized(volume_object)
    properties = volume_object.rle_splat
    properties.label_file = str(organs(folder, folder / "chest.raw", tuple(properties.shape)))
    bpy.ops.rle_splat.read_labels()
    for row in properties.labels:
        if row.label in ORGAN_COLORS:
            row.label_name, row.color = ORGAN_COLORS[row.label]
            row.use_color = True
    _set_function(volume_object, CHEST_FUNCTION, folder)
    # Labels are classified voxel by voxel: a wider footprint than the tent rounds their steps off.
    settings = bpy.context.scene.rle_splat
    settings.classification, settings.kernel = "pre", "bspline2"
    _camera(middle, size, (-1.0, -2.5, 0.55), aim=(0.02, 0.0, 0.0))
    bpy.ops.rle_splat.add_clip(kind="BOX", keep="OUTSIDE")
    box = bpy.context.scene.rle_splat.clip_objects.objects[0]
    low = box_of(volume_object)[0]
    box.location = (low.x + 0.22 * size, low.y + 0.22 * size, middle.z + 0.16 * size)
    box.rotation_euler = (0.0, 0.0, 0.0)
    box.scale = (0.3 * size, 0.3 * size, 0.6 * size)
    bpy.ops.rle_splat.add_clip(kind="PLANE", keep="INSIDE")  # what the patient lies on
    arrow = next(one for one in bpy.context.scene.rle_splat.clip_objects.objects if one is not box)
    arrow.location, arrow.rotation_euler = middle + size * Vector((0.0, 0.33, 0.0)), (math.radians(-90.0), 0.0, 0.0)
    add_light("Key", "SUN", 3.2, middle + size * Vector((-1.4, -2.0, 2.0)), middle, (1.0, 0.95, 0.88))
    add_light(
        "Fill", "AREA", 14.0 * size**2, middle + size * Vector((2.2, -1.2, 0.6)), middle, (0.66, 0.8, 1.0), size=size
    )
    _world((0.05, 0.06, 0.08), 0.4)


def brain(volume_object, folder: Path) -> None:
    """Three lights of three colors: an area light, a spot and a point."""
    middle, size = _sized(volume_object)
    volume_object.rle_splat.ambient = 0.06
    _camera(middle, size, (1.7, 1.6, 1.1))
    warm, cold, green = (1.0, 0.45, 0.16), (0.14, 0.36, 1.0), (0.25, 1.0, 0.45)
    add_light("Warm", "AREA", 60.0 * size**2, middle + size * Vector((0.3, 2.0, 1.0)), middle, warm, size=0.5 * size)
    add_light(
        "Cold", "SPOT", 180.0 * size**2, middle + size * Vector((2.0, -1.0, 0.5)), middle, cold,
        spot_size=math.radians(50.0), spot_blend=0.3, shadow_soft_size=0.05 * size,
    )  # fmt: skip
    add_light(
        "Green", "POINT", 45.0 * size**2, middle + size * Vector((-0.5, 0.3, 1.4)), middle, green,
        shadow_soft_size=0.02 * size,
    )  # fmt: skip
    _world((0.02, 0.022, 0.03), 0.5)


def angiography(volume_object, folder: Path) -> None:
    """The largest value along each ray, the spine cut off by a plane."""
    middle, size = _sized(volume_object)
    _set_function(volume_object, VESSEL_FUNCTION, folder)
    settings = bpy.context.scene.rle_splat
    settings.mode = "mip"
    _camera(middle, size, (0.35, -2.55, 0.12))
    bpy.ops.rle_splat.add_clip(kind="PLANE", keep="INSIDE")
    arrow = settings.clip_objects.objects[0]
    arrow.location, arrow.rotation_euler = middle + size * Vector((0.0, 0.1, 0.0)), (math.radians(-90.0), 0.0, 0.0)
    _world((0.0, 0.0, 0.0), 0.0)


def smoke(volume_object, folder: Path) -> None:
    """A glowing knot and a rod of brass in the plume."""
    stand_upright(volume_object)
    volume_object.rle_splat.opacity_scale = 2.0 * SMOKE_OPACITY
    middle, size = _sized(volume_object)
    _camera(middle, size, (1.3, -1.7, 0.3), lens=66.0)
    brass = material("Brass", (0.95, 0.66, 0.27), roughness=0.3, metallic=1.0)
    bpy.ops.mesh.primitive_torus_add(
        major_radius=0.14 * size, minor_radius=0.018 * size, major_segments=160, minor_segments=32,
        location=middle + size * Vector((0.0, 0.0, -0.08)), rotation=(math.radians(68.0), 0.0, math.radians(60.0)),
    )  # fmt: skip
    named("Ring", brass)
    bpy.ops.mesh.primitive_ico_sphere_add(
        radius=0.055 * size, subdivisions=5, location=middle + size * Vector((0.0, 0.0, -0.08))
    )
    named("Ember", material("Ember", (1.0, 0.25, 0.05), glow=5.0))
    add_light("Key", "SUN", 3.5, middle + size * Vector((2.0, -0.8, 2.2)), middle, (1.0, 0.93, 0.84))
    add_light(
        "Rim", "AREA", 30.0 * size**2, middle + size * Vector((-1.8, 1.4, 0.8)), middle, (0.5, 0.7, 1.0), size=size
    )
    _world((0.05, 0.06, 0.08), 0.4)


SETS = {"plate": plate, "chest": chest, "brain": brain, "angiography": angiography, "smoke": smoke}
DATA_OF = {"plate": "head", "chest": "chest", "brain": "brain", "angiography": "chest", "smoke": "smoke"}
