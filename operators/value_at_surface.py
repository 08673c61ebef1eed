"""Value at Surface: the value, voxel, position and label at the first visible surface along a ray."""

import math

import bpy
from bpy.props import FloatVectorProperty

from ..bridge.live import slice_places
from ..bridge.look import probe
from ..bridge.loop import index
from .refusal import NO_VOLUME, needs, refuse, refuses

REST = 20.0  # seconds without a move until the mouse is no longer followed


class RLE_SPLAT_OT_value_at_surface(bpy.types.Operator):
    """Show the value, voxel, position and segment at the first visible surface along a ray; in a viewport, on the
    slice or the surface under the mouse, as with the Window and Level tool"""

    bl_idname = "rle_splat.value_at_surface"
    bl_label = "Value at Surface"
    bl_options = set()

    _moved = False  # whether the mouse has moved since the last tick

    origin: FloatVectorProperty(name="Origin", description="Where the ray begins, in world space")
    direction: FloatVectorProperty(
        name="Direction", description="Where the ray goes, in world space", default=(0.0, 1.0, 0.0)
    )

    @classmethod
    def poll(cls, context):
        return needs(cls, index.of(context.scene).volumes, NO_VOLUME)

    def invoke(self, context, event):
        if context.region is None or context.region_data is None:
            return self.execute(context)
        mouse = event.mouse_region_x, event.mouse_region_y
        one = slice_places.under(context, mouse)
        probe.hover(context, slice_places.line_on(one, context, mouse) or probe.line_under(context, mouse), one)
        if probe.is_watched(context.area):
            return {"PASS_THROUGH"}
        probe.watch(context.area)
        self._timer = context.window_manager.event_timer_add(REST, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL", "PASS_THROUGH"}

    def modal(self, context, event):
        """Pass all events on; forget the value once the mouse has left the region, and end while it rests."""
        if context.region is None:  # the viewport was closed
            return self._end(context)
        if event.type in ("MOUSEMOVE", "INBETWEEN_MOUSEMOVE"):
            self._moved = True
            x, y = event.mouse_x - context.region.x, event.mouse_y - context.region.y
            if not (0 <= x < context.region.width and 0 <= y < context.region.height):
                probe.forget()
                probe.redraw(context.area)
                return self._end(context)
        elif event.type == "TIMER":
            if not self._moved:  # Blender saves nothing by itself while an operator goes on
                return self._end(context)
            self._moved = False
        return {"PASS_THROUGH"}

    def cancel(self, context):
        self._end(context)

    def _end(self, context) -> set:
        if context.area is None or probe.is_watched(context.area):
            probe.watch(None)
        context.window_manager.event_timer_remove(self._timer)
        return {"CANCELLED", "PASS_THROUGH"}

    @refuses
    def execute(self, context):
        if not any(self.direction):
            return refuse(self, "The ray has no direction; give one that is not zero.")
        ray = probe.Ray(tuple(self.origin), tuple(self.direction), 0.0, math.inf)
        depsgraph = context.evaluated_depsgraph_get()
        owners = probe.visible_owners(context)
        found = probe.look_along(context, depsgraph, ray, owners)
        self.report({"INFO"}, probe.line_of(found, len(owners) > 1) if found else "Nothing is visible along the ray")
        return {"FINISHED"}
