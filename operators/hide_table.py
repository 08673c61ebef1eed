"""Hide Table: the body as a segment, and all else hidden."""

import bpy

from ..bridge.data.volume_properties import SHOWN_AGAIN, TABLE
from ..rle_splat.segment.body import body_steps
from .segmenting import MakesSegments


class RLE_SPLAT_OT_hide_table(MakesSegments, bpy.types.Operator):
    bl_idname = "rle_splat.hide_table"
    bl_label = "Hide Table"
    bl_description = f"{TABLE}. {SHOWN_AGAIN}"

    hide = "BACKGROUND"

    def changes(self, _context, _owner, volume):
        return {"make_mask": lambda _labels, _shown: body_steps(volume), "name": "Body", "over_others": False}
