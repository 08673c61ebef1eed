"""Choose Object: make a volume or a clip object the active one."""

import bpy
from bpy.props import StringProperty

from .placing import select_alone
from .refusal import needs, refuse


class RLE_SPLAT_OT_choose_object(bpy.types.Operator):
    """Select this object alone and make it the active one"""

    bl_idname = "rle_splat.choose_object"
    bl_label = "Choose Object"
    bl_options = {"REGISTER", "UNDO"}

    name: StringProperty(name="Name", description="Name of an object of the scene")

    @classmethod
    def poll(cls, context):
        return needs(cls, context.mode == "OBJECT", "Switch to Object Mode first")

    def execute(self, context):
        chosen = context.view_layer.objects.get(self.name)
        if chosen is None:
            return refuse(self, f"{self.name!r} is not in this view layer; include its collection in the Outliner.")
        select_alone(context, chosen)
        return {"FINISHED"}
