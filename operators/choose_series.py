"""Choose a Series: which of several series to read, with a thumbnail and facts of each."""

import bpy
from bpy.props import CollectionProperty, IntProperty, StringProperty

from ..bridge.volumes import series
from .refusal import needs, refuse

WIDTH = 520  # pixels at interface scale 1
THUMBNAIL_SCALE = 8.0
ROWS = 5


class RLE_SPLAT_PG_series(bpy.types.PropertyGroup):
    """One row of the list; the series' facts stay out of properties, which Blender may keep."""

    name: StringProperty(name="Number")


class RLE_SPLAT_UL_series(bpy.types.UIList):
    """The list of series, each with its thumbnail."""

    def draw_item(self, _context, layout, _data, item, _icon, _active_data, _active_property):
        offer = series.offered()
        if offer is not None:
            number = int(item.name)
            layout.label(text=offer.titles[number - 1], icon_value=offer.icon(number))


class RLE_SPLAT_OT_choose_series(bpy.types.Operator):
    """Choose which of several series to read"""

    bl_idname = "rle_splat.choose_series"
    bl_label = "Choose a Series"
    bl_options = {"INTERNAL"}

    rows: CollectionProperty(type=RLE_SPLAT_PG_series, options={"SKIP_SAVE", "HIDDEN"})
    row: IntProperty(
        name="Row", description="Row of the series in the list, from 0", default=0, min=0, options={"SKIP_SAVE"}
    )

    @classmethod
    def poll(cls, _context):
        return needs(cls, series.offered() is not None, "Import a folder that holds several series first")

    def invoke(self, context, _event):
        self.rows.clear()
        for row in series.offered().rows:
            self.rows.add().name = str(row.number)
        self.row = next((row.number - 1 for row in series.offered().rows if not (row.problem or row.localizer)), 0)
        return context.window_manager.invoke_props_dialog(self, width=WIDTH, confirm_text="Read Series")

    def draw(self, _context):
        offer = series.offered()
        if offer is None:
            return
        layout = self.layout
        layout.template_list(RLE_SPLAT_UL_series.__name__, "", self, "rows", self, "row", rows=ROWS)
        chosen = offer.rows[min(self.row, len(offer.rows) - 1)]
        split = layout.split(factor=0.35)
        if offer.icon(chosen.number):
            split.template_icon(offer.icon(chosen.number), scale=THUMBNAIL_SCALE)
        else:
            split.label(text="No picture", icon="IMAGE_DATA")
        column = split.column(align=True)
        for name, text in series.facts(chosen, offer.descriptions[chosen.number - 1]):
            line = column.split(factor=0.3, align=True)
            line.label(text=name)
            line.label(text=text)

    def execute(self, _context):
        offer = series.offered()
        if self.row >= len(offer.rows):
            return refuse(self, f"There is no row {self.row}; there are {len(offer.rows)} series.")
        read = getattr(bpy.ops.rle_splat, offer.operator)
        read("INVOKE_DEFAULT", True, **offer.options, series=offer.rows[self.row].number)
        series.forget()
        return {"FINISHED"}

    def cancel(self, _context):
        series.forget()
