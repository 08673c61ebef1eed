"""Keep Connected: what is connected to a voxel as a segment, and all else hidden; also of a click in a viewport."""

import bpy
from bpy.props import FloatProperty, IntVectorProperty

from ..bridge.look import probe
from ..bridge.volumes import labels, loading, segments, volumes
from ..rle_splat.runtime.steps import rescale
from ..rle_splat.scene import RleSplatError
from ..rle_splat.segment.masks import connect_steps, threshold_steps
from .refusal import has_editable_values, refuse
from .segmenting import MakesSegments

AIR = "Nothing is visible under the mouse; click on a part of the volume."
KEYS = "Click: Keep What Is Under the Mouse   |   Esc, Right Click: Cancel"


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


class RLE_SPLAT_OT_pick_connected(bpy.types.Operator):
    """Click on a part of the volume in a 3D viewport: it and what is connected to it become a segment, and the rest
    is hidden"""

    bl_idname = "rle_splat.pick_connected"
    bl_label = "Keep What Is Under the Mouse"
    bl_options = set()

    poll = classmethod(has_editable_values)

    def execute(self, _context):
        return refuse(self, "This needs a click in a window; scripts use keep_connected with a voxel.")

    def invoke(self, context, _event):
        if bpy.app.background or context.window is None:
            return self.execute(context)
        context.window.cursor_modal_set("EYEDROPPER")
        context.workspace.status_text_set(KEYS)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type in ("ESC", "RIGHTMOUSE") and event.value == "PRESS":
            self.cancel(context)
            return {"CANCELLED"}
        if event.type != "LEFTMOUSE" or event.value != "PRESS":
            return {"PASS_THROUGH"}
        self.cancel(context)
        try:
            voxel = _voxel_under(context, (event.mouse_x, event.mouse_y))
        except RleSplatError as problem:
            return refuse(self, problem)
        bpy.ops.rle_splat.keep_connected("INVOKE_DEFAULT", voxel=voxel)
        return {"FINISHED"}

    def cancel(self, context):
        """End the choice; Blender calls it too, where a file is opened meanwhile."""
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        if context.window is not None:
            context.window.cursor_modal_restore()


def _voxel_under(context, mouse) -> tuple:
    """The voxel (x, y, z) of the volume that is seen at a pixel of the window; RleSplatError if none is."""
    owner = volumes.volume_object(context)
    for area in context.screen.areas:
        region = next((one for one in area.regions if one.type == "WINDOW"), None)
        if area.type == "VIEW_3D" and all(
            0 <= at - begin < size
            for at, begin, size in zip(mouse, (region.x, region.y), (region.width, region.height))
        ):
            with context.temp_override(area=area, region=region):
                ray = probe.ray_under(bpy.context, (mouse[0] - region.x, mouse[1] - region.y))
                depsgraph = bpy.context.evaluated_depsgraph_get()
                if not loading.is_at_hand(owner, depsgraph, labels.are_used(owner)):
                    raise RleSplatError(f"{probe.NOT_READ}.")
                found = probe.look_along(bpy.context, depsgraph, ray, [owner])
            if found is not None:
                return segments.brightest_near(found.plain.volume, found.surface.index)
    raise RleSplatError(AIR)
