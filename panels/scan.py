"""The File panel: the volume's file, grid and values, notes on them, and corrections of what the file says."""

import bpy

from ..bridge.translations import with_ellipsis
from ..bridge.volumes import encoded, volumes
from .places import DataTab, OfVolume, paragraph

BUTTON = 3.8  # width of the button beside the path, in buttons


class ScanPanel:
    """Draws the panel in the sidebar and in the object data properties."""

    bl_label = "File"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        owner = volumes.volume_object(context)
        properties = owner.rle_splat
        row = layout.row(align=True)
        row.prop(properties, "filepath", text="")
        button = row.row(align=True)
        button.ui_units_x = BUTTON
        button.operator("rle_splat.relocate_volume", text=with_ellipsis("Relocate"))
        row = layout.row(align=True)
        row.operator("rle_splat.reload_volume", text="Reload", icon="FILE_REFRESH").use_dialog = False
        row = row.row(align=True)
        row.enabled = not encoded.is_of(owner)
        row.operator("rle_splat.reload_volume", text=with_ellipsis("Edit"), icon="GREASEPENCIL").use_dialog = True
        column = layout.column(align=True)
        for line in properties.facts.split("\n"):
            name, _, value = line.partition(": ")
            row = column.split(factor=0.32, align=True)
            row.label(text=name)
            row.label(text=value)
        layout.prop(context.scene.rle_splat, "scene_scale")
        for sentence in filter(None, properties.remarks.split("\n")):
            paragraph(context, layout, sentence, icon="INFO")


class RLE_SPLAT_PT_scan(ScanPanel, OfVolume, bpy.types.Panel):
    bl_order = 9


class RLE_SPLAT_PT_data_scan(ScanPanel, DataTab, bpy.types.Panel):
    bl_order = 4
