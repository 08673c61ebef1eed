"""Cutting objects: the planes and boxes in a scene's collection of cutting objects, as plain data.

An Empty displayed as a cube is a box.  An Empty displayed as an arrow, as axes or as an image is a plane: the side that
its +Z points to is removed.  A flat mesh is a plane too, along its thin axis.  Any other mesh is its bounding box.
A cutting object cuts every volume, or only the one whose child it is (``clip_only_parent``).
Objects in child collections count.  An Empty that is hidden from renders does not count.  A mesh counts hidden or not,
because hiding it from renders is how a user keeps Blender from rendering it; a clip mesh never occludes the volume.
"""

import bpy
import numpy as np

from ...rle_splat.scene import Clip, RleSplatError
from .. import linked, presence
from ..volumes import box
from ..volumes.attached import attach, is_attached, world_matrix

COLLECTION = "Cutting Objects"
PLANES = ("SINGLE_ARROW", "ARROWS", "PLAIN_AXES", "IMAGE")  # display types of an Empty that show its +Z
ARROW = 0.5  # length of a plane's arrow, in units of its own space, where its rectangle reaches from -1 to 1
RECTANGLE = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1), (1, 2), (2, 3), (3, 0)]  # vertices, edges
FLAT = 1e-6  # a mesh whose thickness is below this fraction of its size is a plane


def clip_objects(scene) -> list:
    """The cutting objects of a scene, sorted by name, without deleted ones."""
    collection = scene.rle_splat.clip_objects
    members = [] if collection is None else collection.all_objects
    found = (one for one in members if not (presence.is_deleted(one) or one.rle_splat.is_slice))
    return sorted(found, key=lambda one: one.name)


def cuts(one, owner) -> bool:
    """Whether a cutting object cuts a volume, because it cuts every volume or is a child of this one.

    One that cuts only its parent cuts every volume when it has no volume as its parent any more.
    """
    return not one.rle_splat.clip_only_parent or not is_attached(one, one.parent) or is_attached(one, owner)


def read_clips(depsgraph, owner, moved=None) -> tuple[Clip, ...]:
    """The cutting objects that cut a volume, as plain data at the depsgraph's time.

    Parameters
    ----------
    moved : (4, 4) ndarray of float64, optional
        The world matrix from the volume object to an instance of it.  Its children move along, other objects stay.

    Returns
    -------
    tuple of Clip
        Planes and boxes in world space.

    Raises
    ------
    RleSplatError
        For an object that is neither a plane nor a box, or has a singular matrix.
    """
    return tuple(clip for _, clip in read_cutting(depsgraph, owner, moved))


def read_cutting(depsgraph, owner, moved=None) -> list[tuple]:
    """The cutting objects that cut a volume, each with what ``read_clips`` returns for it."""
    found = []
    for one in clip_objects(depsgraph.scene) if depsgraph.scene_eval.rle_splat.use_clips else ():
        if (one.type == "EMPTY" and one.hide_render) or not cuts(one, owner):
            continue
        kind, own = shape_of(one, depsgraph)
        matrix = world_matrix(one, depsgraph) @ own
        if moved is not None and is_attached(one, owner):
            matrix = moved @ matrix
        try:
            found.append((one, Clip(kind, matrix, one.rle_splat.clip_keep.lower())))
        except RleSplatError as problem:
            raise RleSplatError(f"{one.name!r} cannot cut the volume: {problem}") from None
    return found


def shape_of(one, depsgraph) -> tuple[str, np.ndarray]:
    """(kind, (4, 4) float64 from the clip's unit space to the object's space) of a cutting object."""
    if one.type == "EMPTY" and one.empty_display_type == "CUBE":
        return "box", np.diag((*(one.empty_display_size,) * 3, 1.0))
    if one.type == "EMPTY" and one.empty_display_type in PLANES:
        return "plane", np.eye(4)
    if one.type == "MESH" and len(one.data.vertices):
        return _bounds(np.array(one.evaluated_get(depsgraph).bound_box, dtype=np.float64))
    raise RleSplatError(
        f"{one.name!r} is in the collection of cutting objects but neither a plane nor a box; use a mesh, or an Empty "
        "shown as a cube or an arrow, or take it out of the collection."
    )


def _bounds(corners: np.ndarray) -> tuple[str, np.ndarray]:
    """(kind, matrix) of the bounding box of a mesh, or of its plane if it is flat."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    half, matrix = 0.5 * (high - low), np.eye(4)
    matrix[:3, 3] = 0.5 * (low + high)
    thin = int(half.argmin())
    if half[thin] > FLAT * half.max():
        matrix[:3, :3] = np.diag(half)
        return "box", matrix
    matrix[:3, :3] = np.roll(np.eye(3), thin + 1, axis=0)  # maps +Z to the thin axis
    return "plane", matrix


def active_plane(context, owner):
    """The active object if it is an Empty that cuts a volume as a plane, else None."""
    one = context.view_layer.objects.active
    is_plane = one is not None and one.type == "EMPTY" and one.empty_display_type in PLANES and linked.is_own(one)
    return one if is_plane and one in clip_objects(context.scene) and cuts(one, owner) else None


def is_at_depth(view: np.ndarray, corners: np.ndarray, point: np.ndarray) -> bool:
    """Whether a plane through a point that faces a view passes between the corners of a box; as for ``facing``."""
    depths = (corners - point) @ view[:3, 2]
    return bool(depths.min() < 0.0 < depths.max())


def facing(view: np.ndarray, corners: np.ndarray, point: np.ndarray) -> np.ndarray:
    """The plane through a point that faces a view.

    Parameters
    ----------
    view : ndarray, shape (4, 4)
        View space to the world; the view looks along its own -Z.
    corners : ndarray, shape (8, 3)
        A box in the world; seen by the view, the plane's rectangle covers it.
    point : ndarray, shape (3,)
        In the world.

    Returns
    -------
    ndarray, shape (4, 4), float64
        The plane's unit space to the world.  Its +Z points to the view.
    """
    axes = view[:3, :3] / np.linalg.norm(view[:3, :3], axis=0)
    seen = (corners - point) @ axes[:, :2]
    low, high = seen.min(axis=0), seen.max(axis=0)
    half = 0.5 * (high - low)
    matrix = np.eye(4)
    matrix[:3, :3] = axes * (*half, half.mean())
    matrix[:3, 3] = point + axes[:, :2] @ (0.5 * (low + high))
    return matrix


def check_can_add(scene, view_layer) -> None:
    """Check that an object added to the scene's cutting objects would be in the view layer.

    Raises
    ------
    RleSplatError
        If the collection is excluded from the view layer, or not in the scene.
    """
    given = scene.rle_splat.clip_objects
    holder = given if given is not None and linked.is_own(given) else scene.collection
    if not _is_included(view_layer.layer_collection, holder):
        raise RleSplatError(
            f"The collection {holder.name!r} is excluded from the view layer {view_layer.name!r}, or not in the scene; "
            "include it in the Outliner, or choose another collection of cutting objects."
        )


def _is_included(layer_collection, collection) -> bool:
    """Whether a collection is in a view layer, at this level or below, and is not excluded."""
    if layer_collection.collection == collection and not layer_collection.exclude:
        return True
    return any(_is_included(child, collection) for child in layer_collection.children)


def ensure_collection(scene):
    """The scene's collection of cutting objects; a new one if there is none, or to hold a linked one."""
    settings = scene.rle_splat
    given = settings.clip_objects
    if given is None or not linked.is_own(given):
        settings.clip_objects = bpy.data.collections.new(COLLECTION)
        scene.collection.children.link(settings.clip_objects)
        if given is not None:
            settings.clip_objects.children.link(given)
    return settings.clip_objects


def add_clip(scene, owner, kind: str, keep: str, matrix) -> object:
    """Add an Empty to the scene's collection of cutting objects, as a child of the volume that it cuts.

    Parameters
    ----------
    kind : {"BOX", "PLANE"}
        Shape of the cut.
    keep : {"INSIDE", "OUTSIDE"}
        The side that stays.
    matrix : ndarray, shape (4, 4)
        From the clip's unit space to the world.

    Returns
    -------
    bpy.types.Object
        The Empty.  A plane is an arrow, and a rectangle from -1 to 1 in x and y that is never rendered.
    """
    empty = bpy.data.objects.new(f"Cut {kind.title()}", None)
    empty.empty_display_type = "CUBE" if kind == "BOX" else "SINGLE_ARROW"
    empty.empty_display_size = 1.0 if kind == "BOX" else ARROW
    ensure_collection(scene).objects.link(empty)
    if kind == "PLANE":
        box.give_wire(empty, f"{empty.name} Rectangle", *RECTANGLE)
    attach(empty, owner, matrix)
    empty.rle_splat.clip_keep, empty.rle_splat.clip_only_parent = keep, True
    return empty
