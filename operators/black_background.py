"""Black Background: what a viewport in Solid shading shows behind its objects."""

import bpy

NOT_SOLID = "Only Solid shading has a background of its own; other shading shows the world"


def is_black(shading) -> bool:
    """Whether the background of a viewport's shading is black."""
    return shading.background_type == "VIEWPORT" and not any(shading.background_color)


class RLE_SPLAT_OT_black_background(bpy.types.Operator):
    """Make the background of this viewport black, as behind an X-ray or a MIP; again: that of the theme"""

    bl_idname = "rle_splat.black_background"
    bl_label = "Black Background"
    bl_options = set()

    @classmethod
    def poll(cls, context):
        if getattr(context.space_data, "type", "") != "VIEW_3D" or context.space_data.shading.type != "SOLID":
            cls.poll_message_set(NOT_SOLID)
            return False
        return True

    def execute(self, context):
        shading = context.space_data.shading
        if is_black(shading):
            shading.background_type = "THEME"
        else:
            shading.background_type, shading.background_color = "VIEWPORT", (0.0, 0.0, 0.0)
        return {"FINISHED"}


CLASSES = (RLE_SPLAT_OT_black_background,)
