"""Further volumes in the picture of the active one."""

import bpy

from ..bridge import volumes
from .places import BelowTransfer


class RLE_SPLAT_PT_channels(BelowTransfer, bpy.types.Panel):
    bl_label = "Channels"
    bl_idname = "RLE_SPLAT_PT_channels"

    def draw(self, context):
        layout = self.layout
        for index, channel in enumerate(volumes.volume_object(context).rle_splat.channels):
            row = layout.row(align=True)
            row.prop(channel, "show", text="")
            row.prop(channel, "source", text="")
            row.operator("rle_splat.remove_channel", text="", icon="X").index = index
        layout.operator("rle_splat.add_channels", icon="ADD")


CLASSES = (RLE_SPLAT_PT_channels,)
