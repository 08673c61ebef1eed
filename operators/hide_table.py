"""Hide Table: the body as a segment, and all else hidden."""

import bpy

from ..rle_splat.segment.body import body_steps
from .segmenting import MakesSegments


class RLE_SPLAT_OT_hide_table(MakesSegments, bpy.types.Operator):
    """Hide the table, the head holder and blankets of a CT. Arms and hands that are separate from the trunk can be
    hidden with them. Hide Table in the panel Display, clicked again, or the eye of Background shows all of it"""

    bl_idname = "rle_splat.hide_table"
    bl_label = "Hide Table"

    hide = "BACKGROUND"

    def changes(self, _context, _owner, volume):
        return {"make_mask": lambda _labels, _shown: body_steps(volume), "name": "Body", "over_others": False}
