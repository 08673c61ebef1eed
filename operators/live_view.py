"""Try Again: draw the volume in a viewport anew after a failure."""

import bpy

from ..bridge import live
from .refusal import needs


class RLE_SPLAT_OT_try_again(bpy.types.Operator):
    bl_idname = "rle_splat.try_again"
    bl_label = "Try Again"
    bl_description = "Draw the volume in this viewport again, after it was switched off because of a problem"
    bl_options = set()

    @classmethod
    def poll(cls, context):
        is_viewport = context.area is not None and context.area.type == "VIEW_3D"
        return needs(cls, is_viewport, "Only a 3D viewport shows volumes live")

    def execute(self, context):
        live.try_again(context.area)
        return {"FINISHED"}
