"""Drag Window and Level: in a 3D viewport the mouse changes the range of values, as in viewers of scans."""

import bpy
from bpy.app.translations import pgettext_iface
from bpy.props import BoolProperty, FloatProperty

from ..bridge import linked
from ..bridge.held import Held
from ..bridge.live import slice_places, slice_window, slices
from ..bridge.look import transfer
from ..bridge.look.probe import value_text
from ..bridge.look.window_drag import WindowDrag
from ..bridge.translations import OURS
from ..bridge.volumes import volumes
from .refusal import refuse, why_no_editable_transfer

KEYS = "Right, Left: Window   |   Up, Down: Level   |   Shift: Finer   |   Release: Keep   |   Esc, Right Click: Cancel"


class RLE_SPLAT_OT_drag_window(bpy.types.Operator):
    """Drag sideways to change the window, up or down to change the level. Over slices, their window and level change"""

    bl_idname = "rle_splat.drag_window"
    bl_label = "Drag Window and Level"
    bl_options = {"REGISTER", "UNDO", "BLOCKING", "GRAB_CURSOR"}

    center: FloatProperty(name="Level", description="Value at the center of the range", translation_context=OURS)
    width: FloatProperty(name="Window", description="Width of the range of values", default=1.0, min=1e-6)
    of_slices: BoolProperty(
        name="Of Slices", description="Set the range that the volume's slices show from black to white", default=False
    )

    def execute(self, context):
        problem = why_no_editable_transfer(context)
        if problem:
            return refuse(self, f"{problem}.")
        self._move(volumes.volume_object(context), self.center, self.width)
        return {"FINISHED"}

    def invoke(self, context, event):
        if bpy.app.background or context.window is None or context.area is None:
            return self.execute(context)
        problem = why_no_editable_transfer(context)
        if problem:
            return refuse(self, f"{problem}.")
        one = None
        if context.region_data is not None:
            one = slice_places.under(context, (event.mouse_region_x, event.mouse_region_y))
        owner = volumes.volume_object(context) if one is None else slices.volume_of(one)
        if owner is None or (one is not None and linked.why_not_editable(owner)):
            return {"CANCELLED"}
        properties = owner.rle_splat
        self.of_slices = one is not None
        self.center, self.width = self._before = slice_window.level_and_window(properties, self.of_slices)
        self._owner, self._mouse = Held(owner), (event.mouse_x, event.mouse_y)
        self._drag = WindowDrag(
            *self._before, properties.value_low, properties.value_high, context.preferences.system.ui_scale
        )
        context.window.cursor_modal_set("SCROLL_XY")
        context.window_manager.modal_handler_add(self)
        self._tell(context, properties)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        owner = self._owner.find()
        if owner is None or (event.type in ("ESC", "RIGHTMOUSE") and event.value == "PRESS"):
            self.cancel(context)
            return {"CANCELLED"}
        if event.type in ("MOUSEMOVE", "INBETWEEN_MOUSEMOVE"):
            right, up = event.mouse_x - self._mouse[0], event.mouse_y - self._mouse[1]
            self._mouse = event.mouse_x, event.mouse_y
            if right or up:
                self.center, self.width = self._drag.move(right, up, event.shift)
                self._move(owner, self.center, self.width)
                self._tell(context, owner.rle_splat)
        elif event.type == "LEFTMOUSE" and event.value == "RELEASE":
            self._tell_no_more(context)
            moved = (self.center, self.width) != self._before
            return {"FINISHED"} if moved else {"CANCELLED"}  # a click alone is no undo step
        return {"RUNNING_MODAL"}

    def cancel(self, context):
        """Restore what was there; Blender calls it too, where a file is opened meanwhile."""
        owner = self._owner.find()
        if owner is not None:
            self._move(owner, *self._before)
        self._tell_no_more(context)

    def _move(self, owner, center: float, width: float) -> None:
        if self.of_slices:
            slice_window.move(owner.rle_splat, center, width)
        else:
            transfer.move_window(owner, center, width)

    def _tell(self, context, properties) -> None:
        span = 0.0, self._drag.rate * 1000.0
        names = zip(slice_window.names(properties, self.of_slices), (self.center, self.width))
        labels = ((pgettext_iface(properties.bl_rna.properties[name].name, OURS), value) for name, value in names)
        texts = (f"{label} {value_text(value, *span, properties.value_unit)}" for label, value in labels)
        context.area.header_text_set(", ".join(texts))
        context.workspace.status_text_set(KEYS)
        context.area.tag_redraw()

    def _tell_no_more(self, context) -> None:
        if context.area is not None:
            context.area.header_text_set(None)
            context.area.tag_redraw()
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        if context.window is not None:
            context.window.cursor_modal_restore()
