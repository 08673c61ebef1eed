"""Clear Segments: take the label file and its segments off a volume."""

import bpy

from ..bridge.volumes import volumes
from .refusal import has_editable_volume, needs


class RLE_SPLAT_OT_clear_labels(bpy.types.Operator):
    """Remove the label file and its segments from the volume. The file itself stays"""

    bl_idname = "rle_splat.clear_labels"
    bl_label = "Clear Segments"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        owner = volumes.volume_object(context)
        return has_editable_volume(cls, context) and needs(
            cls, owner.rle_splat.label_file or owner.rle_splat.labels, "The volume has no segments"
        )

    def execute(self, context):
        properties = volumes.volume_object(context).rle_splat
        properties.label_file = properties.labels_of = ""
        properties.labels.clear()
        properties.active_label = 0
        return {"FINISHED"}
