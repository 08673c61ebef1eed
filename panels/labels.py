"""The Segments panel: the segmentation file, and the visibility, color, name and opacity of each segment."""

import bpy

from ..bridge.look import preset_entries
from ..bridge.translations import with_ellipsis
from ..bridge.volumes import encoded, labels, volumes
from ..operators.change_segment import OF_LENGTH, TOOLS
from ..rle_splat.segment.label_map import BACKGROUND
from .places import OfVolume, paragraph

ALONE_SHARE = 0.45  # of the width, for Show Alone
FUNCTION_SHARE = 0.5  # of the words Transfer Function
NAME_SHARE = 0.75  # of a row's width that the segment's name takes
SWATCH = 1.2  # width of a color, in buttons
ROWS = 6
NO_SEGMENTS = "Segments need the values of the scan, which a .rle file does not hold"


class RLE_SPLAT_UL_labels(bpy.types.UIList):
    """The list of segments."""

    def draw_item(self, _context, layout, _data, item, _icon, _active_data, _active_property):
        row = layout.row(align=True)
        row.prop(item, "show", text="", icon="HIDE_OFF" if item.show else "HIDE_ON", emboss=False)
        swatch = row.row(align=True)
        swatch.ui_units_x = SWATCH
        swatch.active = item.use_color  # else a click on it gives the segment this color
        if item.use_color or item.label != BACKGROUND:
            swatch.prop(item, "shown_color", text="")
        else:
            swatch.label(text="")
        split = row.split(factor=NAME_SHARE)
        split.active = item.show
        split.prop(item, "label_name", text="", emboss=False)
        split.prop(item, "opacity", text="", emboss=False)


class RLE_SPLAT_MT_segments(bpy.types.Menu):
    bl_label = "Segment Tools"

    def draw(self, _context):
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("rle_splat.hide_table", icon="USER")
        layout.operator("rle_splat.pick_connected", icon="EYEDROPPER")
        layout.operator(
            "rle_splat.threshold_segment", text=with_ellipsis("Threshold to Segment"), icon="NODE_SOCKET_FLOAT"
        )
        layout.separator()
        for tool, name, _description, icon in TOOLS:
            text = with_ellipsis(name) if tool in OF_LENGTH else name
            layout.operator("rle_splat.change_segment", text=text, icon=icon).tool = tool
        layout.separator()
        layout.operator("rle_splat.export_segments", text=with_ellipsis("Export Segments"), icon="EXPORT")


class RLE_SPLAT_MT_label_functions(bpy.types.Menu):
    bl_label = "Transfer Function"

    @classmethod
    def poll(cls, context):
        owner = volumes.volume_object(context)
        return owner is not None and owner.rle_splat.active_label < len(owner.rle_splat.labels)

    def draw(self, context):
        properties = volumes.volume_object(context).rle_splat
        for name, *_ in labels.FUNCTION_ITEMS:
            if preset_entries.is_offered(name, properties):
                self.layout.prop_enum(properties.labels[properties.active_label], "look", name)


class RLE_SPLAT_PT_labels(OfVolume, bpy.types.Panel):
    bl_label = "Segments"
    bl_order = 6
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        layout.use_property_decorate = False
        owner = volumes.volume_object(context)
        properties = owner.rle_splat
        if encoded.is_of(owner):
            paragraph(context, layout, NO_SEGMENTS, icon="INFO")
            return
        layout.menu(RLE_SPLAT_MT_segments.__name__, icon="TOOL_SETTINGS")
        row = layout.row(align=True)
        row.prop(properties, "label_file", text="")
        row.operator("rle_splat.clear_segments", text="", icon="X")
        layout.operator("rle_splat.load_segments", icon="FILE_REFRESH")
        if not properties.labels:
            return
        layout.template_list(
            RLE_SPLAT_UL_labels.__name__, "", properties, "labels", properties, "active_label", rows=ROWS
        )
        if properties.active_label < len(properties.labels):
            chosen = properties.labels[properties.active_label]
            row = layout.split(factor=ALONE_SHARE, align=True)
            row.operator("rle_splat.show_segment_alone", text="Show Alone", icon="SOLO_ON").label = chosen.label
            row.operator("rle_splat.color_by_anatomy")
            label = next(label for name, label, _ in labels.FUNCTION_ITEMS if name == chosen.look)
            row = layout.split(factor=FUNCTION_SHARE)
            row.label(text="Transfer Function")
            row.menu(RLE_SPLAT_MT_label_functions.__name__, text=label)
            layout.prop(chosen, "use_color")
        layout.prop(properties, "smooth_labels")
