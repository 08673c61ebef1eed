"""The Window and Level tool of the 3D viewport's toolbar; its settings show the value under the mouse."""

import bpy

from ..bridge.look import probe
from ..bridge.translations import with_unit
from ..bridge.volumes import volumes
from ..operators.use_window_tool import TOOL


class RLE_SPLAT_WT_window(bpy.types.WorkSpaceTool):
    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_idname = TOOL
    bl_label = "Window and Level"
    bl_description = (
        "Change the range of values that the volume's colors and opacity cover, and read values under the mouse.\n"
        "Drag right and left for the window, up and down for the level; Shift is finer. Over a slice, dragging changes "
        "the range of the slices, and the wheel moves the slice"
    )
    bl_icon = "ops.paint.weight_gradient"
    bl_cursor = "CROSSHAIR"
    bl_keymap = (
        ("rle_splat.drag_window", {"type": "LEFTMOUSE", "value": "PRESS"}, None),
        ("rle_splat.drag_window", {"type": "LEFTMOUSE", "value": "PRESS", "shift": True}, None),
        ("rle_splat.scroll_slice", {"type": "WHEELUPMOUSE", "value": "PRESS"}, {"properties": [("layers", 1)]}),
        ("rle_splat.scroll_slice", {"type": "WHEELDOWNMOUSE", "value": "PRESS"}, {"properties": [("layers", -1)]}),
        ("rle_splat.value_at_surface", {"type": "MOUSEMOVE", "value": "ANY", "any": True}, None),
    )

    def draw_settings(context, layout, _tool):
        owner = volumes.volume_object(context)
        if owner is not None:
            unit = owner.rle_splat.value_unit
            row = layout.row(align=True)
            row.prop(owner.rle_splat, "window_center", text=with_unit("Volume Level", unit), translate=False)
            row.prop(owner.rle_splat, "window_width", text=with_unit("Volume Window", unit), translate=False)
        line = probe.hovered(context.area) if context.area is not None else ""
        layout.label(text=line or "Move the mouse over a volume", icon="EYEDROPPER")


def register():
    bpy.utils.register_tool(RLE_SPLAT_WT_window, after={"builtin.measure"}, separator=True)


def unregister():
    bpy.utils.unregister_tool(RLE_SPLAT_WT_window)
    probe.forget()
