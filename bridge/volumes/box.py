"""The wire box that shows the extent of a volume in the viewport.

The symbol of an Empty is centered on the object and has equal sides.  The box of a volume starts at the center of its
first voxel and may be long, rotated or sheared by the affine.  So the Empty instances a collection with a mesh of
twelve edges.  A click on the box selects the Empty, framing the Empty frames the box, copies and appends include it,
and without faces it is never rendered.  The object's matrix remains the volume's placement.
"""

import bpy
import numpy as np

from ...rle_splat.scene import RleSplatError
from .attached import rescale_attached

CORNERS = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=np.float64)
EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if bin(a ^ b).count("1") == 1]
HANDLE_FRACTION = 0.02  # half length of the Empty's own axes, as a fraction of the box's diagonal


def corners_of(shape_xyz, affine) -> np.ndarray:
    """The corners of the box of voxel centers.

    Parameters
    ----------
    affine : ndarray, shape (4, 4)
        Voxel indices to the volume's own space, in its length unit.

    Returns
    -------
    ndarray, shape (8, 3), float64
        Corners in the volume's own space.
    """
    indices = CORNERS * (np.asarray(shape_xyz, dtype=np.float64) - 1.0)
    return indices @ affine[:3, :3].T + affine[:3, 3]


def give_box(volume_object, shape_xyz, affine, scene_scale: float) -> None:
    """Show the box of a volume on its Empty; an earlier box is replaced.

    ``scene_scale``: world units per length unit of the volume.
    """
    old = volume_object.instance_collection
    corners = corners_of(shape_xyz, affine)
    give_wire(volume_object, f"{volume_object.name} Box", corners.tolist(), EDGES, scene_scale)
    volume_object.empty_display_type = "PLAIN_AXES"  # a cube would look like a second object
    diagonal = float(np.linalg.norm(corners.max(axis=0) - corners.min(axis=0)))
    volume_object.empty_display_size = max(diagonal * scene_scale * HANDLE_FRACTION, 1e-6)
    if old is not None and old.users == 0:
        remove_box(old)


def give_wire(empty, name: str, vertices, edges, scale: float = 1.0) -> None:
    """Have an Empty instance a mesh of edges, which is never rendered.

    Parameters
    ----------
    vertices, edges : list
        Of the mesh, in the Empty's own space divided by ``scale``.
    """
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, edges, [])
    holder = bpy.data.objects.new(name, mesh)
    holder.scale = (scale,) * 3
    holder.display_type = "WIRE"
    holder.hide_render = True
    collection = bpy.data.collections.new(name)
    collection.objects.link(holder)
    empty.instance_type = "COLLECTION"
    empty.instance_collection = collection


def world_corners(volume_object) -> np.ndarray:
    """The corners of a volume's box, as the scene shows it.

    Returns
    -------
    ndarray, shape (8, 3), float64
        In world space, in the order of CORNERS; shape (0, 3) where somebody has changed or removed the box.
    """
    collection = volume_object.instance_collection
    if collection is None or len(collection.objects) == 0 or len(collection.objects[0].data.vertices) != len(CORNERS):
        return np.empty((0, 3))
    holder = collection.objects[0]
    matrix = np.array(volume_object.matrix_world @ holder.matrix_basis)
    return np.array([vertex.co[:] for vertex in holder.data.vertices]) @ matrix[:3, :3].T + matrix[:3, 3]


def checked_corners(volume_object) -> np.ndarray:
    """As ``world_corners``; RleSplatError where somebody has changed or removed the box."""
    corners = world_corners(volume_object)
    if len(corners) == 0:
        raise RleSplatError(f"The box of {volume_object.name} was changed or removed; import the volume again.")
    return corners


def rescale_box(volume_object, scene_scale: float) -> None:
    """Resize a volume's box to a new scene scale."""
    if volume_object.instance_collection is None:
        return
    for holder in volume_object.instance_collection.objects:
        if holder.scale[0] > 0.0:
            ratio = scene_scale / holder.scale[0]
            volume_object.empty_display_size *= ratio
            rescale_attached(volume_object, ratio)
        holder.scale = (scene_scale,) * 3


def remove_box(collection) -> None:
    """Remove the collection of a box with its object and mesh."""
    for holder in tuple(collection.objects):
        mesh = holder.data
        bpy.data.objects.remove(holder)
        if mesh.users == 0:
            bpy.data.meshes.remove(mesh)
    bpy.data.collections.remove(collection)
