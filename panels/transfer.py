"""The Transfer Function panel: histogram, opacity curve, color ramp, window and level, and the preset menus."""

import bpy

from ..bridge import linked, own_presets, previews, transfer, transfer_nodes, volumes
from ..bridge.preset_items import IMPORT_ITEMS
from ..operators.window_level import ITEMS as WINDOW_ITEMS
from .places import Sidebar

BUTTON = 20.0  # pixels at interface scale 1: the height of a button, which icon scales are multiples of
BORDERS = 44.0  # pixels at interface scale 1: the panel's borders and the sidebar's tabs


class RLE_SPLAT_MT_presets(bpy.types.Menu):
    bl_label = "Presets"
    bl_idname = "RLE_SPLAT_MT_presets"

    def draw(self, _context):
        for item in IMPORT_ITEMS:
            self.layout.operator("rle_splat.apply_preset", text=item[1]).preset = item[0]
        self.layout.separator()
        for own in own_presets.listed():
            self.layout.operator("rle_splat.apply_own_preset", text=own.name).name = own.name
        self.layout.operator("rle_splat.save_own_preset", text="Save as Preset…", icon="ADD")
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
        icons = previews.histogram_icons(owner)
        if all(icons):
            tiles = layout.row(align=True)
            tiles.alignment = "CENTER"
            for icon in icons:
                tiles.template_icon(icon_value=icon, scale=_tile_scale(context, len(icons)))
        curves = layout.column()
        curves.enabled = linked.is_own(tree)
        curves.template_curve_mapping(tree.nodes[transfer_nodes.OPACITY_NODE], "mapping")
        curves.template_color_ramp(tree.nodes[transfer_nodes.COLOR_NODE], "color_ramp", expand=True)
        unit = f" ({properties.transfer_unit})" if properties.transfer_unit else ""
        row = layout.row(align=True)
        column = row.column(align=True)
        column.prop(properties, "window_center", text=f"Level{unit}")
        column.prop(properties, "window_width", text=f"Window{unit}")
        row.menu("RLE_SPLAT_MT_windows", text="", icon="DOWNARROW_HLT")
        column = layout.column(align=True)
        column.prop(properties, "opacity_scale", slider=True)
        column.prop(properties, "opacity_unit_distance", text=f"Per Distance ({properties.length_unit})")


def _tile_scale(context, count: int) -> float:
    """The icon scale at which ``count`` square icons side by side fill the panel's width."""
    scale = context.preferences.system.ui_scale or 1.0
    width = context.region.width / scale if context.region is not None else 0.0
    return max(1.0, (width - BORDERS) / (BUTTON * count))


CLASSES = (RLE_SPLAT_MT_presets, RLE_SPLAT_MT_windows, RLE_SPLAT_PT_transfer)
