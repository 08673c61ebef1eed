"""Anatomy: segments in the colors of atlases, by their names."""

import bpy

from ..bridge.volumes import labels, volumes
from .refusal import has_segments


class RLE_SPLAT_OT_color_anatomy(bpy.types.Operator):
    """Color segments by their names as in anatomical atlases: bones and organs opaque, skin, muscles, fat and lungs
    transparent. Other segments keep their colors or get distinct ones, and what is in no segment is hidden"""

    bl_idname = "rle_splat.color_anatomy"
    bl_label = "Anatomy"
    bl_options = {"REGISTER", "UNDO"}

    poll = classmethod(has_segments)

    def execute(self, context):
        found, count = labels.show_anatomy(volumes.volume_object(context).rle_splat.labels)
        self.report({"INFO"}, f"Names of {found} of {count} segments are known; the others have colors of their own.")
        return {"FINISHED"}
