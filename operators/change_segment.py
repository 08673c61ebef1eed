"""Change Segment: grow, shrink, smooth or fill the chosen segment, keep its largest part, or exchange it."""

import bpy
from bpy.props import EnumProperty, FloatProperty

from ..bridge.translations import with_unit
from ..bridge.volumes import segments, volumes
from ..rle_splat.segment.label_map import BACKGROUND
from ..rle_splat.segment.masks import fill_steps, grow_steps, keep_largest_steps, shrink_steps, smooth_steps
from .refusal import needs
from .segmenting import MakesSegments

TOOLS = [
    ("GROW", "Grow", "Add all voxels within a distance, also those of other segments", "FULLSCREEN_ENTER"),
    ("SHRINK", "Shrink", "Remove all voxels within a distance of the segment's boundary", "FULLSCREEN_EXIT"),
    ("SMOOTH", "Smooth", "Remove bumps and fill notches that are smaller than a ball of a given radius", "SMOOTHCURVE"),
    ("FILL", "Fill Holes", "Add all voxels that the segment encloses and that are in no segment", "SNAP_VOLUME"),
    ("LARGEST", "Keep Largest", "Remove all but the largest connected part", "SNAP_FACE"),
    ("INVERT", "Invert", "Swap the segment and the voxels that are in no segment", "ARROW_LEFTRIGHT"),
]
OF_LENGTH = {"GROW": grow_steps, "SHRINK": shrink_steps, "SMOOTH": smooth_steps}
OF_MASK = {"FILL": fill_steps, "LARGEST": keep_largest_steps}


class RLE_SPLAT_OT_change_segment(MakesSegments, bpy.types.Operator):
    """Grow, shrink, smooth, fill or invert the chosen segment, or keep its largest part alone"""

    bl_idname = "rle_splat.change_segment"
    bl_label = "Change Segment"

    tool: EnumProperty(
        name="Tool", description="How the chosen segment changes",
        items=[(*item, number) for number, item in enumerate(TOOLS)])  # fmt: skip
    length: FloatProperty(
        name="Distance", description="Distance, or the radius of the ball, in the scan's unit of length, mm for "
        "patients", default=2.0, min=0.001, soft_max=50.0)  # fmt: skip

    unit = ""  # in the labels of the dialog

    @classmethod
    def poll(cls, context):
        return super().poll(context) and needs(
            cls,
            segments.chosen_row(volumes.volume_object(context)) is not None,
            "Choose a segment in the list, not the background",
        )

    @classmethod
    def description(cls, _context, properties):
        return bpy.app.translations.pgettext_tip(next(item[2] for item in TOOLS if item[0] == properties.tool))

    def invoke(self, context, _event):
        if self.tool not in OF_LENGTH:
            return self.begin(context)
        self.is_confirmed, self.unit = True, volumes.volume_object(context).rle_splat.length_unit
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, _context):
        label = with_unit("Radius" if self.tool == "SMOOTH" else "Distance", self.unit)
        self.layout.use_property_split = True
        self.layout.prop(self, "length", text=label, translate=False)

    def changes(self, _context, owner, volume):
        tool, length, number = self.tool, self.length, segments.chosen_row(owner).label

        def make_mask(labels, _shown):
            mask = labels.voxels == number
            if tool in OF_LENGTH:
                return (yield from OF_LENGTH[tool](mask, volume.spacing, length))
            return labels.voxels == BACKGROUND if tool == "INVERT" else (yield from OF_MASK[tool](mask))

        return {"make_mask": make_mask, "number": number, "over_others": tool != "FILL"}
