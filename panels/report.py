"""The Last Report panel: notes, error and stage times of the last picture."""

import bpy

from .effects import NAME_SHARE
from .places import RenderTab, Sidebar, paragraph


class ReportPanel:
    """Draws the panel in the sidebar and in the render properties."""

    bl_label = "Last Report"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        text = context.scene.rle_splat.last_report
        if not text:
            self.layout.label(text="No picture has been made yet")
        times = self.layout.column(align=True)
        for line in filter(None, text.split("\n")):
            name, _, time = line.rpartition(": ")
            if name and time.endswith(" ms"):
                row = times.split(factor=NAME_SHARE)
                row.label(text=name, translate=False)
                row.label(text=time, translate=False)
            else:
                paragraph(context, self.layout, line)


class RLE_SPLAT_PT_report(ReportPanel, Sidebar, bpy.types.Panel):
    bl_parent_id = "RLE_SPLAT_PT_diagnostics"


class RLE_SPLAT_PT_render_report(ReportPanel, RenderTab, bpy.types.Panel):
    bl_parent_id = "RLE_SPLAT_PT_render_diagnostics"
