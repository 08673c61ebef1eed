"""Black or White Background: what a viewport in Solid shading shows behind its objects, black or white."""

import bpy

from ..bridge.look import transfer
from ..bridge.volumes import volumes
from .refusal import needs


def wants_white(owner) -> bool:
    """Whether a volume is to be seen on white: its highest values are black."""
    return owner is not None and transfer.is_dark(owner.rle_splat)


def is_plain(shading, white: bool) -> bool:
    """Whether the background of a viewport's shading is black, or ``white``."""
    return shading.background_type == "VIEWPORT" and tuple(shading.background_color) == (float(white),) * 3


class RLE_SPLAT_OT_plain_background(bpy.types.Operator):
    """Make the background of this viewport white, as for a PET, or black, as for an X-ray or a MIP. Click again for the
    background of the theme"""

    bl_idname = "rle_splat.plain_background"
    bl_label = "Black or White Background"
    bl_options = set()

    @classmethod
    def poll(cls, context):
        space = context.space_data
        is_solid = getattr(space, "type", "") == "VIEW_3D" and space.shading.type == "SOLID"
        return needs(cls, is_solid, "Switch the viewport to Solid shading; other shading shows the world as background")

    def execute(self, context):
        shading, white = context.space_data.shading, wants_white(volumes.volume_object(context))
        if is_plain(shading, white):
            shading.background_type = "THEME"
        else:
            shading.background_type, shading.background_color = "VIEWPORT", (float(white),) * 3
        return {"FINISHED"}


def draw_button(layout, shading, owner) -> None:
    """The button of a viewport, with the color that suits a volume."""
    white = wants_white(owner)
    layout.operator(
        "rle_splat.plain_background", text="White Background" if white else "Black Background",
        depress=is_plain(shading, white), icon="SHADING_SOLID")  # fmt: skip
