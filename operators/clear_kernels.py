"""Clear Cache: delete the compiled kernels."""

import bpy

from ..bridge.data import preferences
from ..rle_splat.runtime.memory import bytes_text


class RLE_SPLAT_OT_clear_kernels(bpy.types.Operator):
    """Delete the compiled code on disk. It is compiled again when it is needed next"""

    bl_idname = "rle_splat.clear_kernels"
    bl_label = "Clear Cache"
    bl_options = set()

    def invoke(self, context, event):
        return context.window_manager.invoke_confirm(self, event)

    def execute(self, _context):
        self.report({"INFO"}, f"Deleted {bytes_text(preferences.clear_kernels())} of compiled code.")
        return {"FINISHED"}
