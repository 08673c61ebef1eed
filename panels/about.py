"""The About panel: what the pictures are not for, and the licenses."""

import bpy

from ..bridge.data import about
from .places import Sidebar, paragraph

PACKAGES = about.bundled()  # read once, for drawing opens no file


class RLE_SPLAT_PT_about(Sidebar, bpy.types.Panel):
    bl_label = "About"
    bl_idname = "RLE_SPLAT_PT_about"
    bl_parent_id = "RLE_SPLAT_PT_advanced"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 10

    def draw(self, context):
        layout = self.layout
        paragraph(context, layout, about.NOT_FOR_DIAGNOSIS, icon="ERROR")
        paragraph(context, layout, about.LICENSE, icon="INFO")
        layout.label(text="Packages in the Extension")
        column = layout.box().column(align=True)
        for name, terms in PACKAGES:
            paragraph(context, column, f"{name}: {terms}")


CLASSES = (RLE_SPLAT_PT_about,)
