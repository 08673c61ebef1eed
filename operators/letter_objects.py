"""What operators share that add lettering to renders: texts, their material, and the plane before the volume."""

import bpy
from mathutils import Matrix, Vector

from ..bridge import linked, versions
from ..bridge.live import slices
from ..bridge.scene.callouts import MARK
from ..bridge.volumes import attached

FLAT = 0.9  # z of the normal: the front of flat letters and lines has more, their edge less
EDGE = 0.045  # the width of the dark edge of a text, in its size


def add_object(context, name: str, data, material, owner, parent, matrix):
    """Add an object of the lettering of a volume as a child of ``parent``; it casts no shadow."""
    one = bpy.data.objects.new(name, data)
    one[MARK] = owner.name
    data.materials.append(material)
    linked.put_into_scene(context, one)
    for ray in slices.LAMPS:
        setattr(one, ray, False)
    attached.attach(one, parent, matrix)
    return one


def new_text(body: str, align: str = "CENTER"):
    """A text of height 1 whose middle is the origin, or its left or right end."""
    curve = bpy.data.curves.new(body, "FONT")
    curve.body, curve.align_x, curve.align_y = body, align, "CENTER"
    return _with_edge(curve, EDGE)


def new_shape(name: str, edge: float, *outlines):
    """A flat curve in the plane z = 0 that fills outlines, each (n, 2), and has an edge of a width around them."""
    curve = bpy.data.curves.new(name, "CURVE")
    curve.dimensions, curve.fill_mode = "2D", "BOTH"
    for outline in outlines:
        spline = curve.splines.new("POLY")
        spline.use_cyclic_u = True
        spline.points.add(len(outline) - 1)
        for point, place in zip(spline.points, outline):
            point.co = (*place, 0.0, 1.0)
    return _with_edge(curve, edge)


def _with_edge(curve, width: float):
    """A bevel without steps: a slope around the curve, which the material of letters darkens."""
    curve.bevel_depth, curve.bevel_resolution = width, 0
    return curve


def new_emission():
    """A material that is white, whatever the light, and black on the edges, so that letters are read on white."""
    material = bpy.data.materials.new("Letters")
    tree = versions.material_tree(material)
    tree.nodes.clear()
    kinds = "TexCoord", "SeparateXYZ", "Math", "Emission", "OutputMaterial"
    place, axes, is_front, emission, output = (tree.nodes.new(f"ShaderNode{kind}") for kind in kinds)
    is_front.operation, is_front.inputs[1].default_value = "GREATER_THAN", FLAT
    tree.links.new(place.outputs["Normal"], axes.inputs[0])
    tree.links.new(axes.outputs["Z"], is_front.inputs[0])
    tree.links.new(is_front.outputs[0], emission.inputs["Strength"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    return material


def plane_before(scene, frame, depths) -> Matrix:
    """The plane before a volume, in which the picture reaches as far as ``view_frame`` says, to the world.

    Parameters
    ----------
    frame : Matrix
        The camera without its scale.
    depths : sequence of float
        Of the corners of the volume's box.
    """
    low = scene.camera.data.view_frame(scene=scene)[2]
    distance = max(0.9 * min(depths), 1.01 * scene.camera.data.clip_start)
    plane = frame @ Matrix.Translation((0.0, 0.0, -distance))
    return plane @ Matrix.Scale(-distance / low.z if scene.camera.data.type != "ORTHO" else 1.0, 4)


def depths_of(frame, corners) -> list:
    """Distances of points, (n, 3), from a camera; negative behind it."""
    inward = frame.inverted()
    return [-(inward @ Vector(corner)).z for corner in corners.tolist()]
