"""Clear Cache: delete the compiled kernels and the thumbnails."""

import bpy

from ..bridge.data import preferences
from ..bridge.look import thumbnails
from ..rle_splat.runtime.memory import bytes_text


class RLE_SPLAT_OT_clear_cache(bpy.types.Operator):
    """Delete the compiled code and the thumbnails of scans on disk. They are made again when they are needed next"""

    bl_idname = "rle_splat.clear_cache"
    bl_label = "Clear Cache"
    bl_options = set()

    def invoke(self, context, event):
        return context.window_manager.invoke_confirm(self, event)

    def execute(self, _context):
        deleted = thumbnails.delete_files() + preferences.clear_kernels()
        self.report({"INFO"}, f"Deleted {bytes_text(deleted)} of compiled code and thumbnails.")
        return {"FINISHED"}
