"""The set of the gallery that shows a skull, cut open, with a plate of titanium on it (runs in an environment with
bpy).

Every step is an operator, a modifier or a setting that a user has, too.
"""

from __future__ import annotations

import math

import bpy
from demo_scene import material, named
from gallery_studio import COLD, RENDER, WARM, Stage, emission, letters, scale_bar, softbox_world, view_transform
from mathutils import Matrix, Vector

MM = 0.001
CORNER = Vector((4.0, 0.0, 14.0))  # the left upper quarter beyond it is cut away
PATCH = Vector((-22.0, -150.0, 24.0))  # before the forehead, where the plate is
DEFECT = Vector((12.0, 14.0, 12.0))  # half the sides of the hole below the plate, in mm
CELL, COLUMNS, ROWS = 5.8, 9, 9  # of the plate: mm from hole to hole; holes
SOLID = 250.0  # HU: between air and the plastic of the skull, 700 HU
WINDOW = 400.0, 1200.0  # HU, level and width
SHIFT = -140.0  # HU: thin walls are less dense
THICKNESS = 0.05  # mm that have the opacity of the curve: light through a clear wall would show the layers of 1 mm


def _net(middle: Vector) -> bpy.types.Object:
    """A flat net of hexagons that faces the patient's front, with round corners."""
    corners, vertices, faces = {}, [], []
    half = 0.5 * Vector(((COLUMNS - 1) * CELL, (ROWS - 1) * CELL * math.sqrt(0.75)))
    for row in range(ROWS):
        for column in range(COLUMNS - row % 2):
            x, z = (column + 0.5 * (row % 2)) * CELL - half.x, row * CELL * math.sqrt(0.75) - half.y
            if (abs(x) / half.x) ** 4 + (abs(z) / half.y) ** 4 > 1.15:
                continue
            face = []
            for step in range(6):
                angle = math.radians(30.0 + 60.0 * step)
                place = (x + CELL / math.sqrt(3.0) * math.cos(angle), z + CELL / math.sqrt(3.0) * math.sin(angle))
                key = tuple(round(part, 3) for part in place)
                if key not in corners:
                    corners[key] = len(vertices)
                    vertices.append(MM * Vector((place[0], 0.0, place[1])))
                face.append(corners[key])
            faces.append(face)
    mesh = bpy.data.meshes.new("Plate")
    mesh.from_pydata(vertices, [], faces)
    made = bpy.data.objects.new("Plate", mesh)
    made.location = middle
    bpy.context.scene.collection.objects.link(made)
    return made


def _applied(made) -> bpy.types.Mesh:
    """The mesh of an object with its modifiers."""
    bpy.context.view_layer.update()
    return bpy.data.meshes.new_from_object(made.evaluated_get(bpy.context.evaluated_depsgraph_get()))


def _surface_before(bone, eye: Vector) -> tuple[Vector, Vector]:
    """The mean place and normal of the surface that an eye at the patient's front sees in a square of 3 cm."""
    inward = bone.matrix_world.inverted()
    hits = [bone.ray_cast(inward @ (eye + 5.0 * MM * Vector((x, 0.0, z))), (0.0, 1.0, 0.0))
            for x in range(-3, 4) for z in range(-3, 4)]  # fmt: skip
    place, normal = (sum((hit[part] for hit in hits), Vector()) / len(hits) for part in (1, 2))
    return bone.matrix_world @ place, normal.normalized()


def remove_box(half: Vector, matrix: Matrix) -> None:
    """A box that cuts away what is inside; ``half`` of its sides, in meters."""
    bpy.ops.rle_splat.add_cutting_object(kind="BOX", keep="OUTSIDE")
    box = bpy.context.view_layer.objects.active
    box.matrix_world = matrix @ Matrix.Diagonal((*(half / box.empty_display_size), 1.0))


def _plate(stage: Stage, bone, coat) -> tuple[Vector, Vector]:
    """A net shrinkwrapped onto the bone, its bars made solid, with screws along its edge; returns the place and the
    normal of the bone below its middle."""
    place, normal = below = _surface_before(bone, stage.middle + MM * PATCH)
    plate = _net(place + 15.0 * MM * normal)
    plate.rotation_euler = normal.to_track_quat("-Y", "Z").to_euler()
    wrap = plate.modifiers.new("On the Bone", "SHRINKWRAP")
    wrap.target, wrap.wrap_method, wrap.project_limit = bone, "PROJECT", 0.2
    wrap.use_project_y, wrap.use_positive_direction, wrap.use_negative_direction = True, True, False
    wrap.use_project_x = wrap.use_project_z = False
    wrap.offset = 1.3 * MM  # bars lie on the bone
    relaxed = plate.modifiers.new("Relaxed", "SMOOTH")
    relaxed.factor, relaxed.iterations = 0.5, 3
    flat = _applied(plate)
    to_world = plate.matrix_world.copy()
    bars = plate.modifiers.new("Bars", "WIREFRAME")
    bars.thickness, bars.offset, bars.use_boundary, bars.use_even_offset = 2.4 * MM, 0.0, True, False
    smooth = plate.modifiers.new("Round", "SUBSURF")
    smooth.levels = smooth.render_levels = 1
    plate.data.materials.append(coat)
    edges = {}
    for polygon in flat.polygons:
        for key in polygon.edge_keys:
            edges.setdefault(key, []).append(polygon.index)
    rim = sorted({faces[0] for faces in edges.values() if len(faces) == 1})
    center = sum((flat.polygons[n].center for n in rim), Vector()) / len(rim)
    rim.sort(key=lambda n: math.atan2(flat.polygons[n].center.z - center.z, flat.polygons[n].center.x - center.x))
    bpy.context.view_layer.update()
    to_plate = plate.matrix_world.inverted()
    for turn, n in enumerate(rim[:: max(len(rim) // 9, 1)]):
        polygon = flat.polygons[n]
        normal = (to_world.to_3x3() @ polygon.normal).normalized()
        normal = normal if normal.y < 0.0 else -normal
        turned = normal.to_track_quat("Z", "Y").to_matrix().to_4x4()
        place = to_world @ polygon.center
        bpy.ops.mesh.primitive_uv_sphere_add(radius=2.5 * MM, segments=48, ring_count=24)
        head = named("Screw", coat)
        head.matrix_world = Matrix.Translation(place) @ turned @ Matrix.Diagonal((1.0, 1.0, 0.45, 1.0))
        bpy.ops.mesh.primitive_cube_add(size=MM)
        slot = named("Slot", coat)
        slot.matrix_world = (Matrix.Translation(place + 1.0 * MM * normal) @ turned @ Matrix.Rotation(turn, 4, "Z")
                             @ Matrix.Diagonal((6.0, 0.8, 1.2, 1.0)))  # fmt: skip
        slot.hide_render = slot.hide_viewport = True
        cut = head.modifiers.new("Slot", "BOOLEAN")
        cut.object, cut.operation = slot, "DIFFERENCE"
        bpy.ops.mesh.primitive_cylinder_add(radius=1.0 * MM, depth=9.0 * MM, vertices=32)
        shaft = named("Screw", coat)
        shaft.matrix_world = Matrix.Translation(place - 4.5 * MM * normal) @ turned
        for part in (head, slot, shaft):  # below the plate in the Outliner
            placed = part.matrix_world.copy()
            part.parent, part.matrix_parent_inverse = plate, to_plate
            part.matrix_world = placed
    return below


def skull(stage: Stage):
    """A skull without its left upper quarter, the cut in plain gray, a titanium plate on the forehead."""
    ours, at = stage.volume.rle_splat, stage.middle
    bpy.context.view_layer.objects.active = stage.volume
    bpy.ops.rle_splat.apply_preset(preset="ct-bone")
    bpy.ops.rle_splat.hide_table()
    bpy.ops.rle_splat.change_segment(tool="GROW", length=2.0)  # so that thin walls are whole
    for row in ours.labels:
        row.show = row.label_name == "Body"
    titanium = material("Titanium", (0.32, 0.34, 0.38), roughness=0.42, metallic=1.0)
    bpy.ops.rle_splat.extract_surface(of="VALUE", value=SOLID)
    bone = bpy.context.view_layer.objects.active
    place, normal = _plate(stage, bone, titanium)
    bone.hide_render = bone.hide_viewport = True
    bpy.context.view_layer.objects.active = stage.volume
    remove_box(MM * DEFECT, Matrix.Translation(place) @ normal.to_track_quat("-Y", "Z").to_matrix().to_4x4())
    bpy.context.view_layer.objects.active = stage.volume
    remove_box(MM * Vector((100.0, 200.0, 100.0)), Matrix.Translation(at + MM * (CORNER + Vector((100.0, 0.0, 100.0)))))
    bpy.context.view_layer.objects.active = stage.volume
    bpy.ops.rle_splat.gray_values_on_cut()
    ours.slices_follow_window, ours.slices_clear_black = False, True
    ours.slice_center, ours.slice_width = WINDOW
    ours.shift_by, ours.opacity_unit_distance, ours.smoothness = SHIFT, THICKNESS, 1.2
    white = emission("Letters", (0.85, 0.87, 0.9))
    floor = stage.low.z - 4.0 * MM  # below the scan, whose air is not quite empty
    upright = Matrix.Rotation(math.radians(22.0), 4, "Z") @ Matrix.Rotation(math.radians(90.0), 4, "X")  # to the camera
    for body, x, y in (("R", -92.0, -74.0), ("L", 108.0, 15.0)):
        place = Vector((at.x + x * MM, at.y + y * MM, floor + 9.0 * MM))
        letters(body, Matrix.Translation(place) @ upright, 16.0 * MM, white)
    place = Vector((at.x + 93.0 * MM, at.y - 78.0 * MM, floor))
    scale_bar("50 mm", Matrix.Translation(place) @ upright, 50.0 * MM, 8.0 * MM, white)
    toward = (0.8, -1.95, 0.85)
    stage.camera(toward, lens=66.0, aim=(0.03, -0.08, -0.085))
    stage.sweep(toward, stage.foot - 5.0 * MM / stage.size, (0.06, 0.066, 0.078))
    stage.lamp("Key", "SUN", 2.0, (-0.9, -1.0, 1.5), WARM, angle=math.radians(5.0))
    stage.area("Rim", 45.0, (1.7, 1.1, 0.9), COLD, use_shadow=True)
    stage.area("Fill", 18.0, (0.9, -1.7, 1.5), WARM)  # for relief in the shade
    softbox_world(
        ((0.02, 0.02, 0.022), (0.05, 0.055, 0.065), (0.25, 0.27, 0.3)),
        (((1.6, -1.3, 0.8), 22.0, (3.0, 2.8, 2.6)), ((-1.6, -0.9, 0.6), 18.0, (1.2, 1.3, 1.5))),
        0.55,
    )
    stage.settings.ambient_occlusion, stage.settings.quality = 0.8, "strict"
    view_transform("Standard")
    yield RENDER
