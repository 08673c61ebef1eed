"""Value at Surface: the value, voxel, position and label at the first visible surface along a ray."""

import math

import bpy
from bpy.props import FloatVectorProperty

from ..bridge.look import probe
from ..bridge.loop import index
from ..rle_splat.scene import RleSplatError
from .refusal import NO_VOLUME, refuse


class RLE_SPLAT_OT_probe(bpy.types.Operator):
    """Show the value, voxel, position and segment at the first visible surface along a ray; in a viewport, under the
    mouse"""

    bl_idname = "rle_splat.probe"
    bl_label = "Value at Surface"
    bl_options = set()

    origin: FloatVectorProperty(name="Origin", description="Where the ray begins, in world space")
    direction: FloatVectorProperty(
        name="Direction", description="Where the ray goes, in world space", default=(0.0, 1.0, 0.0))

    @classmethod
    def poll(cls, context):
        if index.of(context.scene).volumes:
            return True
        cls.poll_message_set(NO_VOLUME)
        return False

    def invoke(self, context, event):
        if context.region is None or context.region_data is None:
            return self.execute(context)
        probe.hover(context, (event.mouse_region_x, event.mouse_region_y))
        return {"PASS_THROUGH"}

    def execute(self, context):
        if not any(self.direction):
            return refuse(self, "The ray has no direction; give one that is not zero.")
        ray = probe.Ray(tuple(self.origin), tuple(self.direction), 0.0, math.inf)
        depsgraph = context.evaluated_depsgraph_get()
        owners = probe.visible_owners(context)
        try:
            found = probe.look_along(context, depsgraph, ray, owners)
        except RleSplatError as problem:
            return refuse(self, problem)
        self.report({"INFO"}, probe.line_of(found, len(owners) > 1) if found else "Nothing is visible along the ray")
        return {"FINISHED"}


CLASSES = (RLE_SPLAT_OT_probe,)
