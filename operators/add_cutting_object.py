"""Add Cutting Object: add an Empty that cuts the volume, a box around it or a plane through its center."""

import bpy
import numpy as np
from bpy.app.translations import pgettext_tip
from bpy.props import EnumProperty

from ..bridge.data.settings import scene_scale_of
from ..bridge.data.volume_properties import CLIP_ITEMS
from ..bridge.look import transfer
from ..bridge.scene import clip_objects
from ..bridge.volumes import box, encoded, labels, volumes
from ..bridge.volumes.attached import volume_frame
from ..rle_splat.classify.visible_box import visible_reach
from ..rle_splat.scene import RleSplatError
from .placing import make_active
from .reading import LoadsFirst
from .refusal import has_volume, refuses

KINDS = [
    ("BOX", "Box", "Add a box that keeps what is inside it; Keep Other Side in the list reverses this"),
    ("PLANE", "Plane", "Add a plane whose arrow points to what it removes; Keep Other Side in the list reverses this"),
]
FIT = EnumProperty(
    name="Fit", description="What a cutting box encloses, or a new cutting plane divides",
    items=[("VOLUME", "Whole Volume", "All voxels"),
           ("VISIBLE", "Visible Part", "The voxels that the opacity curve shows")])  # fmt: skip


def fitted(owner, volume, fit: str) -> np.ndarray:
    """The cutting object that holds a volume, or what is visible of it.

    Parameters
    ----------
    fit : {"VOLUME", "VISIBLE"}

    Returns
    -------
    (4, 4) ndarray of float64
        The clip's unit space to voxel indices.

    Raises
    ------
    RleSplatError
        If nothing is visible, or the volume has no values.
    """
    first, last = np.zeros(3), np.array(volume.shape_xyz, dtype=np.float64) - 1.0
    if fit == "VISIBLE":
        if not volume.holds_values:
            raise RleSplatError(f"{encoded.why_no_values(owner)}, or choose Whole Volume.")
        function = transfer.read_transfer(owner)
        shown_labels = labels.read_labels(owner, bpy.context.evaluated_depsgraph_get(), volume, function)
        found = visible_reach(volume, function, shown_labels)
        if found is None:
            raise RleSplatError(f"The opacity curve of {owner.name!r} shows no voxel; choose Whole Volume.")
        first, last = found
    half = 0.5 * (last - first)
    matrix = np.diag((*np.where(half > 0.0, half, 0.5), 1.0))  # a cutting object must not be flat
    matrix[:3, 3] = 0.5 * (first + last)
    return matrix


def visible_corners(owner, scene) -> np.ndarray:
    """The corners of the box around what is visible, in world space; of the whole volume where that is not known.

    Returns
    -------
    (8, 3) ndarray of float64
        Without rows where somebody has changed or removed the box of a volume that cannot be read.
    """
    try:
        volume = volumes.load_volume(owner)
        fit = fitted(owner, volume, "VISIBLE")
    except RleSplatError:
        return box.world_corners(owner)
    matrix = volume_frame(volume, owner, scene_scale_of(scene, volume.unit)) @ fit
    return (2.0 * box.CORNERS - 1.0) @ matrix[:3, :3].T + matrix[:3, 3]


class RLE_SPLAT_OT_add_cutting_object(LoadsFirst, bpy.types.Operator):
    """Add an Empty that cuts the volume: a box fitted to it, or a rectangle at its center with an arrow that points to
    the side that is removed"""

    bl_idname = "rle_splat.add_cutting_object"
    bl_label = "Add Cutting Object"
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(name="Kind", description="Shape of the cut", items=KINDS)
    keep: EnumProperty(name="Keep", description="Part of the volume that this cutting object keeps", items=CLIP_ITEMS)
    fit: FIT

    poll = classmethod(has_volume)

    @classmethod
    def description(cls, _context, properties):
        return pgettext_tip(next(item[2] for item in KINDS if item[0] == properties.kind))

    @refuses
    def execute(self, context):
        owner = volumes.volume_object(context)
        clip_objects.check_can_add(context.scene, context.view_layer)
        volume = volumes.load_volume(owner)
        unit = fitted(owner, volume, self.fit)
        matrix = volume_frame(volume, owner, scene_scale_of(context.scene, volume.unit)) @ unit
        empty = clip_objects.add_clip(context.scene, owner, self.kind, self.keep, matrix)
        make_active(self, context, empty, "cuts the volume")
        return {"FINISHED"}
