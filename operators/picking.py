"""What operators share that wait for a click on the volume in a 3D viewport."""

import bpy

from ..bridge.look import probe
from ..bridge.translations import filled, translate
from ..bridge.volumes import labels, loading, volumes
from ..rle_splat.scene import RleSplatError
from .refusal import refuse

AIR = "Nothing is visible under the mouse; click on a part of the volume."
HINT = "Click: {action}   |   Esc, Right Click: Cancel"


class PicksSurface:
    """Mix-in: wait for a click, and call ``pick`` with the ProbeHit under the mouse.

    A subclass defines ``for_scripts``, a sentence with the operator that scripts call instead.
    """

    def execute(self, _context):
        return refuse(self, self.for_scripts)

    def invoke(self, context, _event):
        if bpy.app.background or context.window is None:
            return self.execute(context)
        context.window.cursor_modal_set("EYEDROPPER")
        context.workspace.status_text_set(filled(HINT, action=translate(self.bl_label)))
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
            found = _look_under(context, (event.mouse_x, event.mouse_y))
        except RleSplatError as problem:
            return refuse(self, problem)
        self.pick(found)
        return {"FINISHED"}

    def cancel(self, context):
        """End the choice; Blender calls it too, where a file is opened meanwhile."""
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        if context.window is not None:
            context.window.cursor_modal_restore()


def _look_under(context, mouse) -> probe.ProbeHit:
    """What is seen of the volume at a pixel of the window; RleSplatError if nothing is."""
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
                return found
    raise RleSplatError(AIR)
