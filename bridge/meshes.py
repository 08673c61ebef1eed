"""The evaluated scene's surfaces as one array of triangles, so that meshes stand inside the volume.

Everything that a render engine would draw as a mesh counts as an opaque surface: meshes with their modifiers,
instances of collections, particles and geometry nodes, text, curves, surfaces and metaballs.  Glass and other
transparent materials are opaque here; holdouts and shadow catchers stand for surfaces that hide what is behind
them and count as well.  Hair, point clouds and Blender's own volumes do not.

In the viewport's depsgraph a collection that only renders hide still counts, and modifiers have their viewport
settings; the depsgraph of a render has neither flaw.
"""

from __future__ import annotations

import numpy as np


def read_triangles(depsgraph, without=()) -> np.ndarray:
    """(n, 3, 3) float64: triangle, corner, world x y z; n may be 0.

    Left out are objects hidden from renders or from the camera's rays, collections set to Indirect Only, and the
    objects ``without``.
    """
    view_layer = depsgraph.view_layer
    local_triangles: dict[int, np.ndarray] = {}
    pieces = []
    for instance in depsgraph.object_instances:
        evaluated = instance.object
        # Whatever else evaluates to a mesh (curves, text, metaballs, geometry nodes) is listed as a MESH of its own.
        if evaluated.type != "MESH" or not _is_seen(instance, view_layer) or evaluated.original in without:
            continue
        data_pointer = evaluated.data.as_pointer()
        triangles = local_triangles.get(data_pointer)
        if triangles is None:
            triangles = _object_triangles(evaluated, depsgraph)
            local_triangles[data_pointer] = triangles
        if len(triangles):
            matrix = np.array(instance.matrix_world, dtype=np.float64)
            pieces.append(triangles @ matrix[:3, :3].T + matrix[:3, 3])
    if not pieces:
        return np.empty((0, 3, 3), dtype=np.float64)
    world = np.concatenate(pieces)
    return world[np.isfinite(world).all(axis=(1, 2))]


def _is_seen(instance, view_layer) -> bool:
    """Whether the camera's rays meet this instance.  The depsgraph of a viewport lists what is hidden from
    renders too, so that is asked for each object and for the one that makes the instance."""
    shown = (instance.object,) if instance.parent is None else (instance.object, instance.parent)
    if not instance.show_self or any(one.hide_render or not one.visible_camera for one in shown):
        return False
    # Objects that geometry nodes make on the fly have no original in the view layer to ask.
    owner = (instance.parent or instance.object).original
    return owner is None or not owner.indirect_only_get(view_layer=view_layer)


def _object_triangles(evaluated, depsgraph) -> np.ndarray:
    """(n, 3, 3) float64 in the object's own space."""
    # In the viewport a last Subdivision modifier may live on the graphics card only, a mesh in edit mode in its
    # edit structure only; to_mesh brings both back.
    copied = depsgraph.mode == "VIEWPORT" and (evaluated.mode == "EDIT" or len(evaluated.modifiers) > 0)
    mesh = evaluated.to_mesh() if copied else evaluated.data
    try:
        return mesh_triangles(mesh)
    finally:
        if copied:
            evaluated.to_mesh_clear()


def mesh_triangles(mesh) -> np.ndarray:
    """(n, 3, 3) float64: the triangles of a bpy Mesh in its own space."""
    mesh.calc_loop_triangles()
    corners = np.empty(len(mesh.loop_triangles) * 3, dtype=np.int32)
    mesh.loop_triangles.foreach_get("vertices", corners)
    positions = np.empty(len(mesh.vertices) * 3, dtype=np.float32)
    mesh.vertices.foreach_get("co", positions)
    return positions.astype(np.float64).reshape(-1, 3)[corners.reshape(-1, 3)]
