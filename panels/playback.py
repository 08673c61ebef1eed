"""The Time panel: which time point of a series is shown."""

import bpy

from ..bridge.data.playback import FIXED, shown_frame
from ..bridge.translations import filled
from ..bridge.volumes import volumes
from .places import Sidebar


class RLE_SPLAT_PT_playback(Sidebar, bpy.types.Panel):
    bl_label = "Time"
    bl_parent_id = "RLE_SPLAT_PT_scan"

    @classmethod
    def poll(cls, context):
        owner = volumes.volume_object(context)
        return owner is not None and owner.rle_splat.frame_count > 1

    def draw(self, context):
        owner = volumes.volume_object(context)
        properties = owner.rle_splat
        layout = self.layout
        layout.use_property_split = True
        layout.prop(properties, "playback")
        column = layout.column(align=True)
        for name in ("frame",) if properties.playback == FIXED else ("frame_offset", "frame_step"):
            column.prop(properties, name)
        layout.label(text=filled("Shows {frame} of {frames}", frame=shown_frame(owner), frames=properties.frame_count))
