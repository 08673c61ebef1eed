"""A plate of titanium with screws, bent to the bone of a skull (runs in an environment with bpy)."""

from __future__ import annotations

import math
from importlib import import_module

import bpy
import numpy as np
from demo_scene import MODULE, named
from mathutils import Matrix, Vector

BONE_HU = 300.0
PLATE_SCREWS = 6


def bend_plate(volume_object, middle, toward, coat, screw_coat) -> None:
    """A strip with screws, bent to the outermost bone that lies ``toward`` from the middle."""
    read_scene = import_module(f"{MODULE}.bridge.scene.render_scene").read_scene
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
