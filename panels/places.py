"""Base classes that place a panel in Blender's interface, and text that wraps at the panel's width."""

import textwrap

from ..bridge.translations import translate
from ..bridge.volumes import volumes

# Pixels at interface scale 1.
PIXELS_A_LETTER = 6.0  # the average is 5.2; lines of mostly wide letters must fit too
MARGIN = 50  # the panel's borders and the sidebar's tabs
ICON = 20
BUTTON = 20.0  # the height of a button, which icon scales are multiples of
BORDERS = 44.0  # the panel's borders and the sidebar's tabs, beside what fills the width


class Sidebar:
    """A panel in the RLE Splat tab of the 3D view's sidebar."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "RLE Splat"


class OfVolume(Sidebar):
    """A panel in the sidebar that is shown only with a volume."""

    @classmethod
    def poll(cls, context):
        return volumes.volume_object(context) is not None


class RenderTab:
    """A panel in the render properties."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"


class DataTab:
    """A panel in the object data properties, shown while they are those of the volume that the buttons work on."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "data"

    @classmethod
    def poll(cls, context):
        owner = volumes.volume_object(context)
        return owner is not None and owner == getattr(context, "object", None)


def paragraph(context, layout, text: str, icon: str = "NONE") -> None:
    """Draw a text of any length as several labels, since Blender's labels do not wrap.

    Parameters
    ----------
    text : str
        The text, which is translated, see ``translate``; it is broken at spaces.
    icon : str
        Identifier of an icon for the first line; the other lines are indented by its width.
    """
    scale = context.preferences.system.ui_scale or 1.0  # 0 without a window
    width = context.region.width if context.region is not None else 300
    room = width / scale - MARGIN - (ICON if icon != "NONE" else 0)
    letters = max(16, int(room / PIXELS_A_LETTER))
    column = layout.column(align=True)
    column.scale_y = 0.8
    for line in textwrap.wrap(translate(text), letters):
        column.label(text=line, icon=icon)
        icon = "BLANK1" if icon != "NONE" else "NONE"
