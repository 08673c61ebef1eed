"""The surface of a volume as a mesh object: OpenVDB makes quads of a field, which get the volume's colors."""

import bpy
import numpy as np

from ...rle_splat.classify.surface import Solid, color_steps, field_steps
from ...rle_splat.read.vdb import load_openvdb
from ...rle_splat.runtime.steps import Progress, rescale
from .. import linked, versions
from .attached import SURFACE

COLORS = "Color"  # name of the color attribute
LONGEST_NAME = 40  # characters of the volume's name in the surface's name
FIELD, QUADS = 0.5, 0.7  # shares of the time until the field is made, and until the quads are


def surface_steps(solid: Solid):
    """Generator of Progress: the surface of a solid; return it.

    Returns
    -------
    points : ndarray, shape (n, 3), float64
        Voxel indices x, y, z.
    quads : ndarray, shape (m, 4), int32
        Indices of points, anticlockwise seen from outside in the volume's own space.  Each edge has two of them.
    colors : ndarray, shape (n, 3), float32
        Scene-linear.

    Raises
    ------
    RleSplatError
        If nothing is inside, or there is not enough memory.
    """
    field = yield from rescale(field_steps(solid), 0.0, FIELD)
    yield Progress(FIELD, "making quads")
    grid = load_openvdb().FloatGrid(float(field[0, 0, 0]))
    grid.copyFromArray(field)
    del field
    points, quads = grid.convertToQuads(0.0)
    del grid
    # The grid's axes are z, y, x.  OpenVDB's quads face the larger values; turning the axes around mirrors the mesh and
    # they face outwards.
    points = np.clip(points[:, ::-1].astype(np.float64) - 1.0, 0.0, np.array(solid.volume.shape_xyz) - 1.0)
    quads = quads.astype(np.int32)
    if np.linalg.det(solid.volume.affine[:3, :3]) < 0.0:
        quads = np.ascontiguousarray(quads[:, ::-1])
    yield Progress(QUADS, "coloring the surface")
    normals = _normals(points, quads) * np.sign(np.linalg.det(solid.volume.affine[:3, :3]))
    colors = yield from rescale(color_steps(solid, points, normals), QUADS, 1.0)
    return points, quads, colors


def _normals(points: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """(n, 3) float64: unit normals of points, the mean of those of their quads by area; 0 where these cancel."""
    across, along = points[quads[:, 2]] - points[quads[:, 0]], points[quads[:, 3]] - points[quads[:, 1]]
    normals, of_quads = np.zeros_like(points), np.cross(across, along)
    for corner in quads.T:
        for axis in range(3):
            normals[:, axis] += np.bincount(corner, of_quads[:, axis], len(points))
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)


def add_surface(context, owner, surface: tuple, matrix: np.ndarray):
    """Add a surface as a child of its volume: a smooth mesh object whose material shows its color attribute.

    Parameters
    ----------
    matrix : ndarray, shape (4, 4)
        Voxel indices to the space of the volume object.
    """
    points, quads, colors = surface
    name = f"{owner.name[:LONGEST_NAME]} Surface"
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(points))
    mesh.vertices.foreach_set("co", (points @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32).ravel())
    mesh.loops.add(quads.size)
    mesh.loops.foreach_set("vertex_index", quads.ravel())
    mesh.polygons.add(len(quads))
    mesh.polygons.foreach_set("loop_start", np.arange(0, quads.size, 4, dtype=np.int32))
    mesh.update(calc_edges=True)
    mesh.shade_smooth()
    attribute = mesh.color_attributes.new(COLORS, "FLOAT_COLOR", "POINT")
    attribute.data.foreach_set("color", np.concatenate((colors, np.ones((len(colors), 1))), axis=1).ravel())
    mesh.materials.append(_material(name))
    one = bpy.data.objects.new(name, mesh)
    one[SURFACE] = True
    linked.put_into_scene(context, one)
    one.parent = owner
    return one


def _material(name: str):
    """A material whose base color is the color attribute."""
    material = bpy.data.materials.new(name)
    tree = versions.material_tree(material)
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    colors = tree.nodes.new("ShaderNodeVertexColor")
    colors.layer_name = COLORS
    colors.location = (shader.location[0] - 220, shader.location[1])
    tree.links.new(colors.outputs["Color"], shader.inputs["Base Color"])
    return material
