"""Make Own Copy: give a volume its own copy of a shared transfer function."""

import bpy

from ..bridge.look import transfer
from ..bridge.volumes import volumes
from .refusal import has_editable_transfer, needs


class RLE_SPLAT_OT_own_transfer(bpy.types.Operator):
    """Give this volume its own copy of the transfer function, so that edits no longer change other volumes"""

    bl_idname = "rle_splat.own_transfer"
    bl_label = "Make Own Copy"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return has_editable_transfer(cls, context) and needs(
            cls, transfer.is_shared(volumes.volume_object(context)), "No other object shares this transfer function"
        )

    def execute(self, context):
        transfer.own_tree(volumes.volume_object(context))
        return {"FINISHED"}
