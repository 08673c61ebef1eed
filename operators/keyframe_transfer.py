"""Keyframe Transfer Function: Blender itself offers no keyframes on the points of a curve."""

import bpy

from ..bridge.look import transfer
from ..bridge.volumes import volumes
from .refusal import has_editable_transfer


class RLE_SPLAT_OT_keyframe_transfer(bpy.types.Operator):
    """Insert keyframes on the colors, the opacity curve, the window and the shading at the current frame"""

    bl_idname = "rle_splat.keyframe_transfer"
    bl_label = "Keyframe Transfer Function"
    bl_options = {"REGISTER", "UNDO"}

    poll = classmethod(has_editable_transfer)

    def execute(self, context):
        count = transfer.keyframe(volumes.volume_object(context), context.scene.frame_current)
        self.report({"INFO"}, f"{count} values keyframed at frame {context.scene.frame_current}. "
                              "Keep the number of points the same at all keyframes.")  # fmt: skip
        return {"FINISHED"}
