"""Show Tab: open the extension's tab, once after it was installed."""

import bpy

from ..bridge.data import preferences
from ..bridge.loop import timer
from ..bridge.scene import viewports
from .refusal import refuse

WAIT = 0.5  # seconds until a new window has its areas


class RLE_SPLAT_OT_show_tab(bpy.types.Operator):
    """Open the sidebar of the largest 3D viewport at the tab RLE Splat"""

    bl_idname = "rle_splat.show_tab"
    bl_label = "Show RLE Splat Tab"
    bl_options = set()

    def execute(self, context):
        if not viewports.has_viewport(context.window):
            return refuse(self, "No 3D viewport is open in this window; open one.")
        viewports.open_tab(context.window)
        self.report({"INFO"}, "RLE Splat is in the sidebar of the 3D viewport: press N, then choose its tab")
        return {"FINISHED"}


def show_once() -> None:
    """Timer function: show the tab if that was never done, and note it in the preferences."""
    found = preferences.current()
    if found is None or found.has_shown_tab or not bpy.context.window_manager.windows:
        return
    window = bpy.context.window_manager.windows[0]
    if not viewports.has_viewport(window):
        return
    found.has_shown_tab = True
    bpy.context.preferences.is_dirty = True  # saved with the others when Blender is closed
    with bpy.context.temp_override(window=window):
        bpy.ops.rle_splat.show_tab()


def register():
    if not bpy.app.background:
        timer.start(show_once, WAIT)
