"""The surfaces of the evaluated scene as arrays of triangles: those that hide the volume, and glass, which tints it.

Everything that a render engine draws as a mesh counts: meshes with their modifiers, instances of collections, particles
and geometry nodes, text, curves, surfaces and metaballs.  Holdouts and shadow catchers count too.  Hair, point clouds
and Blender's own volumes do not.

The viewport's depsgraph includes collections that are hidden only from renders, and modifiers with their viewport
settings.  The depsgraph of a render has neither limitation.
"""

from __future__ import annotations

from typing import NamedTuple

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..look.transfer_nodes import is_transfer_tree
from .glass import share_of

# What an update can name without changing a surface: an object that a surface follows is named beside it.
WITHOUT_SURFACE = (bpy.types.Scene, bpy.types.World, bpy.types.Image, bpy.types.Camera, bpy.types.Light)
OBJECTS_WITHOUT = "CAMERA", "EMPTY", "LIGHT", "LIGHT_PROBE", "SPEAKER"


class Surfaces(NamedTuple):
    """The surfaces that the camera sees, in world space; fields of Scene.

    Attributes
    ----------
    triangles : (n, 3, 3) ndarray of float64
        Triangle, corner, and x, y, z of opaque surfaces; n may be 0.
    panes : (m, 3, 3) ndarray of float64 or None
        Of surfaces that let light through; None where there are none.
    pane_shares : (m, 4) ndarray of float64 or None
    """

    triangles: np.ndarray
    panes: np.ndarray | None
    pane_shares: np.ndarray | None


class _Read:
    """The surfaces read last of each view layer, and the number of events so far that may have changed any."""

    stamp = 0
    known: dict = {}  # (session id of a scene, name of a view layer) -> (what they were read by, Surfaces)


@persistent
def _on_update(_scene=None, depsgraph=None):
    if depsgraph is None or (depsgraph.mode != "RENDER" and any(_has_surface(one.id) for one in depsgraph.updates)):
        _Read.stamp += 1


@persistent
def _on_other(*_arguments):
    _Read.stamp += 1


HANDLERS = (
    ("depsgraph_update_post", _on_update), ("frame_change_post", _on_other), ("undo_post", _on_other),
    ("redo_post", _on_other),
)  # fmt: skip


def _has_surface(one) -> bool:
    if isinstance(one, bpy.types.Object):
        if one.rle_splat.is_volume:  # it instances its box, of edges alone
            return False
        return one.type not in OBJECTS_WITHOUT or one.instance_type != "NONE"
    if isinstance(one, bpy.types.NodeTree):
        return not (one.is_embedded_data or is_transfer_tree(one))  # that of a material is named with its material
    return not isinstance(one, WITHOUT_SURFACE)


def known_surfaces(depsgraph, without=(), instead=None) -> Surfaces:
    """``read_surfaces``, which in a viewport reads again only after an event that may have changed a surface."""
    instead = instead or {}
    if depsgraph.mode == "RENDER":
        return read_surfaces(depsgraph, without, instead)
    of = depsgraph.scene.session_uid, depsgraph.view_layer.name
    by = (
        _Read.stamp, tuple(one.session_uid for one in without),
        tuple((one.session_uid, triangles.tobytes()) for one, triangles in instead.items()),
    )
    if of not in _Read.known or _Read.known[of][0] != by:
        _Read.known[of] = by, read_surfaces(depsgraph, without, instead)
    return _Read.known[of][1]


def is_known(array) -> bool:
    """Whether an array is one of those that ``known_surfaces`` returns again, so that it is hashed once."""
    return any(array is one for _, surfaces in _Read.known.values() for one in surfaces)


def forget() -> None:
    """Drop all surfaces."""
    _Read.known.clear()


def read_surfaces(depsgraph, without=(), instead=None) -> Surfaces:
    """The triangles of all surfaces that the camera sees.

    Objects hidden from renders or from camera rays, and collections set to Indirect Only, are left out.

    Parameters
    ----------
    without : collection of bpy.types.Object
        Objects to leave out.
    instead : dict of bpy.types.Object to ndarray, optional
        Triangles of some objects in their own space, in place of those of their meshes; they are opaque.
    """
    local: dict[int, tuple] = {}
    shares: dict[int, np.ndarray | None] = {}
    pieces, shares_of_pieces = [], []
    for instance in seen_meshes(depsgraph, without):
        evaluated = instance.object
        triangles, materials = (instead or {}).get(evaluated.original), None
        if triangles is None:
            data_pointer = evaluated.data.as_pointer()
            if data_pointer not in local:
                local[data_pointer] = _object_triangles(evaluated, depsgraph)
            triangles, materials = local[data_pointer]
        if not len(triangles):
            continue
        matrix = np.array(instance.matrix_world, dtype=np.float64)
        pieces.append(triangles @ matrix[:3, :3].T + matrix[:3, 3])
        shares_of_pieces.append(np.zeros((len(triangles), 4)))
        for number, slot in enumerate(evaluated.material_slots if materials is not None else ()):
            key = slot.material.as_pointer() if slot.material is not None else 0
            if key not in shares:
                shares[key] = share_of(slot.material)
            if shares[key] is not None:
                # Blender draws an index beyond the slots by the last of them.
                shares_of_pieces[-1][np.minimum(materials, len(evaluated.material_slots) - 1) == number] = shares[key]
    if not pieces:
        return Surfaces(np.empty((0, 3, 3), dtype=np.float64), None, None)
    world, passing = np.concatenate(pieces), np.concatenate(shares_of_pieces)
    finite, glass = np.isfinite(world).all(axis=(1, 2)), passing.any(axis=1)
    if not (finite & glass).any():
        return Surfaces(world[finite & ~glass], None, None)
    return Surfaces(world[finite & ~glass], world[finite & glass], passing[finite & glass])


def seen_meshes(depsgraph, without=()):
    """Generator of the instances that ``read_surfaces`` takes, in the depsgraph's order; parameters as of it."""
    for instance in depsgraph.object_instances:
        # Curves, text, metaballs and geometry nodes that evaluate to a mesh are listed as separate MESH instances.
        if instance.object.type == "MESH" and _is_seen(instance, depsgraph.view_layer):
            if instance.object.original not in without:
                yield instance


def _is_seen(instance, view_layer) -> bool:
    """Whether camera rays meet this instance; checks the object and its instancer, as viewports list hidden ones."""
    shown = (instance.object,) if instance.parent is None else (instance.object, instance.parent)
    if not instance.show_self or any(one.hide_render or not one.visible_camera for one in shown):
        return False
    # Objects generated by geometry nodes have no original in the view layer.
    owner = (instance.parent or instance.object).original
    return owner is None or not owner.indirect_only_get(view_layer=view_layer)


def _object_triangles(evaluated, depsgraph) -> tuple[np.ndarray, np.ndarray]:
    """As ``mesh_triangles``, of an object."""
    # In the viewport a Subdivision modifier may exist on the GPU only, and a mesh in edit mode in its edit data only;
    # to_mesh evaluates both.
    copied = depsgraph.mode == "VIEWPORT" and (evaluated.mode == "EDIT" or len(evaluated.modifiers) > 0)
    mesh = evaluated.to_mesh() if copied else evaluated.data
    try:
        return mesh_triangles(mesh)
    finally:
        if copied:
            evaluated.to_mesh_clear()


def mesh_triangles(mesh) -> tuple[np.ndarray, np.ndarray]:
    """The triangles of a mesh.

    Returns
    -------
    triangles : (n, 3, 3) ndarray of float64
        Triangle, corner, and x, y, z in the mesh's own space.
    materials : (n,) ndarray of int32
        The slot of each triangle's material.
    """
    mesh.calc_loop_triangles()
    corners = np.empty(len(mesh.loop_triangles) * 3, dtype=np.int32)
    mesh.loop_triangles.foreach_get("vertices", corners)
    materials = np.empty(len(mesh.loop_triangles), dtype=np.int32)
    mesh.loop_triangles.foreach_get("material_index", materials)
    positions = np.empty(len(mesh.vertices) * 3, dtype=np.float32)
    mesh.vertices.foreach_get("co", positions)
    return positions.astype(np.float64).reshape(-1, 3)[corners.reshape(-1, 3)], materials
