"""The sets of the gallery that show the body and its cells, each a generator that takes the stage with an imported
volume and yields the name of a picture whenever the scene is ready for it (runs in an environment with bpy).

Every step is an operator or a setting that a user has, too.
"""

from __future__ import annotations

import math

import bpy
from demo_scene import bevelled, material, named, rod
from gallery_data import nuclei_labels
from gallery_skull import skull
from gallery_studio import COLD, RENDER, Stage, emission, plain_world, softbox_world, view_transform
from mathutils import Matrix, Vector

CELLS = ((0.86, 0.28, 0.22), (0.95, 0.62, 0.2), (0.35, 0.7, 0.3), (0.2, 0.6, 0.75), (0.3, 0.4, 0.85),
         (0.65, 0.35, 0.8), (0.9, 0.45, 0.6), (0.85, 0.8, 0.35))  # fmt: skip
MM = 0.001
# Of two vertebrae: the height of their pedicles, and where a screw enters on the left and on the right, in mm from the
# middle of the scan.
PEDICLES = ((14.8, -29.8, -2.3), (-16.8, -29.8, 0.2))
ENTRY = 61.8
BONE_VOXEL = (218, 345, 63)  # in the left pedicle
AORTA_VOXEL = (264, 270, 90)
PLATE = -34.6  # the height of the slice


def _letters(body: str, place: Vector, size: float, coat) -> None:
    """Text that lies flat, to be read from the patient's back."""
    curve = bpy.data.curves.new(body, "FONT")
    curve.body, curve.size, curve.align_x, curve.align_y = body, size, "CENTER", "CENTER"
    curve.materials.append(coat)
    made = bpy.data.objects.new(body, curve)
    bpy.context.scene.collection.objects.link(made)
    made.matrix_world = Matrix.Translation(place) @ Matrix.Rotation(math.pi, 4, "Z")


def _screw(entry: Vector, ahead: Vector, coat) -> Vector:
    """A pedicle screw that enters at a point; returns where its head holds the rod."""
    ahead = ahead.normalized()
    turned = ahead.to_track_quat("Z", "Y").to_matrix().to_4x4()
    for name, radius, length, along, sides in (
        ("Screw", 2.6, 42.0, 16.0, 48), ("Head", 5.8, 12.0, -8.5, 64), ("Set Screw", 3.6, 3.5, -15.0, 6),
    ):  # fmt: skip
        bpy.ops.mesh.primitive_cylinder_add(radius=radius * MM, depth=length * MM, vertices=sides)
        made = named(name, coat)
        made.matrix_world = Matrix.Translation(entry + along * MM * ahead) @ turned
        if name == "Head":
            bevelled(made, 1.2 * MM)
    return entry - 9.5 * MM * ahead


def _keep_bones(stage: Stage) -> None:
    """Remove Table; the aorta, then the bones, by Keep What Is Under the Mouse; Grow by two voxels."""
    ours = stage.volume.rle_splat
    bpy.context.view_layer.objects.active = stage.volume
    bpy.ops.rle_splat.apply_preset(preset="ct-bone")
    bpy.ops.rle_splat.remove_table()
    bpy.ops.rle_splat.keep_connected(voxel=AORTA_VOXEL, value=170.0)
    for row in ours.labels:
        row.show = row.label_name == "Body"
    bpy.ops.rle_splat.keep_connected(voxel=BONE_VOXEL, value=190.0)
    ours.active_label = next(n for n, row in enumerate(ours.labels) if row.show)
    bones = ours.labels[ours.active_label].label
    bpy.ops.rle_splat.change_segment(tool="GROW", length=1.6)
    for row in ours.labels:
        row.show = row.label == bones
    ours.window_center, ours.smoothness, ours.two_sided = 470.0, 1.4, False


def _lay_slice(stage: Stage) -> None:
    """An axial slice as the ground, with a window of its own."""
    bpy.context.view_layer.objects.active = stage.volume
    bpy.ops.rle_splat.add_slice(kind="axial")
    made = bpy.context.view_layer.objects.active
    made.matrix_world = Matrix.Translation((0.0, -6.0 * MM, stage.middle.z + PLATE * MM
                                            - made.matrix_world.translation.z)) @ made.matrix_world  # fmt: skip
    made.scale.y *= 0.79  # the table is beyond it
    stage.volume.rle_splat.slice_center, stage.volume.rle_splat.slice_width = 60.0, 700.0


def spine(stage: Stage):
    """Bones of a chest on an axial slice, seen from the back, with screws and rods in two vertebrae."""
    _keep_bones(stage)
    _lay_slice(stage)
    titanium = material("Titanium", (0.62, 0.62, 0.66), roughness=0.32, metallic=1.0)
    at = stage.middle
    for side in (1, 2):
        inward = 0.18 if side == 1 else -0.18
        upper, lower = (_screw(at + MM * Vector((row[side], ENTRY, row[0])), Vector((inward, -1.0, -0.05)), titanium)
                        for row in PEDICLES)  # fmt: skip
        beyond = 11.0 * MM * (lower - upper).normalized()
        rod("Rod", upper - beyond, lower + beyond, 2.75 * MM, titanium)
    white, ground = emission("Letters", (0.85, 0.87, 0.9)), PLATE + 1.0
    for body, x, y, size in (("R", -130.0, 85.0, 22.0), ("L", 110.0, 85.0, 22.0), ("50 mm", 65.0, 108.0, 9.0)):
        _letters(body, at + MM * Vector((x, y, ground)), MM * size, white)
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=at + MM * Vector((65.0, 118.0, ground)))
    named("Scale Bar", white).scale = (50.0 * MM, 1.2 * MM, 0.6 * MM)
    camera = stage.camera((0.6, 1.6, 1.05), lens=78.0, aim=(-0.05, 0.06, -0.03))
    camera.data.shift_x, camera.data.shift_y = -0.03, -0.02
    stage.without_background(12)
    bpy.context.scene.cycles.use_denoising = True
    stage.key(3.0, (-1.2, 1.4, 2.0))
    stage.area("Rim", 50.0, (1.6, -1.4, 1.0), COLD)
    softbox_world(
        ((0.02, 0.02, 0.022), (0.05, 0.055, 0.065), (0.25, 0.27, 0.3)),
        (((-1.3, 1.6, 1.1), 24.0, (6.0, 5.5, 5.0)), ((1.6, 0.9, 0.6), 18.0, (3.0, 3.4, 4.0))),
        0.6,
    )
    stage.settings.ambient_occlusion, stage.settings.quality = 0.7, "fine"
    view_transform("Standard")
    yield RENDER


def nuclei(stage: Stage):
    """Nuclei, each in a color of its own; one of them divides."""
    stage.read_labels(nuclei_labels())
    for row in stage.volume.rle_splat.labels:
        row.show = row.label != 0
        row.use_color, row.color = True, CELLS[row.label % len(CELLS)]
    stage.camera((0.4, -1.45, 1.75), lens=62.0, aim=(0.0, 0.03, 0.0))
    stage.without_background()
    stage.key(3.6, (-1.2, -1.0, 1.6))
    stage.area("Rim", 50.0, (1.2, 1.0, 0.8), COLD)
    plain_world((0.05, 0.06, 0.08), 0.6)
    stage.settings.ambient_occlusion = 0.8
    view_transform("Standard")
    yield RENDER


SETS = {"skull": skull, "spine": spine, "nuclei": nuclei}
