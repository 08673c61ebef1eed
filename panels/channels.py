"""The Channels panel: volumes shown together with the active one, such as a PET on its CT or colors of fluorescence."""

import bpy

from ..bridge.data.playback import FIXED
from ..bridge.presence import is_deleted
from ..bridge.translations import with_ellipsis
from ..bridge.volumes import volumes
from .places import OfVolume, paragraph


class RLE_SPLAT_PT_channels(OfVolume, bpy.types.Panel):
    bl_label = "Channels"
    bl_order = 7
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        properties = volumes.volume_object(context).rle_splat
        for index, channel in enumerate(properties.channels):
            deleted = channel.source is not None and is_deleted(channel.source)
            row = layout.row(align=True)
            row.alert = deleted
            row.prop(channel, "show", text="")
            row.prop(channel, "source", text="")
            row.operator("rle_splat.remove_channel", text="", icon="REMOVE").index = index
            if deleted:
                sentence = f"The volume {channel.source.name} was deleted; remove this channel."
                paragraph(context, layout, sentence, icon="ERROR")
        text = with_ellipsis("Add Channel from File")
        layout.operator("rle_splat.import_channel", text=text, icon="FILE_FOLDER").of_file = False
        if properties.frame_count > 1 and properties.playback == FIXED:
            text = "Add Other Channels of This File"
            layout.operator("rle_splat.import_channel", text=text, icon="COLOR").of_file = True
        layout.operator("rle_splat.add_channels", icon="ADD")
