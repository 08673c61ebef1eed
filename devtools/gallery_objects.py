"""The sets of the gallery that show other things than the body: smoke and an engine (runs in an
environment with bpy)."""

from __future__ import annotations

import math

import bpy
from demo_scene import material, named, stand_upright
from gallery_studio import COLD, RENDER, WARM, Stage, plain_world, softbox_world, view_transform

CASTING = {
    "name": "aluminium and steel", "unit": None,
    "opacity": [[0, 0], [75, 0], [100, 0.5], [150, 0.9], [255, 0.98]],
    "color": [[0, 0.5, 0.52, 0.55], [150, 0.56, 0.58, 0.61], [178, 0.62, 0.6, 0.56], [205, 0.9, 0.42, 0.09],
              [255, 0.98, 0.6, 0.2]],
    "shade": {"ambient": 0.15, "diffuse": 0.8, "specular": 0.55, "shininess": 45},
}  # fmt: skip


def smoke(stage: Stage):
    """Smoke over a stone, through a ring of brass; an ember lights it from within."""
    stand_upright(stage.volume)
    stage = Stage.of(stage.volume, stage.folder)
    look = stage.volume.rle_splat
    look.opacity_scale, look.ambient, look.diffuse = 5.0, 0.2, 1.0
    toward = (1.35, -1.75, 0.45)
    stage.camera(toward, lens=62.0, aim=(0.0, 0.0, -0.03))
    stage.sweep(toward, -0.565, (0.02, 0.022, 0.026))
    brass = material("Brass", (0.9, 0.55, 0.2), roughness=0.25, metallic=1.0)
    heart = stage.at(0.0, 0.0, -0.08)
    bpy.ops.mesh.primitive_torus_add(
        major_radius=0.16 * stage.size, minor_radius=0.014 * stage.size, major_segments=192, minor_segments=48,
        location=heart, rotation=(math.radians(68.0), 0.0, math.radians(60.0)),
    )  # fmt: skip
    named("Ring", brass)
    bpy.ops.mesh.primitive_ico_sphere_add(radius=0.035 * stage.size, subdivisions=6, location=heart)
    named("Ember", material("Ember", (1.0, 0.2, 0.02), glow=1.6))
    stage.disk("Stone", stage.at(0.06, 0.04, -0.475), 0.2, 0.09, material("Stone", (0.05, 0.053, 0.06), 0.5))
    # The ember itself must not shade what it lights.
    stage.lamp("Glow", "POINT", 0.9, (0.0, 0.0, -0.08), (1.0, 0.3, 0.06), shadow_soft_size=0.01, use_shadow=False)
    stage.key(2.2, (1.9, 0.6, 1.4))
    stage.area("Rim", 40.0, (-1.6, 0.6, 0.6), (0.4, 0.62, 1.0), side=0.8)
    softbox_world(((0.02, 0.022, 0.03), (0.1, 0.11, 0.13), (0.2, 0.22, 0.26)),
                  (((1.3, -1.0, 1.2), 22.0, (6.0, 5.4, 4.6)), ((-1.6, -0.4, 0.4), 15.0, (1.5, 2.2, 3.4))), 1.0)
    stage.settings.ambient_occlusion = 0.5
    view_transform("Standard")
    yield RENDER


def _lit(stage: Stage, toward) -> None:
    """Three lights around what a camera ``toward`` sees."""
    away = math.atan2(toward[1], toward[0])

    def around(degrees, far, up):
        angle = away + math.radians(degrees)
        return far * math.cos(angle), far * math.sin(angle), up

    stage.key(3.8, around(-50.0, 2.3, 2.4))
    stage.area("Rim", 95.0, around(150.0, 2.2, 1.5), COLD, side=0.9)
    stage.area("Fill", 12.0, around(60.0, 3.0, 0.8), WARM, side=2.0)
    plain_world((0.06, 0.07, 0.09), 0.6)
    stage.settings.ambient_occlusion = 0.8
    view_transform("Standard")


def engine(stage: Stage):
    """A casting with its steel parts, a quarter of it cut away."""
    stage.show(CASTING)
    toward = (-1.7, -2.4, 1.5)
    stage.cut_box("Quarter", stage.at(-0.5, -0.5, 0.3), (0.42, 0.42, 0.3))
    stage.camera(toward, lens=90.0, aim=(0.0, 0.0, -0.02))
    stage.sweep(toward, stage.foot)
    _lit(stage, toward)
    yield RENDER
