"""Show Alone: hide all segments but one, or show all again."""

import bpy
from bpy.props import IntProperty

from ..bridge.volumes import volumes
from .refusal import has_segments, refuse


class RLE_SPLAT_OT_solo_label(bpy.types.Operator):
    """Show this segment alone; if it is alone already, show all"""

    bl_idname = "rle_splat.solo_label"
    bl_label = "Show Segment Alone"
    bl_options = {"REGISTER", "UNDO"}

    label: IntProperty(name="Segment", description="Value of the segment's voxels in the label file")

    poll = classmethod(has_segments)

    def execute(self, context):
        rows = volumes.volume_object(context).rle_splat.labels
        if self.label not in [row.label for row in rows]:
            return refuse(self, f"The label file has no label {self.label}; choose one from the list.")
        is_alone = all(row.show == (row.label == self.label) for row in rows)
        for row in rows:
            row.show = is_alone or row.label == self.label
        return {"FINISHED"}
