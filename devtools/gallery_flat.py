"""The sets of the gallery without lamps: channels of fluorescence, and a PET as a maximum intensity projection (runs in
an environment with bpy).

Every step is an operator or a setting that a user has, too.
"""

from __future__ import annotations

import bmesh
import bpy
import gallery_data
from demo_scene import box_of, named, rod
from gallery_studio import RENDER, Stage, emission, flat_world, letters, scale_bar, view_transform
from mathutils import Matrix, Vector

MM = 0.001
UPRIGHT = Matrix.Rotation(1.5707963, 4, "X")  # texts that are read from the front
BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
# Of the cortex, for each channel: level, window, opacity unit distance in µm, name, and the color of the name.
CHANNELS = (
    (1650.0, 1500.0, 8.0, "Labeled cells", (0.0, 1.0, 0.0)),
    (490.0, 640.0, 90.0, "Background", (0.8, 0.08, 0.8)),
)
BAR_UM = 100.0


def shining(name: str, color):
    """A material that is as bright as its color, before a white world, too."""
    made = emission(name, color)
    made.node_tree.nodes["Principled BSDF"].inputs["Specular IOR Level"].default_value = 0.0
    return made


def _block(stage: Stage, coat) -> None:
    """The edges of the volume's box."""
    low, high = box_of(stage.volume)
    bpy.ops.mesh.primitive_cube_add(size=1.0)
    made = named("Block", coat)
    made.matrix_world = Matrix.Translation(stage.middle) @ Matrix.Diagonal((*(high - low), 1.0))
    bpy.ops.object.transform_apply(location=False, rotation=False, scale=True)
    made.modifiers.new("Edges", "WIREFRAME").thickness = 0.003 * stage.size


def cortex(stage: Stage):
    """Two channels of one stack of mouse cortex, each with a window of its own; their light adds up."""
    stage.settings.scene_scale = 1.0  # a micrometer is a millimeter here
    stage = Stage.of(stage.volume, stage.folder)
    bpy.context.view_layer.objects.active = stage.volume
    bpy.ops.rle_splat.import_channel(of_file=True)
    volumes = (stage.volume, *(row.source for row in stage.volume.rle_splat.channels))
    corner = stage.at(-0.5, -0.5, stage.foot)
    for n, (volume, (level, window, length, name, color)) in enumerate(zip(volumes, CHANNELS, strict=True)):
        ours = volume.rle_splat
        ours.window_center, ours.window_width, ours.opacity_unit_distance = level, window, length
        place = Matrix.Translation(corner + stage.size * Vector((0.4 + 0.34 * n, -0.06, 0.0)))
        letters(name, place, 0.045 * stage.size, shining(name, color), "LEFT")
    bar = BAR_UM / 576.0 * stage.size
    white = shining("Letters", (0.85, 0.87, 0.9))
    place = Matrix.Translation(corner + Vector((0.5 * bar, -0.1 * stage.size, 0.0)))
    scale_bar("100 µm", place, bar, 0.045 * stage.size, white)
    _block(stage, shining("Edges", (0.12, 0.12, 0.13)))
    stage.camera((0.0, -0.55, 2.0), lens=50.0, aim=(0.0, -0.045, -0.05))
    flat_world(BLACK)
    stage.settings.quality = "fine"
    view_transform("Standard")
    yield RENDER


# Of the PET, lengths in mm.
SUV = 6.0  # which is black
ASIDE, NEAR = 465.0, Vector((890.0, 0.0, 81.0))  # from the body to its duplicates: from the right side, and the neck
LARGER, NECK, HALF = 4.1, Vector((-15.0, -27.0, 364.0)), Vector((55.0, 10.0, 80.0))  # a slab of the neck
# Segments of the file with name, color, where the name stands from the middle of the neck, and where its line ends.
TUMORS = (
    (1, "Primary tumor", (1.0, 0.2, 0.0), (125.0, 366.0), (22.0, 140.0)),
    (2, "Metastasis", (0.0, 0.42, 1.0), (-125.0, 366.0), (-113.0, 184.0)),
)


def _surface(stage: Stage, label: int):
    """The surface of one segment, which renders do not show."""
    bpy.context.view_layer.objects.active = stage.volume
    for row in stage.volume.rle_splat.labels:
        row.show, row.look = row.label == label, "SOLID"
    bpy.ops.rle_splat.extract_surface(of="OPACITY", opacity=0.5)
    made = bpy.context.view_layer.objects.active
    made.hide_render = True
    return made


def _contour(surface, change: Matrix, coat):
    """The outline from the front of a surface that is placed anew: its cut through the middle (Mesh > Bisect, then
    Convert), before all volumes."""
    solid = bmesh.new()
    solid.from_mesh(surface.data)
    bmesh.ops.transform(solid, matrix=change @ surface.matrix_world, verts=solid.verts)
    parts = (*solid.verts, *solid.edges, *solid.faces)
    depths = [corner.co.y for corner in solid.verts]
    middle = Vector((0.0, 0.5 * (min(depths) + max(depths)), 0.0))
    bmesh.ops.bisect_plane(
        solid, geom=parts, plane_co=middle, plane_no=(0.0, 1.0, 0.0), clear_inner=True, clear_outer=True
    )
    outline = bpy.data.meshes.new("Contour")
    solid.to_mesh(outline)
    made = bpy.data.objects.new("Contour", outline)
    bpy.context.scene.collection.objects.link(made)
    made.location.y = -0.4
    with bpy.context.temp_override(active_object=made, selected_editable_objects=[made], selected_objects=[made]):
        bpy.ops.object.convert(target="CURVE")
    made.data.bevel_depth = 1.0 * MM
    made.data.materials.append(coat)


def _duplicate(objects, change: Matrix) -> list:
    """Linked duplicates, each with another place."""
    bpy.context.view_layer.update()
    twins = []
    for one in objects:
        twins.append(one.copy())
        bpy.context.scene.collection.objects.link(twins[-1])
        twins[-1].parent, twins[-1].matrix_world = None, change @ one.matrix_world
    return twins


def _color_bar(place: Matrix, width: float, height: float, size: float, coat) -> None:
    """Grays from 0 to SUV on a plane, with ticks and their values."""
    bpy.ops.mesh.primitive_plane_add(size=1.0)
    shine = shining("Grays", BLACK)
    named("Color Bar", shine).matrix_world = place @ Matrix.Diagonal((width, height, 1.0, 1.0))
    add, link = shine.node_tree.nodes.new, shine.node_tree.links.new
    along, gray, decoded = add("ShaderNodeSeparateXYZ"), add("ShaderNodeMath"), add("ShaderNodeMath")
    gray.operation, gray.inputs[0].default_value = "SUBTRACT", 1.0
    decoded.operation, decoded.inputs[1].default_value = "POWER", 2.2  # nearly as sRGB is decoded
    link(add("ShaderNodeTexCoord").outputs["Generated"], along.inputs[0])
    link(along.outputs["X"], gray.inputs[1])
    link(gray.outputs[0], decoded.inputs[0])
    link(decoded.outputs[0], shine.node_tree.nodes["Principled BSDF"].inputs["Emission Color"])
    low, left = -0.5 * height, -0.5 * width
    corners = [place @ Vector((x, y, 0.0)) for x, y in ((left, low), (-left, low), (-left, -low), (left, -low))]
    for begin, end in zip(corners, (*corners[1:], corners[0])):
        rod("Frame", begin, end, 0.7 * MM, coat)
    for value in range(0, int(SUV) + 1, 2):
        x = width * (value / SUV - 0.5)
        rod("Tick", place @ Vector((x, low, 0.0)), place @ Vector((x, low - 0.3 * size, 0.0)), 0.7 * MM, coat)
        text = f"≥ {value}" if value == SUV else str(value)
        letters(text, place @ Matrix.Translation((x, low - 0.9 * size, 0.0)), size, coat)
    letters("FDG, SUVbw in g/ml", place @ Matrix.Translation((0.0, -low + 0.8 * size, 0.0)), size, coat)


def pet(stage: Stage):
    """A PET from the front and from the right side, and its neck enlarged, with the tumors of its segmentation."""
    ours, at = stage.volume.rle_splat, stage.middle
    stage.read_labels(gallery_data.DATA / "pet_seg/dicom_seg_tumour_13frames.dcm")
    coats = [shining(name, color) for _, name, color, *_ in TUMORS]
    tumors = [_surface(stage, label) for label, *_ in TUMORS]
    for row in ours.labels:
        row.show = True
    ours.display, ours.use_inverted_grays = "mip", True
    ours.window_center, ours.window_width = 0.5 * SUV, SUV
    aside = Matrix.Translation(at + MM * Vector((ASIDE, 0.0, 0.0)))
    aside = aside @ Matrix.Rotation(1.5707963, 4, "Z") @ Matrix.Translation(-at)
    _duplicate((stage.volume,), aside)
    enlarged = Matrix.Translation(at + MM * NEAR) @ Matrix.Scale(LARGER, 4) @ Matrix.Translation(-at - MM * NECK)
    (neck,) = _duplicate((stage.volume,), enlarged)
    for tumor, coat in zip(tumors, coats):
        for change in (Matrix.Identity(4), aside, enlarged):
            _contour(tumor, change, coat)
    bpy.context.view_layer.objects.active = neck
    bpy.ops.rle_splat.add_cutting_object(kind="BOX", keep="INSIDE")
    box = bpy.context.view_layer.objects.active
    box.matrix_world = (
        enlarged @ Matrix.Translation(at + MM * NECK) @ Matrix.Diagonal((*(MM * HALF / box.empty_display_size), 1.0))
    )
    black = shining("Letters", BLACK)
    front = Matrix.Translation(at + MM * Vector((0.0, -800.0, 0.0))) @ UPRIGHT

    def to(x, y):
        return front @ Matrix.Translation((x * MM, y * MM, 0.0))

    width, height = LARGER * HALF.x, LARGER * HALF.z
    for body, x, y in (
        ("R", -255, 0), ("L", 256, 0), ("P", ASIDE - 150, 0), ("A", ASIDE + 150, 0),
        ("R", NEAR.x - width - 22, NEAR.z + 100), ("L", NEAR.x + width + 22, NEAR.z + 100),
    ):  # fmt: skip
        letters(body, to(x, y), 36 * MM, black)
    for body, x in (("Anterior", 0), ("Right lateral", ASIDE)):
        letters(body, to(x, 474), 28 * MM, black)
    white = shining("Names on Black", WHITE)
    for body, x, y in (("Heart", 39, 137), ("Bladder", -6, -208)):  # else they may be taken for tumors
        letters(body, to(x, y), 22 * MM, white)
    corners = [
        to(NECK.x + x * HALF.x, NECK.z + z * HALF.z).translation for x, z in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    for begin, end in zip(corners, (*corners[1:], corners[0])):
        rod("Neck", begin, end, 1.2 * MM, black)
    scale_bar("100 mm", to(-240, -435), 100 * MM, 28 * MM, black)
    scale_bar("30 mm", to(NEAR.x - width + 62, NEAR.z - height - 60), LARGER * 30 * MM, 28 * MM, black)
    letters("Coronal MIP, 20 mm", to(NEAR.x + width - 115, NEAR.z - height - 40), 28 * MM, black)
    _color_bar(to(NEAR.x, -405), 420 * MM, 30 * MM, 28 * MM, black)
    for (_, name, _, (x, y), (end_x, end_y)), coat in zip(TUMORS, coats):
        x, y, end_x, end_y = x + NEAR.x, y + NEAR.z, end_x + NEAR.x, end_y + NEAR.z
        letters(name, to(x, y), 32 * MM, coat)
        rod("Line", to(x, y - 24).translation, to(end_x, end_y).translation, 1.2 * MM, coat)
    camera = stage.camera((0.0, -2.0, 0.0))
    camera.location.x += 410 * MM
    camera.data.type, camera.data.ortho_scale = "ORTHO", 1500 * MM
    flat_world((1.0, 1.0, 1.0))
    stage.settings.quality = "fine"
    view_transform("Standard")
    yield RENDER
