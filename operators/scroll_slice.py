"""Scroll Slice: move the slice under the mouse, or the active one, by layers of voxels."""

import bpy
from bpy.props import IntProperty

from ..bridge import linked
from ..bridge.live import slice_places, slices
from ..bridge.loop import index
from .refusal import needs, refuse

NO_SLICE = "Add a slice first"


class RLE_SPLAT_OT_scroll_slice(bpy.types.Operator):
    """Move the slice under the mouse by layers of voxels, within its volume. Elsewhere the wheel zooms"""

    bl_idname = "rle_splat.scroll_slice"
    bl_label = "Scroll Slice"
    bl_options = {"REGISTER", "UNDO_GROUPED"}
    bl_undo_group = "rle_splat.scroll_slice"

    layers: IntProperty(name="Layers", description="Layers of voxels to move by, along the slice's normal", default=1)

    @classmethod
    def poll(cls, context):
        return needs(cls, index.of(context.scene).slices, NO_SLICE)

    def invoke(self, context, event):
        if context.region is None or context.region_data is None:
            return self.execute(context)
        one = slice_places.under(context, (event.mouse_region_x, event.mouse_region_y))
        if one is None or not linked.is_own(one) or slices.is_on_cut(one):
            return {"PASS_THROUGH"}  # to zoom
        return {"FINISHED"} if slice_places.scroll(one, self.layers) else {"CANCELLED"}

    def execute(self, context):
        one = context.view_layer.objects.active
        if one is None or not one.rle_splat.is_slice:
            return refuse(self, "The active object is no slice; select one.")
        return {"FINISHED"} if slice_places.scroll(one, self.layers) else {"CANCELLED"}
