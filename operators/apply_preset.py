"""Apply Preset: replace the transfer function by a built-in one, or by one suggested from the values."""

import bpy
from bpy.app.translations import pgettext_iface, pgettext_tip
from bpy.props import EnumProperty

from ..bridge.look.preset_items import IMPORT_ITEMS, chosen_transfer
from ..bridge.volumes import volumes
from .applying import AppliesTransfer

OF_MIP = "mr-mip"  # preset for the mode MIP


class RLE_SPLAT_OT_apply_preset(AppliesTransfer, bpy.types.Operator):
    """Replace the volume's colors and opacities with those of this preset"""

    bl_idname = "rle_splat.apply_preset"
    bl_label = "Apply Preset"

    preset: EnumProperty(name="Preset", description="Built-in preset", items=IMPORT_ITEMS)

    @classmethod
    def description(cls, _context, properties):
        label, text = next(item[1:] for item in IMPORT_ITEMS if item[0] == properties.preset)
        return f"{pgettext_iface(label)}: {pgettext_tip(text)}"

    def chosen(self, volume):
        return chosen_transfer(self.preset, volume)

    def execute(self, context):
        done = super().execute(context)
        if self.preset == OF_MIP and done == {"FINISHED"}:  # composited it would be a white shape
            volumes.volume_object(context).rle_splat.display = "mip"
        return done
