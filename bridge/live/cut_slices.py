"""Slices on the faces of cuts: children of a cutting object, so that they move with it.

A slice lies just before its face, on the side that is removed, and shows what the volume shows there.  It cannot be
selected in a viewport, where a click is for the cutting object.
"""

import bpy
import numpy as np
from mathutils import Matrix

from ...rle_splat.segment.cut_faces import face_matrices
from .. import linked
from ..loop import timer
from ..scene import clip_objects
from ..volumes import box
from . import slices

BEFORE = 1e-3  # from a face to its slice, as a share of half the cutting object's size: 0.1 mm of 200 mm


def slices_of(scene, cut) -> list:
    """The slices on the faces of a cutting object."""
    return [one for one in slices.slice_objects(scene) if slices.is_on_cut(one) and one.parent == cut]


def add_slices(context, owner, cut) -> list:
    """Put a slice on each face of a cutting object that is the child of a volume; their pictures are not made yet.

    That of a plane is as wide as the volume, because a plane cuts beyond its rectangle.
    """
    kind, own = clip_objects.shape_of(cut, context.evaluated_depsgraph_get())
    to_world = np.array(cut.matrix_world) @ own
    wide = np.ones(4)
    if kind == "plane":
        corners = box.checked_corners(owner)
        radius, halves = 0.5 * np.linalg.norm(corners[-1] - corners[0]), np.linalg.norm(to_world[:3, :2], axis=0)
        wide[:2] = np.maximum(radius / np.where(halves > 0.0, halves, 1.0), 1.0)  # 0: scaled to nothing
    found = []
    for face in face_matrices(kind):
        one = slices.new_slice(context, f"{cut.name} Values", slices.ON_CUT)
        one.hide_select = True
        one.parent = cut
        one.matrix_parent_inverse = Matrix((own @ face * wide).tolist())
        _put_before(one)
        found.append(one)
    return found


def settle(scene) -> None:
    """Put slices on the side of their cuts that is removed, and have those removed soon whose cut was deleted."""
    for one in filter(slices.is_on_cut, slices.slice_objects(scene)):
        if is_lost(one):
            timer.start(remove_lost)
        elif linked.is_own(one):
            _put_before(one)


def is_lost(one) -> bool:
    """Whether the cutting object of a slice, or its volume, was deleted."""
    return slices.is_on_cut(one) and slices.volume_of(one) is None


def _put_before(one) -> None:
    side = 1.0 if one.parent.rle_splat.clip_keep == "INSIDE" else -1.0
    if side * one.location.z <= 0.0:
        one.location.z = side * BEFORE


def remove(one) -> None:
    """Remove a slice with what it alone uses."""
    mesh, image, materials = one.data, one.rle_splat.slice_image, [slot.material for slot in one.material_slots]
    bpy.data.objects.remove(one)
    bpy.data.batch_remove([block for block in (mesh, *materials) if block is not None and block.users == 0])
    if image is not None and image.users == 0:
        bpy.data.images.remove(image)


def remove_lost() -> None:
    """Timer function: remove the slices that are lost."""
    for one in {one for scene in bpy.data.scenes for one in slices.slice_objects(scene)}:
        if is_lost(one) and linked.is_own(one):
            remove(one)
