"""Window and Level Tool: choose the Window and Level tool."""

import bpy

from .refusal import needs

TOOL = "rle_splat.window_tool"  # as registered by panels/window_tool.py


class RLE_SPLAT_OT_use_window_tool(bpy.types.Operator):
    """Choose the Window and Level tool: drag in the viewport to change both, and read the value under the mouse"""

    bl_idname = "rle_splat.use_window_tool"
    bl_label = "Window and Level Tool"
    bl_options = set()

    @classmethod
    def poll(cls, context):
        is_viewport = context.area is not None and context.area.type == "VIEW_3D"
        return needs(cls, is_viewport, "The tool works in a 3D viewport only") and needs(
            cls, context.mode == "OBJECT", "The tool works in Object Mode only")  # fmt: skip

    def execute(self, _context):
        return bpy.ops.wm.tool_set_by_id(name=TOOL)
