"""The Channels panel: volumes that are added to the picture of the active volume."""

import bpy

from ..bridge.presence import is_deleted
from ..bridge.volumes import volumes
from .places import OfVolume, paragraph


class RLE_SPLAT_PT_channels(OfVolume, bpy.types.Panel):
    bl_label = "Channels"
    bl_idname = "RLE_SPLAT_PT_channels"
    bl_parent_id = "RLE_SPLAT_PT_advanced"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        for index, channel in enumerate(volumes.volume_object(context).rle_splat.channels):
            deleted = channel.source is not None and is_deleted(channel.source)
            row = layout.row(align=True)
            row.alert = deleted
            row.prop(channel, "show", text="")
            row.prop(channel, "source", text="")
            row.operator("rle_splat.remove_channel", text="", icon="X").index = index
            if deleted:
                sentence = f"The volume {channel.source.name} was deleted; remove this channel."
                paragraph(context, layout, sentence, icon="ERROR")
        layout.operator("rle_splat.add_channels", icon="ADD")


CLASSES = (RLE_SPLAT_PT_channels,)
