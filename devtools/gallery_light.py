"""The pictures of the page of lighting recipes: six scans under the light that an import leaves, and under the recipe;
a brain whose lamps are added one by one; a brain under HDRIs, a skull before a backdrop and cut out (runs in an
environment with bpy).

Every step is an operator or a setting that a user has, too.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import bpy
from gallery_data import DATA
from gallery_studio import Stage, hdri_world, view_transform
from mathutils import Matrix

SKULL, HEAD = "dicom_ct_skull_phantom_512x512x140", "t1_head_188x256x190_uint8.nii.gz"
AORTA = "cta_aorta_labels/cta_heart_aorta_120x126x164_int16.nii.gz"
BRAIN = "flair_brain_124x160x140_uint8.nrrd"
LOBSTER = "lobster_301x324x56_uint8.raw.gz"
BARE = {
    "shape": (301, 324, 56),
    "dtype": "uint8",
    "byte_order": "little",
    "header_bytes": 0,
    "spacing": (1.0, 1.0, 1.4),
}
LOWEST = {AORTA: 290.0, LOBSTER: 40.0}  # values of the part that is kept


@dataclass(frozen=True)
class Recipe:
    """A scan of the data folder, how it is imported, what its volume is set to, and where the camera stands."""

    name: str
    file: str
    light: str  # kind of Add Lights
    options: dict = field(default_factory=dict)
    volume: dict = field(default_factory=dict)
    toward: tuple = (0.55, -1.9, 0.35)
    aim: tuple = (0.0, 0.0, 0.0)
    lens: float = 70.0
    turn: float = 0.0  # radians about Z


OPAQUE = {"opacity_unit_distance": 0.05, "smoothness": 2.0, "shift_by": -100.0}  # mm, mm, HU: thin bone is whole
RECIPES = (
    Recipe(
        "Three Lights",
        AORTA,
        "THREE",
        {"preset": "ct-angiography"},
        {"smoothness": 3.0},
        toward=(0.0, -1.95, 0.3),
        turn=-1.0,
        lens=57.0,
    ),
    Recipe(
        "For Bone",
        SKULL,
        "BONE",
        {"preset": "ct-bone"},
        OPAQUE,
        aim=(0.0, 0.0, -0.06),
        lens=77.0,
    ),
    Recipe("Soft Lights", BRAIN, "SOFT", {"preset": "mr-brain"}, lens=92.0),
    Recipe(
        "For Skin",
        HEAD,
        "SKIN",
        {"preset": "mr-head"},
        {"smoothness": 3.5, "specular": 0.15, "shininess": 12.0},
        toward=(0.75, -1.9, 0.15),
        aim=(0.0, 0.0, -0.06),
        lens=68.0,
    ),
    Recipe(
        "For Smoke",
        "smoke_fog.vdb",
        "SMOKE",
        aim=(0.0, 0.0, -0.08),
        lens=78.0,
    ),
    Recipe(
        "For Specimens",
        LOBSTER,
        "SPECIMEN",
        {**BARE, "preset": "ct-specimen"},
        toward=(0.35, -1.2, 1.4),
        aim=(0.02, -0.1, 0.0),
        lens=74.0,
    ),
)


def _without_holder() -> None:
    """Hide Table, and Grow, so that thin walls are not cut."""
    bpy.ops.rle_splat.hide_table()
    bpy.ops.rle_splat.change_segment(tool="GROW", length=2.0)


def _largest_part(volume, low: float) -> None:
    """Threshold to Segment, Keep Largest and Grow, with all else hidden, such as loose vessels."""
    bpy.ops.rle_splat.threshold_segment(low=low, high=volume.rle_splat.value_high)
    bpy.ops.rle_splat.change_segment(tool="LARGEST")
    bpy.ops.rle_splat.change_segment(tool="GROW", length=3.0)
    for row in volume.rle_splat.labels:
        row.show = row.label != 0


def _ready(stage: Stage) -> None:
    """What all pictures of this page share."""
    view_transform("Standard")
    stage.without_background()
    bpy.context.scene.cycles.use_denoising = False
    stage.settings.quality = "fine"


def lamps(stage: Stage):
    """A brain as it is imported, and with a key, a fill and a rim light, each added to those before."""
    _ready(stage)
    bpy.ops.rle_splat.apply_preset(preset="mr-brain")
    stage.camera((0.9, -1.7, 0.35), 84.0)
    yield "Headlight"
    bpy.ops.rle_splat.add_lights(kind="THREE")
    lights = [bpy.data.objects[name] for name in ("Key", "Fill", "Rim")]
    for one in lights:
        one.hide_render = True
    for one in lights:
        one.hide_render = False
        yield one.name if one.name == "Key" else f"+ {one.name}"


def _shown(stage: Stage, recipe: Recipe) -> Stage:
    """The scan of a recipe, in place of all objects, before the camera."""
    for one in list(bpy.data.objects):
        bpy.data.objects.remove(one)
    path = DATA / recipe.file
    first = min(path.iterdir()) if path.is_dir() else path
    bpy.ops.rle_splat.import_volume(filepath=str(first), at_cursor=True, **recipe.options)
    stage.volume = volume = bpy.context.view_layer.objects.active
    if path.suffix == ".vdb":
        volume.matrix_world = Matrix.Rotation(1.5708, 4, "X") @ volume.matrix_world
    volume.matrix_world = Matrix.Rotation(recipe.turn, 4, "Z") @ volume.matrix_world
    made = Stage.of(volume, stage.folder)
    if recipe.file == SKULL:
        _without_holder()
    if recipe.file in LOWEST:
        _largest_part(volume, LOWEST[recipe.file])
    for key, value in recipe.volume.items():
        setattr(volume.rle_splat, key, value)
    made.camera(recipe.toward, recipe.lens, recipe.aim)
    return made


def light(stage: Stage):
    """Each scan under the headlight, and under its recipe."""
    _ready(stage)
    for recipe in RECIPES:
        _shown(stage, recipe)
        yield f"Headlight of {recipe.name}"
        bpy.ops.rle_splat.add_lights(kind=recipe.light)
        yield recipe.name
        stage.settings.ambient_occlusion = stage.settings.indirect_light = 0.0
        bpy.context.scene.world = None


def worlds(stage: Stage):
    """A brain under two HDRIs of Blender; a skull before a backdrop, and cut out with its shadow."""
    scene, toward = bpy.context.scene, (0.55, -1.9, 0.3)
    _ready(stage)
    _shown(stage, Recipe("", BRAIN, "", {"preset": "mr-brain"}, toward=(1.6, -0.85, 0.6), lens=74.0))
    stage.settings.ambient_occlusion = 1.0
    scene.cycles.use_denoising, scene.render.film_transparent = True, False
    folder = Path(bpy.utils.system_resource("DATAFILES")) / "studiolights" / "world"
    for name in ("Studio", "Forest"):
        hdri_world(folder / f"{name.lower()}.exr")
        yield f"HDRI, {name}"
    scene.world = None
    made = _shown(stage, replace(RECIPES[1], toward=toward, lens=62.0, aim=(0.06, 0.0, -0.1)))
    floor = made.sweep(toward, made.foot - 0.01, (0.16, 0.165, 0.175))
    bpy.context.view_layer.objects.active = stage.volume
    bpy.ops.rle_splat.add_lights(kind="BONE")
    bpy.data.objects["Rim"].data.use_shadow = False  # one shadow on the floor
    yield "Backdrop"
    floor.is_shadow_catcher = scene.render.film_transparent = True
    yield "Cut-Out"
