"""Add Clip Object: add an Empty that cuts the volume, a box around it or a plane through its center."""

import bpy
import numpy as np
from bpy.props import EnumProperty

from ..bridge import clip_objects, volumes
from ..bridge.settings import scene_scale_of
from ..rle_splat.scene import RleSplatError
from .reading import LoadsFirst
from .refusal import has_volume, refuse

PLANE_SIZE = 0.5  # length of the arrow, as a fraction of the volume's half sides


class RLE_SPLAT_OT_add_clip(LoadsFirst, bpy.types.Operator):
    """Add an Empty that cuts the volume: a box fitted to it, or an arrow at its center that points to the side that
    is removed"""

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
        half = 0.5 * (np.array(volume.shape_xyz, dtype=np.float64) - 1.0)
        fitted = np.diag((*half, 1.0))
        fitted[:3, 3] = half
        scale = scene_scale_of(context.scene, volume.unit)
        matrix = np.array(owner.matrix_world) @ np.diag((scale, scale, scale, 1.0)) @ volume.affine @ fitted
        if self.kind == "PLANE":
            matrix[:3, :3] *= PLANE_SIZE
        empty = clip_objects.add_clip(context.scene, self.kind, self.keep, matrix)
        for selected in context.selected_objects:
            selected.select_set(False)
        empty.select_set(True)
        context.view_layer.objects.active = empty
        if not empty.visible_get():
            self.report({"WARNING"}, f"{empty.name} cuts the volume but is not visible, because its collection is "
                                     "hidden in the viewport; show the collection in the Outliner to move it.")
        return {"FINISHED"}


CLASSES = (RLE_SPLAT_OT_add_clip,)
