"""Apply Preset: replace the transfer function by a built-in one, or by one suggested from the values."""

import bpy
from bpy.props import EnumProperty

from ..bridge import transfer, volumes
from ..bridge.preset_items import IMPORT_ITEMS, chosen_transfer
from ..rle_splat.scene import RleSplatError
from .reading import LoadsFirst
from .refusal import has_editable_volume, refuse


class RLE_SPLAT_OT_apply_preset(LoadsFirst, bpy.types.Operator):
    """Replace the volume's colors and opacities by a built-in transfer function"""

    bl_idname = "rle_splat.apply_preset"
    bl_label = "Apply Preset"
    bl_options = {"REGISTER", "UNDO"}

    preset: EnumProperty(name="Preset", description="Built-in transfer function", items=IMPORT_ITEMS)

    @classmethod
    def description(cls, _context, properties):
        return next(f"{label}: {text}" for name, label, text in IMPORT_ITEMS if name == properties.preset)

    @classmethod
    def poll(cls, context):
        return has_editable_volume(cls, context)

    def _warn(self, sentence):
        self.report({"WARNING"}, sentence)

    def execute(self, context):
        owner = volumes.volume_object(context)
        try:
            transfer_function, reason = chosen_transfer(self.preset, volumes.load_volume(owner, self._warn))
        except RleSplatError as problem:
            return refuse(self, problem)
        remark = transfer.write_transfer(owner, transfer_function)
        if remark:
            self._warn(remark)
        if reason:
            self.report({"INFO"}, reason)
        return {"FINISHED"}


CLASSES = (RLE_SPLAT_OT_apply_preset,)
