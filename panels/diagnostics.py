"""The Diagnostics panel: effects, the last report and measured errors."""

import bpy

from .places import RenderTab, Sidebar


class DiagnosticsPanel:
    """Draws the panel in the sidebar and in the render properties."""

    bl_label = "Diagnostics"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, _context):
        """Nothing but the panels within."""


class RLE_SPLAT_PT_diagnostics(DiagnosticsPanel, Sidebar, bpy.types.Panel):
    bl_parent_id = "RLE_SPLAT_PT_advanced"


class RLE_SPLAT_PT_render_diagnostics(DiagnosticsPanel, RenderTab, bpy.types.Panel):
    bl_parent_id = "RLE_SPLAT_PT_render_advanced"
