"""The Transfer Function panel: histogram, opacity curve, color ramp, window and level, and the preset menus."""

import bpy

from ..bridge import linked, transfer, transfer_nodes, volumes
from ..bridge.preset_items import IMPORT_ITEMS
from ..operators.window_level import ITEMS as WINDOW_ITEMS
from .histogram import draw_histogram, draw_selected
from .places import Sidebar


class RLE_SPLAT_MT_presets(bpy.types.Menu):
    bl_label = "Presets"
    bl_idname = "RLE_SPLAT_MT_presets"

    def draw(self, _context):
        for item in IMPORT_ITEMS:
            self.layout.operator("rle_splat.apply_preset", text=item[1]).preset = item[0]
        self.layout.separator()
        self.layout.operator("rle_splat.load_transfer", text="Load from File…", icon="FILE_FOLDER")
        self.layout.operator("rle_splat.save_transfer", text="Save to File…", icon="FILE_TICK")


class RLE_SPLAT_MT_windows(bpy.types.Menu):
    bl_label = "Windows"
    bl_idname = "RLE_SPLAT_MT_windows"

    def draw(self, _context):
        for name, label, _description in WINDOW_ITEMS:
            if name != "CUSTOM":
                self.layout.operator("rle_splat.window_level", text=label).preset = name
        self.layout.separator()
        wider = self.layout.operator("rle_splat.window_level", text="Show All Values, Keep Colors")
        wider.preset, wider.keep_values = "DATA", True


class RLE_SPLAT_PT_transfer(Sidebar, bpy.types.Panel):
    bl_label = "Transfer Function"
    bl_idname = "RLE_SPLAT_PT_transfer"
    bl_order = 1

    @classmethod
    def poll(cls, context):
        return volumes.volume_object(context) is not None

    def draw(self, context):
        layout = self.layout
        owner = volumes.volume_object(context)
        properties = owner.rle_splat
        tree = properties.transfer
        is_there = tree is not None and transfer_nodes.is_transfer_tree(tree)
        row = layout.row(align=True)
        name = properties.transfer_name if is_there else ""
        row.menu("RLE_SPLAT_MT_presets", text=name or "Presets", icon="PRESET")
        row.operator("rle_splat.keyframe_transfer", text="", icon="KEY_HLT")
        if not is_there:
            layout.label(text="No transfer function. Apply a preset", icon="ERROR")
            return
        if transfer.is_shared(owner):
            row.operator("rle_splat.own_transfer", text=str(tree.users), icon="DUPLICATE")
        draw_histogram(context, layout, owner)
        curves = layout.column()
        curves.enabled = linked.is_own(tree)
        curves.template_curve_mapping(tree.nodes[transfer_nodes.OPACITY_NODE], "mapping")
        draw_selected(curves, owner)
        curves.template_color_ramp(tree.nodes[transfer_nodes.COLOR_NODE], "color_ramp", expand=True)
        unit = f" ({properties.transfer_unit})" if properties.transfer_unit else ""
        row = layout.row(align=True)
        column = row.column(align=True)
        column.prop(properties, "window_center", text=f"Level{unit}")
        column.prop(properties, "window_width", text=f"Window{unit}")
        row.menu("RLE_SPLAT_MT_windows", text="", icon="DOWNARROW_HLT")
        row.operator("rle_splat.use_window_tool", text="", icon="ARROW_LEFTRIGHT")
        column = layout.column(align=True)
        column.prop(properties, "opacity_scale", slider=True)
        column.prop(properties, "opacity_unit_distance", text=f"Per Distance ({properties.length_unit})")


CLASSES = (RLE_SPLAT_MT_presets, RLE_SPLAT_MT_windows, RLE_SPLAT_PT_transfer)
