"""Keep Connected: what is connected to a voxel as a segment, and all else hidden; also of a click in a viewport."""

import bpy
from bpy.props import FloatProperty, IntVectorProperty

from ..bridge.volumes import segments
from ..rle_splat.runtime.steps import rescale
from ..rle_splat.segment.masks import connect_steps, threshold_steps
from .picking import PicksSurface
from .refusal import has_editable_values
from .segmenting import MakesSegments


class RLE_SPLAT_OT_keep_connected(MakesSegments, bpy.types.Operator):
    """Make a segment of all that is visible and connected to a voxel, and hide the rest"""

    bl_idname = "rle_splat.keep_connected"
    bl_label = "Keep Connected"

    voxel: IntVectorProperty(name="Voxel", description="Index of a voxel along x, y and z, from 0", min=0)
    value: FloatProperty(
        name="Lowest Value", description="Lowest value of the voxels. If unset, the lowest one that the transfer "
        "function shows is used", options={"SKIP_SAVE"})  # fmt: skip

    hide = "OTHERS"

    def changes(self, context, owner, volume):
        own, voxel = self.properties.is_property_set("value"), tuple(self.voxel)
        lowest = self.value if own else segments.lowest_visible(owner, context.evaluated_depsgraph_get())

        def make_mask(_labels, shown):
            mask = yield from rescale(threshold_steps(volume, lowest, float("inf")), 0.0, 0.5)
            return (yield from rescale(connect_steps(mask & shown, voxel), 0.5, 1.0))

        return {"make_mask": make_mask, "name": "Kept"}


class RLE_SPLAT_OT_pick_connected(PicksSurface, bpy.types.Operator):
    """Click on a part of the volume in a 3D viewport: it and what is connected to it become a segment, and the rest
    is hidden. Parts connect through visible voxels, so preset and Shift decide: raise Shift to separate parts"""

    bl_idname = "rle_splat.pick_connected"
    bl_label = "Keep What Is Under the Mouse"
    bl_options = set()

    for_scripts = "This needs a click in a window; scripts use keep_connected with a voxel."
    poll = classmethod(has_editable_values)

    def pick(self, found):
        voxel = segments.brightest_near(found.plain.volume, found.surface.index)
        bpy.ops.rle_splat.keep_connected("INVOKE_DEFAULT", voxel=voxel)
