"""Clip objects: the planes and boxes of a scene's collection of them, as plain data.

An Empty shown as a cube is that cube, any other mesh the box around its own vertices.  An Empty shown as an arrow, as
axes or as an image is a plane, and so is a flat mesh; what its +Z, or the normal of a flat mesh's plane along its own
axis, points at is cut away.  They count wherever they are in the collection, unless an Empty is hidden from renders.
A mesh counts hidden or not: it is no surface that the volume's rays end at, and Blender renders it unless it is hidden.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..rle_splat.scene import Clip, RleSplatError
from . import linked, presence

COLLECTION = "Clip Objects"
PLANES = ("SINGLE_ARROW", "ARROWS", "PLAIN_AXES", "IMAGE")  # kinds of Empty with a +Z to see
FLAT = 1e-6  # of a mesh's size: its thickness, below which it is a plane


def clip_objects(scene) -> list:
    """The objects of the scene's collection of clip objects, by name, but those that were deleted."""
    collection = scene.rle_splat.clip_objects
    members = [] if collection is None else collection.all_objects
    return sorted((one for one in members if not presence.is_deleted(one)), key=lambda one: one.name)


def read_clips(depsgraph) -> tuple[Clip, ...]:
    """What the scene's clip objects cut at the depsgraph's time.

    Raises RleSplatError for an object that can be neither a plane nor a box.
    """
    found = []
    for one in clip_objects(depsgraph.scene):
        if one.type == "EMPTY" and one.hide_render:
            continue
        evaluated = one.evaluated_get(depsgraph)
        kind, own = _shape(one, evaluated)
        matrix = np.array(evaluated.matrix_world, dtype=np.float64) @ own
        try:
            found.append(Clip(kind, matrix, one.rle_splat.clip_keep.lower()))
        except RleSplatError as problem:
            raise RleSplatError(f"{one.name!r} cannot cut the volume: {problem}") from None
    return tuple(found)


def _shape(one, evaluated) -> tuple[str, np.ndarray]:
    """(kind, (4, 4) from the clip's own space to the object's)."""
    if one.type == "EMPTY" and one.empty_display_type == "CUBE":
        return "box", np.diag((*(one.empty_display_size,) * 3, 1.0))
    if one.type == "EMPTY" and one.empty_display_type in PLANES:
        return "plane", np.eye(4)
    if one.type == "MESH" and len(one.data.vertices):
        return _bounds(np.array(evaluated.bound_box, dtype=np.float64))
    raise RleSplatError(
        f"{one.name!r} is in the collection of clip objects but neither a plane nor a box; use a mesh, or an Empty "
        "shown as a cube or an arrow, or take it out of the collection."
    )


def _bounds(corners: np.ndarray) -> tuple[str, np.ndarray]:
    """The box around a mesh, or the plane that it lies in where that is flat."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    half, matrix = 0.5 * (high - low), np.eye(4)
    matrix[:3, 3] = 0.5 * (low + high)
    thin = int(half.argmin())
    if half[thin] > FLAT * half.max():
        matrix[:3, :3] = np.diag(half)
        return "box", matrix
    matrix[:3, :3] = np.roll(np.eye(3), thin + 1, axis=0)  # +Z to the axis along which it is flat
    return "plane", matrix


def check_can_add(scene, view_layer) -> None:
    """Raise RleSplatError where an object added to the scene's clip objects would not be in the view layer."""
    given = scene.rle_splat.clip_objects
    holder = given if given is not None and linked.is_own(given) else scene.collection
    if not _is_included(view_layer.layer_collection, holder):
        raise RleSplatError(
            f"The collection {holder.name!r} is excluded from the view layer {view_layer.name!r}, or not in the scene; "
            "include it in the Outliner, or choose another collection of clip objects."
        )


def _is_included(layer_collection, collection) -> bool:
    """Whether a view layer shows the collection in its Outliner, here or below, and has not excluded it."""
    if layer_collection.collection == collection and not layer_collection.exclude:
        return True
    return any(_is_included(child, collection) for child in layer_collection.children)


def ensure_collection(scene):
    """The scene's collection of clip objects that takes more: made where there is none, or around a linked one."""
    settings = scene.rle_splat
    given = settings.clip_objects
    if given is None or not linked.is_own(given):
        settings.clip_objects = bpy.data.collections.new(COLLECTION)
        scene.collection.children.link(settings.clip_objects)
        if given is not None:
            settings.clip_objects.children.link(given)
    return settings.clip_objects


def add_clip(scene, kind: str, keep: str, matrix) -> object:
    """A new Empty in the scene's collection of clip objects.  ``matrix``: of a clip, to the world."""
    empty = bpy.data.objects.new(f"Clip {kind.title()}", None)
    empty.empty_display_type = "CUBE" if kind == "BOX" else "SINGLE_ARROW"
    empty.empty_display_size = 1.0
    ensure_collection(scene).objects.link(empty)
    empty.matrix_world = matrix.T.tolist()  # a sequence of columns
    empty.rle_splat.clip_keep = keep
    return empty
