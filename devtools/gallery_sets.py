"""The sets of the gallery that show the body, each a generator that takes the stage with an imported volume and yields
the name of a picture whenever the scene is ready for it (runs in an environment with bpy)."""

from __future__ import annotations

import math

import bpy
from demo_scene import material, named, rod
from gallery_data import FRONT, HEART, KIDNEYS, PEELED, SPECKS, STRAY, organs, peel
from gallery_objects import engine, smoke
from gallery_plate import bend_plate
from gallery_studio import COLD, RENDER, WARM, Stage, plain_world, softbox_world, view_transform
from mathutils import Vector

CLEAR = 0.02  # sizes from a thin foot to the floor, which gets no shadow where it touches the volume's box
SKIN_AND_BONE = {
    "name": "skin and bone", "unit": "HU",
    "opacity": [[-1000, 0], [-650, 0], [-200, 0.5], [50, 0.9], [200, 0.9], [600, 0.97], [2000, 0.98]],
    "color": [[-1000, 0.78, 0.5, 0.37], [-120, 0.78, 0.5, 0.37], [-60, 0.75, 0.45, 0.28], [20, 0.5, 0.13, 0.09],
              [150, 0.55, 0.17, 0.12], [180, 0.87, 0.79, 0.64], [800, 0.9, 0.83, 0.7], [2500, 0.98, 0.97, 0.94]],
    "shade": {"ambient": 0.22, "diffuse": 0.8, "specular": 0.22, "shininess": 22},
}  # fmt: skip
# The four looks of one view.
LOOKS = {
    "skin": SKIN_AND_BONE,
    "glass": {
        **SKIN_AND_BONE, "name": "bone under clear skin",
        "opacity": [[-1000, 0], [-450, 0], [-300, 0.02], [-150, 0.02], [-50, 0.004], [180, 0.004], [330, 0.5],
                    [700, 0.9], [2000, 0.97]],
    },
    "bone": {
        **SKIN_AND_BONE, "name": "bone",
        "opacity": [[-1000, 0], [180, 0], [330, 0.4], [700, 0.85], [2000, 0.97]],
    },
}  # fmt: skip
# Names and colors of a chest's labels.
ORGANS = {HEART: ("Heart and great vessels", (0.72, 0.07, 0.05)), KIDNEYS: ("Kidneys", (0.42, 0.13, 0.09))}
BONES = {
    "name": "bones", "unit": None, "opacity": [[0, 0], [60, 0], [100, 0.25], [170, 0.75], [255, 0.95]],
    "color": [[0, 0.8, 0.62, 0.45], [110, 0.84, 0.72, 0.55], [190, 0.9, 0.83, 0.7], [255, 0.97, 0.94, 0.88]],
    "shade": {"ambient": 0.2, "diffuse": 0.8, "specular": 0.25, "shininess": 22},
}  # fmt: skip
BLOOD = {
    "name": "vessels", "unit": None, "opacity": [[0, 0], [28, 0], [50, 0.45], [90, 0.85], [255, 0.97]],
    "color": [[0, 0.55, 0.16, 0.1], [50, 0.62, 0.15, 0.09], [90, 0.72, 0.14, 0.08], [130, 0.78, 0.2, 0.12],
              [200, 0.92, 0.62, 0.45]],
    "shade": {"ambient": 0.18, "diffuse": 0.82, "specular": 0.4, "shininess": 40},
}  # fmt: skip


def _mounted_head(stage: Stage) -> None:
    """The head upright, without what it lies on and without the slices that metal in the teeth has streaked."""
    stage.turn(180.0, "X")  # the scan's z runs from the crown down
    stage.show(SKIN_AND_BONE)
    shape = tuple(stage.volume.rle_splat.shape)
    stage.hide_labels(peel(stage.folder, stage.folder / "head.raw", shape), {STRAY: "Head rest and noise"})
    stage.clip_plane("Head Rest", stage.at(0.0, -0.418, 0.0), (0.0, -1.0, 0.0))
    stage.clip_plane("Below the Nose", stage.at(0.0, 0.44, -0.09), (0.0, 0.1, -1.0))


def plate(stage: Stage):
    """A head whose skin is peeled off on one side, where a plate of titanium is screwed to the bone."""
    _mounted_head(stage)
    for row in stage.volume.rle_splat.labels:
        if row.label == PEELED:
            row.label_name, row.look = "Peeled", "ct-bone"
    # Labels with a transfer function of their own are pre-classified: a wider footprint than the tent is smoother.
    stage.settings.classification, stage.settings.kernel = "pre", "bspline2"
    toward = (-1.75, 3.2, 0.95)
    stage.camera(toward, lens=112.0, aim=(-0.06, -0.03, 0.01))
    titanium = material("Titanium", (0.36, 0.36, 0.38), roughness=0.45, metallic=1.0)
    screws = material("Screws", (0.3, 0.3, 0.33), roughness=0.3, metallic=1.0)
    bend_plate(stage.volume, stage.middle, (-0.75, 0.45, 0.5), titanium, screws)
    steel = material("Steel", (0.55, 0.56, 0.58), roughness=0.3, metallic=1.0)
    stage.sweep(toward, -0.41)
    stage.disk("Plinth", stage.at(0.0, -0.03, -0.33), 0.24, 0.08, material("Plinth", (0.16, 0.165, 0.175), 0.5))
    rod("Stem", stage.at(0.0, -0.03, -0.33), stage.at(0.0, -0.03, 0.0), 0.016 * stage.size, steel)
    stage.key(3.2, (0.9, 2.4, 2.4))
    stage.area("Rim", 70.0, (1.3, -1.9, 1.2), COLD, side=0.7)
    stage.area("Left Rim", 28.0, (-2.3, -0.8, 0.4), COLD, side=0.6)
    stage.area("Fill", 8.0, (1.8, 2.6, 0.0), WARM, side=2.0)
    plain_world((0.06, 0.07, 0.09), 0.6)
    stage.settings.ambient_occlusion = 0.8
    view_transform("Standard")
    yield RENDER


def looks(stage: Stage):
    """One view of a head under four transfer functions, the last as an X-ray."""
    _mounted_head(stage)
    stage.camera((-2.0, 3.2, 0.5), lens=158.0, aim=(-0.08, -0.05, 0.12))
    stage.without_background()
    stage.key(3.2, (0.6, 2.6, 2.2))
    stage.area("Rim", 90.0, (1.6, -1.6, 1.0), COLD, side=0.8)
    plain_world((0.06, 0.07, 0.09), 0.5)
    stage.settings.ambient_occlusion = 0.8
    view_transform("Standard")
    for name, function in LOOKS.items():
        stage.show(function)
        yield name
    plain_world((0.0, 0.0, 0.0), 0.0)
    stage.settings.display = "xray"
    look = stage.volume.rle_splat
    look.window_center, look.window_width, look.opacity_scale = 1300.0, 2600.0, 0.25
    yield "xray"


def chest(stage: Stage):
    """The bones of the chest; the heart and its vessels are a label with its own color, and the front is cut away."""
    stage.show(BONES)
    stage.hide_labels(organs(stage.folder), {SPECKS: "Specks"})
    for row in stage.volume.rle_splat.labels:
        if row.label in ORGANS:
            row.use_color, (row.label_name, row.color) = True, ORGANS[row.label]
    stage.settings.classification, stage.settings.kernel = "pre", "bspline2"
    stage.cut_box("Window", stage.at(-0.02, -0.45, -0.02), (0.24, 0.3, 0.3))
    stage.clip_plane("Table", stage.at(0.0, 0.31, 0.0), (0.0, 1.0, 0.0))
    stage.clip_plane("Front", stage.at(0.0, FRONT - 0.5, 0.0), (0.0, -1.0, 0.0))
    toward = (-1.3, -3.0, 0.75)
    stage.camera(toward, lens=92.0, aim=(0.0, 0.0, -0.03))
    stage.sweep(toward, stage.foot - CLEAR)
    stage.key(3.8, (-1.5, -1.8, 2.3))
    stage.area("Rim", 90.0, (1.9, 1.6, 1.2), COLD, side=0.9)
    stage.area("Fill", 10.0, (2.4, -1.8, 0.0), WARM, side=2.0)
    plain_world((0.06, 0.07, 0.09), 0.6)
    stage.settings.ambient_occlusion = 0.8
    view_transform("Standard")
    yield RENDER


def vessels(stage: Stage):
    """The same angiography twice: shaded under three lights on a floor, and the largest value along each ray."""
    stage.show(BLOOD)
    toward = (0.9, -3.0, 0.55)
    stage.camera(toward, lens=118.0, aim=(0.02, -0.03, -0.04))
    floor = stage.sweep(toward, stage.foot - CLEAR)
    stage.key(3.4, (-1.2, -1.6, 2.5))
    stage.area("Rim", 120.0, (1.9, 1.5, 0.9), COLD, side=0.8)
    stage.area("Fill", 9.0, (2.2, -2.0, -0.2), WARM, side=2.0)
    plain_world((0.03, 0.034, 0.042), 0.6)
    stage.settings.ambient_occlusion = 0.8
    view_transform("Standard")
    yield "shaded"
    floor.hide_render = True
    stage.without_background()
    plain_world((0.0, 0.0, 0.0), 0.0)
    stage.settings.display = "mip"
    stage.volume.rle_splat.window_center, stage.volume.rle_splat.window_width = 120.0, 250.0
    yield "mip"


def _glossy(stage: Stage) -> None:
    look = stage.volume.rle_splat
    look.two_sided, look.specular, look.shininess = False, 0.35, 30.0


def _brain_in_a_studio(stage: Stage) -> None:
    """A brain on a stem, with two balls that show the light: a world of softboxes, and lamps where they are."""
    _glossy(stage)
    low = stage.low
    top = Vector((stage.middle.x, stage.middle.y, low.z - 0.1 * stage.size))
    brass = material("Brass", (0.9, 0.62, 0.28), roughness=0.22, metallic=1.0)
    stage.disk("Plinth", top, 0.34, 0.16, material("Plinth", (0.03, 0.032, 0.036), roughness=0.25))
    rod("Stem", top, stage.middle, 0.02 * stage.size, brass)
    boxes = (((1.3, 1.6, 1.1), 20.0, (9.0, 8.2, 7.2)), ((-1.6, -0.9, 0.9), 16.0, (5.0, 6.4, 8.5)),
             ((-1.2, 1.5, 0.1), 14.0, (1.6, 1.5, 1.4)))  # fmt: skip
    softbox_world(((0.02, 0.02, 0.024), (0.06, 0.066, 0.076), (0.2, 0.23, 0.28)), boxes, 0.8)
    stage.key(3.6, (1.5, 1.2, 1.6))
    stage.area("Rim", 80.0, (-1.6, -0.9, 0.9), COLD, side=0.8)
    stage.area("Fill", 9.0, (-1.2, 1.5, 0.1), WARM, side=0.8)
    stage.settings.ambient_occlusion = 0.8
    view_transform("Standard")


def brain(stage: Stage):
    _brain_in_a_studio(stage)
    toward = (1.5, 3.1, 0.9)
    floor = stage.low.z - 0.26 * stage.size
    for name, place, coat in (
        ("Chrome Ball", (0.54, -0.12), material("Chrome", (0.9, 0.9, 0.9), roughness=0.03, metallic=1.0)),
        ("Gray Ball", (-0.46, 0.35), material("Gray", (0.18, 0.18, 0.18), roughness=0.9)),
    ):
        radius = 0.12 * stage.size
        bpy.ops.mesh.primitive_uv_sphere_add(
            radius=radius, segments=96, ring_count=48, location=(
                stage.middle.x + place[0] * stage.size, stage.middle.y + place[1] * stage.size, floor + radius),
        )  # fmt: skip
        named(name, coat)
    bpy.ops.mesh.primitive_plane_add(size=60 * stage.size, location=(stage.middle.x, stage.middle.y, floor))
    named("Floor", material("Floor", (0.035, 0.038, 0.043), roughness=0.4))
    stage.camera(toward, lens=82.0, aim=(0.0, 0.0, -0.16))
    yield RENDER


def turntable(stage: Stage, frames: int = 30):
    """The camera's way around the brain, a picture for each step."""
    _glossy(stage)
    stage.without_background()
    stage.key(3.6, (1.3, 1.6, 1.6))
    stage.area("Rim", 60.0, (-1.6, -0.9, 0.9), COLD, side=0.8)
    stage.area("Fill", 9.0, (-1.2, 1.5, 0.1), WARM, side=0.8)
    plain_world((0.06, 0.07, 0.09), 0.8)
    stage.settings.ambient_occlusion = 0.8
    view_transform("Standard")
    for frame in range(frames):
        angle = 2.0 * math.pi * frame / frames
        stage.camera((3.3 * math.sin(angle), 3.3 * math.cos(angle), 0.7), lens=88.0)
        yield f"turn{frame:02d}"


SETS = {
    "plate": plate, "chest": chest, "vessels": vessels, "brain": brain, "looks": looks, "smoke": smoke,
    "engine": engine, "turntable": turntable,
}  # fmt: skip
DATA_OF = {
    "plate": "head", "chest": "chest", "vessels": "vessels", "brain": "template", "looks": "head", "smoke": "smoke",
    "engine": "engine", "turntable": "template",
}  # fmt: skip
