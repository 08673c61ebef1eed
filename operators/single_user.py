"""The transfer function of a volume: an own copy, and keyframes, since Blender offers none on a curve's points."""

import bpy

from ..bridge.look import transfer
from ..bridge.volumes import volumes
from .refusal import has_editable_transfer, needs


class RLE_SPLAT_OT_make_single_user(bpy.types.Operator):
    """Give this volume its own copy of the transfer function, so that edits no longer change other volumes"""

    bl_idname = "rle_splat.make_single_user"
    bl_label = "Make Single-User Copy"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return has_editable_transfer(cls, context) and needs(
            cls, transfer.is_shared(volumes.volume_object(context)), "No other object shares this transfer function"
        )

    def execute(self, context):
        transfer.own_tree(volumes.volume_object(context))
        return {"FINISHED"}


class RLE_SPLAT_OT_keyframe_transfer_function(bpy.types.Operator):
    """Insert keyframes on the colors, the opacity curve, the window and the shading at the current frame"""

    bl_idname = "rle_splat.keyframe_transfer_function"
    bl_label = "Insert Keyframes"
    bl_options = {"REGISTER", "UNDO"}

    poll = classmethod(has_editable_transfer)

    def execute(self, context):
        count = transfer.keyframe(volumes.volume_object(context), context.scene.frame_current)
        self.report({"INFO"}, f"{count} values keyframed at frame {context.scene.frame_current}. "
                              "Keep the number of points the same at all keyframes.")  # fmt: skip
        return {"FINISHED"}
