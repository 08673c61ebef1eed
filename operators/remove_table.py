"""Hide Table: the body as a segment, and all else hidden."""

import bpy

from ..rle_splat.segment.body import body_steps
from .segmenting import MakesSegments


class RLE_SPLAT_OT_remove_table(MakesSegments, bpy.types.Operator):
    """Find the body in a CT scan, including the air inside it, and hide the table, the head holder and blankets"""

    bl_idname = "rle_splat.remove_table"
    bl_label = "Hide Table"

    hide = "BACKGROUND"

    def changes(self, _context, _owner, volume):
        return {"make_mask": lambda _labels, _shown: body_steps(volume), "name": "Body", "over_others": False}
