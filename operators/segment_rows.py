"""The list of segments: take it off the volume, show one alone, or color all by their names."""

import bpy
from bpy.props import IntProperty

from ..bridge.translations import filled
from ..bridge.volumes import labels, volumes
from .refusal import has_editable_volume, has_segments, needs, refuse


class RLE_SPLAT_OT_clear_segments(bpy.types.Operator):
    """Remove the segmentation file and its segments from the volume. The file itself stays"""

    bl_idname = "rle_splat.clear_segments"
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


class RLE_SPLAT_OT_show_segment_alone(bpy.types.Operator):
    """Show only the chosen segment. Click again to show all"""

    bl_idname = "rle_splat.show_segment_alone"
    bl_label = "Show Segment Alone"
    bl_options = {"REGISTER", "UNDO"}

    label: IntProperty(name="Segment", description="Value of the segment's voxels in the segmentation file")

    poll = classmethod(has_segments)

    def execute(self, context):
        rows = volumes.volume_object(context).rle_splat.labels
        if self.label not in [row.label for row in rows]:
            said = filled("The segmentation file has no segment {number}; choose one from the list.", number=self.label)
            return refuse(self, said)
        is_alone = all(row.show == (row.label == self.label) for row in rows)
        for row in rows:
            row.show = is_alone or row.label == self.label
        return {"FINISHED"}


class RLE_SPLAT_OT_color_by_anatomy(bpy.types.Operator):
    """Color segments by their names as in anatomical atlases: bones and organs opaque, skin, muscles, fat and lungs
    transparent. Other segments keep their colors or get distinct ones, and what is in no segment is hidden"""

    bl_idname = "rle_splat.color_by_anatomy"
    bl_label = "Color by Anatomy"
    bl_options = {"REGISTER", "UNDO"}

    poll = classmethod(has_segments)

    def execute(self, context):
        found, count = labels.show_anatomy(volumes.volume_object(context).rle_splat.labels)
        self.report({"INFO"}, f"Names of {found} of {count} segments are known; the others have colors of their own.")
        return {"FINISHED"}
