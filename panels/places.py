"""Where panels stand, and text that fits its panel."""

import textwrap

from ..bridge import volumes

# At interface scale 1, in pixels.
PIXELS_A_LETTER = 6.0  # sentences have 5.2 on average; a line of mostly wide letters must fit, too
MARGIN = 50  # taken by the panel's borders and the tabs
ICON = 20


class Sidebar:
    """The tab of the 3D view's sidebar."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "RLE Splat"


class BelowTransfer(Sidebar):
    """In the sidebar below the transfer function, closed at first, where there is a volume."""

    bl_parent_id = "RLE_SPLAT_PT_transfer"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return volumes.volume_object(context) is not None


class RenderTab:
    """Properties > Render, where render settings are looked for."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"


def paragraph(context, layout, text: str, icon: str = "NONE") -> None:
    """A text of any length in labels as wide as the region; Blender's labels do not wrap."""
    scale = context.preferences.system.ui_scale or 1.0  # 0 without a window
    width = context.region.width if context.region is not None else 300
    room = width / scale - MARGIN - (ICON if icon != "NONE" else 0)
    letters = max(16, int(room / PIXELS_A_LETTER))
    column = layout.column(align=True)
    column.scale_y = 0.8
    for line in textwrap.wrap(text, letters):
        column.label(text=line, icon=icon)
        icon = "BLANK1" if icon != "NONE" else "NONE"
