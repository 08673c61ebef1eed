"""Add Clip Object: add an Empty that cuts the volume, a box around it or a plane through its center."""

import bpy
import numpy as np
from bpy.props import EnumProperty

from ..bridge import clip_objects, volumes
from ..bridge.attached import volume_frame
from ..bridge.settings import scene_scale_of
from ..rle_splat.scene import RleSplatError
from .placing import make_active
from .reading import LoadsFirst
from .refusal import has_volume, refuse


class RLE_SPLAT_OT_add_clip(LoadsFirst, bpy.types.Operator):
    """Add an Empty that cuts the volume: a box fitted to it, or a rectangle at its center with an arrow that points to
    the side that is removed"""

    bl_idname = "rle_splat.add_clip"
    bl_label = "Add Clip Object"
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(
        name="Kind", description="Shape of the cut",
        items=[("BOX", "Box", "Keep the part of the volume inside or outside a box"),
               ("PLANE", "Plane", "Keep one side of a plane. The arrow points to the side that is removed")])
    keep: EnumProperty(
        name="Keep", description="Part of the volume that stays visible",
        items=[("INSIDE", "Inside", "Keep what is inside the box, or behind the arrow"),
               ("OUTSIDE", "Outside", "Keep what is outside the box, or in front of the arrow")])

    @classmethod
    def poll(cls, context):
        return has_volume(cls, context)

    def execute(self, context):
        owner = volumes.volume_object(context)
        try:
            clip_objects.check_can_add(context.scene, context.view_layer)
            volume = volumes.load_volume(owner)
        except RleSplatError as problem:
            return refuse(self, problem)
        middle = 0.5 * (np.array(volume.shape_xyz, dtype=np.float64) - 1.0)
        fitted = np.diag((*np.where(middle > 0.0, middle, 0.5), 1.0))  # a clip object must not be flat
        fitted[:3, 3] = middle
        matrix = volume_frame(volume, owner, scene_scale_of(context.scene, volume.unit)) @ fitted
        empty = clip_objects.add_clip(context.scene, owner, self.kind, self.keep, matrix)
        make_active(self, context, empty, "cuts the volume")
        return {"FINISHED"}


CLASSES = (RLE_SPLAT_OT_add_clip,)
