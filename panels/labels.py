"""What each voxel belongs to, and what that looks like."""

import bpy

from ..bridge import volumes
from .places import BelowTransfer

SWATCH = 1.2  # width of a color, in buttons: the names beside it need the rest


class RLE_SPLAT_PT_labels(BelowTransfer, bpy.types.Panel):
    bl_label = "Labels"
    bl_idname = "RLE_SPLAT_PT_labels"

    def draw(self, context):
        layout = self.layout
        properties = volumes.volume_object(context).rle_splat
        row = layout.row(align=True)
        row.prop(properties, "label_file", text="")
        row.operator("rle_splat.read_labels", text="Read")
        for label in properties.labels:
            row = layout.row(align=True)
            row.prop(label, "show", text="")
            row.prop(label, "label_name", text="")
            look = row.row(align=True)
            look.active = label.show
            look.prop(label, "look", text="")
            look.prop(label, "use_color", text="")
            if label.use_color:
                swatch = look.row(align=True)
                swatch.ui_units_x = SWATCH
                swatch.prop(label, "color", text="")


CLASSES = (RLE_SPLAT_PT_labels,)
