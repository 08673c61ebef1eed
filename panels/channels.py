"""Further volumes in the picture of the active one."""

import bpy

from ..bridge import volumes
from .places import Sidebar


class RLE_SPLAT_PT_channels(Sidebar, bpy.types.Panel):
    bl_label = "Channels"
    bl_idname = "RLE_SPLAT_PT_channels"
    bl_parent_id = "RLE_SPLAT_PT_transfer"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return volumes.volume_object(context) is not None

    def draw(self, context):
        layout = self.layout
        for index, channel in enumerate(volumes.volume_object(context).rle_splat.channels):
            row = layout.row(align=True)
            row.prop(channel, "show", text="")
            row.prop(channel, "source", text="")
            row.operator("rle_splat.remove_channel", text="", icon="X").index = index
        layout.operator("rle_splat.add_channels", icon="ADD")


CLASSES = (RLE_SPLAT_PT_channels,)
