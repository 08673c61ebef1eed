"""The sets of the gallery that show the body and its cells, each a generator that takes the stage with an imported
volume and yields the name of a picture whenever the scene is ready for it (runs in an environment with bpy).

Every step is an operator or a setting that a user has, too.
"""

from __future__ import annotations

import json
import math

import bpy
import gallery_data
from gallery_flat import cortex, pet
from gallery_light import lamps, light, worlds
from gallery_meshes import baked, meshes, shadows
from gallery_skull import skull
from gallery_studio import (
    COLD,
    RENDER,
    Stage,
    emission,
    letters,
    scale_bar,
    softbox_world,
    spare,
    view_transform,
)
from mathutils import Matrix, Vector

MM = 0.001
PLATE = -112.0  # the height of the slice above the middle of the scan
# Names, and the place of each in mm from the middle of the scan.
NAMES = (
    ("Right brachiocephalic vein", (-46.0, -21.0, 93.0)),
    ("Brachiocephalic trunk", (-26.0, -19.0, 88.0)),
    ("Ascending aorta", (-12.0, -28.0, 52.0)),
    ("Pulmonary trunk", (22.0, -22.0, 37.0)),
    ("Right ventricle", (10.0, -60.0, -33.0)),
    ("Stent graft", (14.0, 17.0, 86.0)),
    ("False lumen", (21.0, 62.0, 40.0)),
    ("Left inferior pulmonary vein", (40.0, 36.0, -22.0)),
    ("Left ventricle", (61.0, -30.0, -35.0)),
)
IN_LEFT, HEART, VIOLET = (83, 52, 60), "Heart", (0.34, 0.07, 0.37)  # voxel of a click, name, color
ABOVE = ((-100.0, -100.0, 104.25), (100.0, 100.0, 140.0))  # corners of a box, in mm from the middle: dense veins


def _lay_slice(stage: Stage):
    """An axial slice as the ground, with a window of its own."""
    bpy.context.view_layer.objects.active = stage.volume
    bpy.ops.rle_splat.add_slice(kind="AXIAL")
    made = bpy.context.view_layer.objects.active
    made.matrix_world = Matrix.Translation((0.0, 0.0, stage.middle.z + PLATE * MM
                                            - made.matrix_world.translation.z)) @ made.matrix_world  # fmt: skip
    ours = stage.volume.rle_splat
    ours.slices_follow_window = False
    ours.slice_center, ours.slice_width = 60.0, 400.0
    return made


def _change(ours, name: str, tool: str, length: float = 0.0) -> None:
    """One of Segment Tools on the segment of a name."""
    ours.active_label = next(n for n, row in enumerate(ours.labels) if row.label_name == name)
    bpy.ops.rle_splat.change_segment(tool=tool, **({"length": length} if length else {}))


def _name(stage: Stage, body: str, place) -> None:
    """A name beside the picture, with a line to a place, in mm from the middle."""
    bpy.context.view_layer.objects.active = stage.volume
    bpy.ops.rle_splat.add_name(text=body, point=stage.middle + MM * Vector(place))


def _cut(stage: Stage, low, high) -> None:
    """Cut off what a box holds, whose corners are in mm from the middle."""
    bpy.context.view_layer.objects.active = stage.volume
    bpy.ops.rle_splat.add_cutting_object(kind="BOX", keep="OUTSIDE")
    box, low, high = bpy.context.view_layer.objects.active, MM * Vector(low), MM * Vector(high)
    half = (high - low) / (2.0 * box.empty_display_size)
    box.matrix_world = Matrix.Translation(stage.middle + (low + high) / 2.0) @ Matrix.Diagonal((*half, 1.0))


def _show(ours, *shown: str) -> None:
    """The eyes of all segments."""
    for row in ours.labels:
        row.show = row.label_name in shown


def heart(stage: Stage):
    """The blood in a heart and its vessels, and the false lumen of a dissected aorta, on an axial slice of the scan."""
    stage.read_labels(gallery_data.DATA / "cta_aorta_labels/labels_true_false_lumen_uint8.nii.gz")
    ours = stage.volume.rle_splat
    true, false = (next(row.label_name for row in ours.labels if kind in row.label_name) for kind in ("true", "false"))
    _show(ours, "Background", true)
    ours.shift_by = 130.0
    bpy.ops.rle_splat.keep_connected(voxel=IN_LEFT)
    ours.labels[ours.active_label].label_name = HEART
    _change(ours, HEART, "GROW", 2.0)
    _show(ours, HEART, false)
    lumen = next(row for row in ours.labels if row.label_name == false)
    lumen.use_color, lumen.color = True, VIOLET
    ours.shift_by, ours.smoothness = 0.0, 1.5
    _cut(stage, *ABOVE)
    laid = _lay_slice(stage)
    stage.camera((1.62, -1.18, 0.75), lens=43.0, aim=(0.02, 0.03, -0.09))
    bpy.context.view_layer.update()
    white, ground = emission("Letters", (0.85, 0.87, 0.9)), PLATE + 1.0
    for body, place in NAMES:
        _name(stage, body, place)
    at, facing = Matrix.Translation(stage.middle), Matrix.Rotation(1.03, 4, "Z")
    for body, x, y in (("A", -30.0, -112.0), ("L", 120.0, 60.0)):
        letters(body, at @ Matrix.Translation(MM * Vector((x, y, ground))) @ facing, 20.0 * MM, white)
    bar = at @ Matrix.Translation(MM * Vector((112.0, 5.0, ground))) @ Matrix.Rotation(0.5 * math.pi, 4, "Z")
    scale_bar("50 mm", bar, 50.0 * MM, 12.0 * MM, white)
    floor = stage.sweep((1.75, -1.05), stage.foot - 4.0 * MM / stage.size, (0.055, 0.061, 0.075))
    floor.visible_shadow = False  # the key is behind its wall
    floor.active_material.node_tree.nodes["Principled BSDF"].inputs["Specular IOR Level"].default_value = 0.0
    bpy.context.scene.cycles.use_denoising = True
    stage.ground += (laid,)
    key = stage.lamp("Key", "SUN", 4.4, (-0.9, -0.5, 1.9), (1.0, 0.97, 0.94), angle=math.radians(5.0))
    spare("Key", key, (floor,))  # a shadow of ribs alone would look like an object
    stage.area("Fill", 24.0, (1.6, 0.6, 0.4), COLD)  # for the flank of the aorta
    softbox_world(
        ((0.02, 0.02, 0.022), (0.05, 0.055, 0.065), (0.25, 0.27, 0.3)),
        (((1.6, -1.3, 1.1), 24.0, (4.0, 3.8, 3.6)), ((1.2, 1.2, 0.6), 18.0, (3.0, 3.4, 4.0))),
        0.35,
    )
    stage.settings.ambient_occlusion, stage.settings.quality = 0.9, "strict"
    view_transform("Standard")
    yield RENDER


WHOLE = {2, 3, 5, 6, 7, 8, 11, 12, 13, 14}  # nuclei that no side of the stack cuts
DIVIDING = 4
# Opacity and color of nuclei by their values: chromatin is pale and opaque, what is between it dark and translucent.
CHROMATIN = {
    "name": "chromatin",
    "opacity": [[8200, 0.0], [9500, 0.03], [13000, 0.06], [18000, 0.5], [24000, 0.95]],
    "color": [[8200, 0.02, 0.06, 0.4], [13000, 0.05, 0.25, 0.85], [17000, 0.3, 0.62, 1.0], [24000, 0.9, 0.97, 1.0]],
    "opacity_unit_distance": 0.26,  # µm
}
GOLD = (0.95, 0.5, 0.08)
BUMPY = 13  # has a rim of its neighbor
SIDE_UM = 66.3  # of the stack
BAR_UM = 20.0  # of the scale bar


def nuclei(stage: Stage):
    """Nuclei above a slice of their own stack, the one that divides in another color."""
    stage.settings.scene_scale = 1.0  # a micrometer is a millimeter here: OpenVDB takes no smaller voxels
    stage = Stage.of(stage.volume, stage.folder)
    stage.read_labels(gallery_data.DATA / "fluorescence/nuclei_labels_256x256x60_uint32.tif")
    ours = stage.volume.rle_splat
    for row in ours.labels:
        row.show = row.label in WHOLE or row.label == DIVIDING
        if row.label == DIVIDING:
            row.use_color, row.color = True, GOLD
    (stage.folder / "chromatin.json").write_text(json.dumps(CHROMATIN) + "\n")
    bpy.ops.rle_splat.load_transfer_function(filepath=str(stage.folder / "chromatin.json"))
    ours.active_label = next(n for n, row in enumerate(ours.labels) if row.label == BUMPY)
    bpy.ops.rle_splat.change_segment(tool="SMOOTH", length=1.5)
    bpy.ops.rle_splat.add_slice(kind="AXIAL")
    bpy.context.view_layer.objects.active = stage.volume
    ours.slices_follow_window = False
    ours.slice_center, ours.slice_width = 14000.0, 26000.0
    bar = BAR_UM / SIDE_UM * stage.size
    white = emission("Letters", (0.85, 0.87, 0.9))
    scale_bar("20 µm", Matrix.Translation(stage.at(-0.3, -0.56, 0.01)), bar, 0.035 * stage.size, white)
    stage.camera((0.42, -1.25, 1.3), lens=43.0, aim=(-0.02, -0.1, 0.0))
    bpy.context.view_layer.update()
    _name(stage, "Dividing cell", (-22.4, -6.7, 1.7))
    stage.without_background(12)
    stage.key(4.0, (-1.3, 0.3, 0.9))
    stage.area("Rim", 40.0, (1.4, 1.2, 0.9), COLD)
    softbox_world(((0.02, 0.02, 0.022), (0.05, 0.055, 0.065), (0.25, 0.27, 0.3)),
                  (((1.6, -0.9, 0.8), 22.0, (2.6, 2.6, 2.8)),), 0.45)  # fmt: skip
    stage.settings.ambient_occlusion, stage.settings.quality = 0.8, "strict"
    view_transform("Standard")
    yield RENDER


SETS = {
    "skull": skull, "heart": heart, "nuclei": nuclei, "cortex": cortex, "pet": pet, "light": light, "lamps": lamps,
    "worlds": worlds,
    "shadows": shadows, "meshes": meshes, "baked": baked,
}  # fmt: skip
