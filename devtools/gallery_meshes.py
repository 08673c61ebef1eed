"""The pictures of the guides on meshes among volumes: a foot's shadow by Cycles and by EEVEE, a brain among meshes,
and a brain baked to a Volume object of Cycles (runs in an environment with bpy).

Every step is an operator or a setting that a user has, too.
"""

from __future__ import annotations

import math

import bpy
from demo_scene import material, rod
from gallery_skull import remove_box
from gallery_studio import COLD, RENDER, WARM, Stage, softbox_world, view_transform
from mathutils import Matrix, Vector

LEVEL = Matrix.Rotation(math.radians(-24.0), 4, "X") @ Matrix.Rotation(math.radians(69.0), 4, "Y")  # sole down
LESION = Vector((-0.15, -0.19, 0.09))  # of the brain, from its middle, in sizes
STUDIO = (
    ((0.02, 0.02, 0.022), (0.05, 0.055, 0.065), (0.25, 0.27, 0.3)),
    (((1.6, 1.3, 0.8), 22.0, (3.0, 2.8, 2.6)), ((-1.6, 0.9, 0.6), 18.0, (1.2, 1.3, 1.5))),
    0.3,
)


def shadows(stage: Stage):
    """A foot on two pins that posts carry over a floor, and its shadow, by Cycles and by EEVEE."""
    scene = bpy.context.scene
    bpy.ops.rle_splat.apply_preset(preset="xa-limb")
    stage.volume.rle_splat.opacity_scale = 1.15
    stage.volume.matrix_world = LEVEL @ stage.volume.matrix_world
    ground = stage.foot - 0.04  # the floor is outside of the box, where skin casts a shadow, too
    enamel = material("Enamel", (0.45, 0.47, 0.5), roughness=0.4)
    toward = (0.75, 1.9, 1.3)
    stage.camera(toward, lens=48.0, aim=(0.03, 0.0, -0.38))
    stage.sweep(toward, ground, (0.1, 0.104, 0.112)).visible_shadow = False  # the key is behind its wall
    for y in (-0.3, 0.1):
        rod("Pin", stage.at(-0.58, y, 0.0), stage.at(0.58, y, 0.0), 0.008 * stage.size, enamel)
        for x in (-0.55, 0.55):
            rod("Post", stage.at(x, y, ground), stage.at(x, y, 0.02), 0.014 * stage.size, enamel)
    stage.lamp("Key", "SUN", 3.5, (-0.22, -0.28, 1.6), WARM, angle=math.radians(1.5))
    softbox_world(*STUDIO)
    stage.settings.quality, stage.settings.antialias = "fine", True
    view_transform("Standard")
    yield "Cycles"
    scene.render.engine, scene.eevee.taa_render_samples = "BLENDER_EEVEE", 64
    yield "EEVEE"


def _hoop(name: str, place: Vector, radius: float, degrees: float, turn: Matrix, thickness: float, coat) -> None:
    """A bent rod around a place, in the plane of x and y of ``turn``."""
    curve = bpy.data.curves.new(name, "CURVE")
    curve.dimensions, curve.bevel_depth, curve.bevel_resolution = "3D", thickness, 8
    points = curve.splines.new("POLY").points
    points.add(180)
    for n, point in enumerate(points):
        angle = math.radians(degrees * n / 180)
        point.co = (radius * math.cos(angle), radius * math.sin(angle), 0.0, 1.0)
    curve.materials.append(coat)
    made = bpy.data.objects.new(name, curve)
    bpy.context.scene.collection.objects.link(made)
    made.matrix_world = Matrix.Translation(place) @ turn


def meshes(stage: Stage):
    """A brain on a stand, cut open above a lesion, in a ring with an arc and a needle."""
    ours, at, size = stage.volume.rle_splat, stage.at, stage.size
    bpy.ops.rle_splat.apply_preset(preset="mr-brain")
    stage.volume.matrix_world = Matrix.Rotation(math.pi, 4, "Z") @ stage.volume.matrix_world  # seen from behind
    remove_box(Vector((size,) * 3), Matrix.Translation(at(-1.03, -1.06, LESION.z + 1.0)))
    bpy.context.view_layer.objects.active = stage.volume
    bpy.ops.rle_splat.gray_values_on_cut()
    ours.slices_follow_window, ours.slice_center, ours.slice_width = False, 125.0, 250.0
    ours.smoothness = 1.5
    steel = material("Steel", (0.5, 0.52, 0.56), roughness=0.35, metallic=1.0)
    brass = material("Brass", (0.95, 0.66, 0.27), roughness=0.4, metallic=1.0)
    ground, ring = -0.62, -0.1
    _hoop("Ring", at(0.0, 0.0, ring), 0.52 * size, 360.0, Matrix(), 0.014 * size, steel)
    upright = Matrix.Rotation(math.radians(90.0), 4, "X")
    _hoop("Arc", at(0.0, LESION.y, ring), 0.484 * size, 180.0, upright, 0.012 * size, steel)
    for degrees in (45.0, 135.0, 225.0, 315.0):
        x, y = 0.52 * math.cos(math.radians(degrees)), 0.52 * math.sin(math.radians(degrees))
        rod("Post", at(x, y, ground), at(x, y, ring), 0.012 * size, steel)
    rod("Stem", at(0.0, 0.1, ground), at(0.0, 0.05, 0.0), 0.016 * size, steel)
    along = Vector((-0.3, 0.0, 0.95))
    rod("Needle", at(*(LESION - 0.04 * along)), at(*(LESION + 0.42 * along)), 0.005 * size, brass)
    rod("Guide", at(*(LESION + 0.2 * along)), at(*(LESION + 0.3 * along)), 0.022 * size, brass)
    toward = (-0.95, -2.15, 0.8)
    stage.camera(toward, lens=44.0, aim=(0.0, 0.0, -0.19))
    stage.sweep(toward, ground, (0.08, 0.084, 0.092)).visible_shadow = False
    stage.lamp("Key", "SUN", 3.0, (-1.0, -0.6, 1.5), WARM, angle=math.radians(3.0))
    stage.area("Rim", 40.0, (1.4, 1.2, 0.9), COLD)
    softbox_world(*STUDIO)
    stage.settings.ambient_occlusion, stage.settings.quality, stage.settings.antialias = 0.8, "fine", True
    view_transform("Standard")
    yield RENDER


def baked(stage: Stage):
    """A brain under three lights, and baked in both looks of the button."""
    scene = bpy.context.scene
    view_transform("Standard")
    bpy.ops.rle_splat.apply_preset(preset="mr-brain")
    stage.camera((0.9, -1.7, 0.35), 87.0, aim=(0.0, 0.0, 0.04))
    bpy.ops.rle_splat.add_lights(kind="THREE")
    stage.settings.quality, stage.settings.antialias = "fine", True
    stage.without_background(scene.cycles.samples)
    scene.cycles.volume_bounces = 4
    yield "RLE Splat"
    bpy.ops.rle_splat.remove_from_renders()
    for look, title in (("LIT", "As Lit Here"), ("CYCLES", "Lit by Cycles")):
        bpy.ops.rle_splat.bake_volume(filepath=str(stage.folder / f"{look}.vdb"), look=look)
        made = bpy.context.view_layer.objects.active
        yield f"Baked, {title}"
        bpy.data.objects.remove(made)
