"""Threshold to Segment: the voxels with values of a range as a segment."""

import bpy
from bpy.props import FloatProperty

from ..bridge.translations import with_unit
from ..bridge.volumes import segments, volumes
from ..rle_splat.scene import RleSplatError
from ..rle_splat.segment.masks import threshold_steps
from .refusal import refuse
from .segmenting import MakesSegments


class RLE_SPLAT_OT_threshold_segment(MakesSegments, bpy.types.Operator):
    """Make a segment of the voxels whose values are in a range, except those of hidden segments"""

    bl_idname = "rle_splat.threshold_segment"
    bl_label = "Threshold to Segment"

    low: FloatProperty(name="Lowest Value", description="Lowest value of the segment's voxels", default=150.0)
    high: FloatProperty(name="Highest Value", description="Highest value of the segment's voxels", default=3000.0)

    unit = ""  # in the labels of the dialog

    def invoke(self, context, _event):
        owner = volumes.volume_object(context)
        self.unit = owner.rle_splat.value_unit
        if not self.properties.is_property_set("low"):
            try:
                self.low = segments.lowest_visible(owner)
            except RleSplatError as problem:
                return refuse(self, problem)
            self.high = owner.rle_splat.value_high
        self.is_confirmed = True
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, _context):
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "low", text=with_unit("Lowest Value", self.unit), translate=False)
        layout.prop(self, "high", text=with_unit("Highest Value", self.unit), translate=False)

    def changes(self, _context, _owner, volume):
        low, high = self.low, self.high

        def make_mask(_labels, shown):
            return shown & (yield from threshold_steps(volume, low, high))

        return {"make_mask": make_mask, "name": f"{low:g} to {high:g}"}
