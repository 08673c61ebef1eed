"""The Window and Level tool of the 3D viewport's toolbar; its settings show what is under the mouse."""

import bpy

from ..bridge.live import slice_places, slice_window, slices
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
        one = slice_places.hovered(context)
        owner = volumes.volume_object(context) if one is None else slices.volume_of(one)
        if owner is not None:
            properties, row = owner.rle_splat, layout.row(align=True)
            for name in slice_window.names(properties, one is not None):  # what a drag from here would change
                label = properties.bl_rna.properties[name].name
                row.prop(properties, name, text=with_unit(label, properties.value_unit), translate=False)
        line = probe.hovered(context.area) if context.area is not None else ""
        layout.label(text=line or "Move the mouse over a volume", icon="EYEDROPPER")


def register():
    bpy.utils.register_tool(RLE_SPLAT_WT_window, after={"builtin.measure"}, separator=True)


def unregister():
    bpy.utils.unregister_tool(RLE_SPLAT_WT_window)
    probe.forget()
