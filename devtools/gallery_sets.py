"""The sets of the gallery that show the body and its cells, each a generator that takes the stage with an imported
volume and yields the name of a picture whenever the scene is ready for it (runs in an environment with bpy).

Every step is an operator or a setting that a user has, too.
"""

from __future__ import annotations

import json
import math

import bpy
import gallery_data
from demo_scene import named, rod
from gallery_flat import cortex, pet
from gallery_light import lamps, light
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
# Names, the place of each in mm from the middle of the scan, and that of its text in the picture, in widths.
NAMES = (
    ("Brachiocephalic vein", (-55.0, -8.0, 112.0), (-0.24, 0.27)),
    ("Sternal wires", (-56.0, -65.0, 49.0), (-0.24, 0.2)),
    ("Ascending aorta", (-28.0, -23.0, 42.0), (-0.24, 0.12)),
    ("Pulmonary trunk", (7.0, -20.0, 39.0), (-0.24, 0.05)),
    ("Right ventricle", (-16.0, -46.0, -33.0), (-0.24, -0.02)),
    ("Stent graft", (-7.0, 34.0, 80.0), (0.26, 0.25)),
    ("False lumen", (10.0, 53.0, 64.0), (0.26, 0.19)),
    ("Pulmonary vessels", (18.0, 48.0, 32.0), (0.26, 0.04)),
    ("Left ventricle", (8.0, -5.0, -33.0), (0.26, -0.04)),
    ("Splenic artery", (30.0, 1.0, -84.0), (0.26, -0.12)),
)
PLUM = (0.2, 0.035, 0.13)  # of the false lumen: blue is for veins
IN_BONE = (42, 121, 59)  # a voxel, as a click finds it
IN_WIRE = (40, 9, 94)
IN_HEART = (76, 59, 77)
IVORY = (0.72, 0.62, 0.46)  # of bone
STEEL = (0.3, 0.33, 0.37)
SHADED = 0.9  # the part of the slice that is lit


def _lay_slice(stage: Stage):
    """An axial slice as the ground, with a window of its own, that takes shadows."""
    bpy.context.view_layer.objects.active = stage.volume
    bpy.ops.rle_splat.add_slice(kind="axial")
    made = bpy.context.view_layer.objects.active
    made.matrix_world = Matrix.Translation((0.0, 0.0, stage.middle.z + PLATE * MM
                                            - made.matrix_world.translation.z)) @ made.matrix_world  # fmt: skip
    ours = stage.volume.rle_splat
    ours.slices_follow_window = False
    ours.slice_center, ours.slice_width = 60.0, 400.0
    _let_shade(made)
    return made


def _let_shade(one) -> None:
    """Mix the emission of a slice's material with a diffuse surface of the same picture, which takes shadows."""
    tree = one.material_slots[0].material.node_tree
    of = {node.bl_idname: node for node in tree.nodes}
    diffuse, mix = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("BsdfDiffuse", "MixShader"))
    mix.inputs["Fac"].default_value = SHADED
    tree.links.new(of["ShaderNodeTexImage"].outputs["Color"], diffuse.inputs["Color"])
    tree.links.new(of["ShaderNodeEmission"].outputs[0], mix.inputs[1])
    tree.links.new(diffuse.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], of["ShaderNodeMixShader"].inputs[2])


def _change(ours, name: str, tool: str, length: float = 0.0) -> None:
    """One of Segment Tools on the segment of a name."""
    ours.active_label = next(n for n, row in enumerate(ours.labels) if row.label_name == name)
    bpy.ops.rle_splat.change_segment(tool=tool, **({"length": length} if length else {}))


def _name(stage: Stage, camera, body: str, place, at: tuple[float, float], coat) -> None:
    """A name in the plane half-way to the middle, and a line from it to what is seen at a place."""
    data = camera.data
    depth = 0.5 * (camera.matrix_world.translation - stage.middle).length
    width = depth * data.sensor_width / data.lens
    begin = Vector((at[0] * width, at[1] * width, -depth))
    side = -1.0 if at[0] < 0.0 else 1.0
    text = camera.matrix_world @ Matrix.Translation(begin + Vector((side * 0.008 * width, 0.0, 0.0)))
    letters(body, text, 0.0235 * width, coat, "RIGHT" if side < 0.0 else "LEFT")
    into = camera.matrix_world.inverted() @ (stage.middle + MM * Vector(place))
    end = camera.matrix_world @ (into * (depth / -into.z))
    rod(f"Line to {body}", camera.matrix_world @ begin, end, 0.0007 * width, coat)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.004 * width, location=end)
    named(f"End at {body}", coat).visible_shadow = False


def _keep(ours, name: str, voxel: tuple[int, int, int], margin: float) -> None:
    """Keep What Is Under the Mouse, and Grow, so that the segment does not cut the surface."""
    bpy.ops.rle_splat.keep_connected(voxel=voxel)
    ours.labels[ours.active_label].label_name = name
    _change(ours, name, "GROW", margin)


def _show(ours, *shown: str) -> None:
    """The eyes of all segments."""
    for row in ours.labels:
        row.show = row.label_name in shown


def heart(stage: Stage):
    """Heart and vessels of a patient by their values, the bones and the false lumen of the aorta as segments, on an
    axial slice of the same scan."""
    stage.read_labels(gallery_data.DATA / "cta_aorta_labels/labels_true_false_lumen_uint8.nii.gz")
    ours = stage.volume.rle_splat
    false, true = (next(row.label_name for row in ours.labels if part in row.label_name) for part in ("false", "true"))
    _show(ours, "Background")
    ours.shift_by = 130.0  # HU: the sternum is apart
    _keep(ours, "Sternum", IN_WIRE, 3.0)
    bpy.ops.rle_splat.threshold_segment(low=1000.0, high=ours.value_high)
    ours.labels[ours.active_label].label_name = "Wires"
    _change(ours, "Wires", "GROW", 1.6)
    ours.shift_by = 80.0  # vessels and other bones are apart
    _show(ours, "Background")
    _keep(ours, "Bones", IN_BONE, 3.0)
    _show(ours, "Background", true)
    _keep(ours, "Heart and Vessels", IN_HEART, 2.0)
    ours.shift_by = 0.0
    _change(ours, false, "LARGEST")
    _change(ours, false, "GROW", 2.0)
    colors = {false: PLUM, "Bones": IVORY, "Sternum": IVORY, "Wires": STEEL}
    for row in ours.labels:
        row.show = row.label_name != "Background"
        if row.label_name in colors:
            row.use_color, row.color = True, colors[row.label_name]
    ours.smoothness, ours.opacity_unit_distance = 4.0, 1.0
    laid = _lay_slice(stage)
    camera = stage.camera((1.75, -1.05, 0.55), lens=42.0, aim=(0.01, 0.017, -0.06))
    bpy.context.view_layer.update()
    white, ground = emission("Letters", (0.85, 0.87, 0.9)), PLATE + 1.0
    for body, place, at in NAMES:
        _name(stage, camera, body, place, at, white)
    at, facing = Matrix.Translation(stage.middle), Matrix.Rotation(1.03, 4, "Z")
    for body, x, y in (("A", -30.0, -112.0), ("L", 120.0, 60.0)):
        letters(body, at @ Matrix.Translation(MM * Vector((x, y, ground))) @ facing, 20.0 * MM, white)
    bar = at @ Matrix.Translation(MM * Vector((116.0, -40.0, ground))) @ Matrix.Rotation(0.5 * math.pi, 4, "Z")
    scale_bar("50 mm", bar, 50.0 * MM, 12.0 * MM, white)
    floor = stage.sweep((1.75, -1.05), stage.foot - 4.0 * MM / stage.size, (0.03, 0.034, 0.044))
    floor.visible_shadow = False  # the key is behind its wall
    floor.active_material.node_tree.nodes["Principled BSDF"].inputs["Specular IOR Level"].default_value = 0.0
    bpy.context.scene.cycles.use_denoising = True
    stage.ground += (laid,)
    key = stage.key(3.4, (1.3, -1.5, 1.7), (1.0, 0.97, 0.94))
    spare("Key", key, (floor,))  # a shadow of ribs alone would look like an object
    stage.area("Rim", 50.0, (-0.8, 1.6, 1.0), COLD)
    softbox_world(
        ((0.02, 0.02, 0.022), (0.05, 0.055, 0.065), (0.25, 0.27, 0.3)),
        (((1.6, -1.3, 1.1), 24.0, (4.0, 3.8, 3.6)), ((1.2, 1.2, 0.6), 18.0, (3.0, 3.4, 4.0))),
        0.35,
    )
    stage.settings.ambient_occlusion, stage.settings.quality = 0.8, "strict"
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
    bpy.ops.rle_splat.load_transfer(filepath=str(stage.folder / "chromatin.json"))
    ours.active_label = next(n for n, row in enumerate(ours.labels) if row.label == BUMPY)
    bpy.ops.rle_splat.change_segment(tool="SMOOTH", length=1.5)
    bpy.ops.rle_splat.add_slice(kind="axial")
    _let_shade(bpy.context.view_layer.objects.active)
    bpy.context.view_layer.objects.active = stage.volume
    ours.slices_follow_window = False
    ours.slice_center, ours.slice_width = 14000.0, 26000.0
    bar = BAR_UM / SIDE_UM * stage.size
    white = emission("Letters", (0.85, 0.87, 0.9))
    scale_bar("20 µm", Matrix.Translation(stage.at(-0.3, -0.56, 0.01)), bar, 0.035 * stage.size, white)
    camera = stage.camera((0.42, -1.25, 1.3), lens=43.0, aim=(-0.02, -0.1, 0.0))
    bpy.context.view_layer.update()
    _name(stage, camera, "Dividing nucleus", (-22.4, -6.7, 1.7), (-0.27, 0.2), white)
    stage.without_background(12)
    stage.key(4.0, (-1.3, 0.3, 0.9))
    stage.area("Rim", 40.0, (1.4, 1.2, 0.9), COLD)
    softbox_world(((0.02, 0.02, 0.022), (0.05, 0.055, 0.065), (0.25, 0.27, 0.3)),
                  (((1.6, -0.9, 0.8), 22.0, (2.6, 2.6, 2.8)),), 0.45)  # fmt: skip
    stage.settings.ambient_occlusion, stage.settings.quality = 0.8, "strict"
    view_transform("Standard")
    yield RENDER


SETS = {"skull": skull, "heart": heart, "nuclei": nuclei, "cortex": cortex, "pet": pet, "light": light, "lamps": lamps}
