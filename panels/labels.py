"""The Segments panel: the label file, and the visibility, transfer function and color of each label."""

import bpy

from ..bridge import volumes
from .places import OfVolume

NAME_SHARE = 0.4  # of a row's width that the label's name takes
SWATCH = 1.2  # width of a color, in buttons


class RLE_SPLAT_PT_labels(OfVolume, bpy.types.Panel):
    bl_label = "Segments"
    bl_idname = "RLE_SPLAT_PT_labels"
    bl_order = 5
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        properties = volumes.volume_object(context).rle_splat
        row = layout.row(align=True)
        row.prop(properties, "label_file", text="")
        row.operator("rle_splat.read_labels", text="Read")
        if len(properties.labels) > 0:
            layout.prop(properties, "smooth_labels")
        for label in properties.labels:
            row = layout.row(align=True)
            row.prop(label, "show", text="")
            split = row.split(factor=NAME_SHARE, align=True)
            split.prop(label, "label_name", text="")
            style = split.row(align=True)
            style.active = label.show
            style.prop(label, "look", text="")
            style.prop(label, "use_color", text="")
            if label.use_color:
                swatch = style.row(align=True)
                swatch.ui_units_x = SWATCH
                swatch.prop(label, "color", text="")


CLASSES = (RLE_SPLAT_PT_labels,)
