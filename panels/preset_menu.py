"""The menu of the presets that a volume is offered."""

import bpy

from ..bridge.look import preset_entries
from ..bridge.translations import with_ellipsis
from ..bridge.volumes import volumes


class RLE_SPLAT_MT_presets(bpy.types.Menu):
    bl_label = "Presets"

    def draw(self, context):
        layout, owner = self.layout, volumes.volume_object(context)
        for group in preset_entries.groups(owner.rle_splat) if owner else ():
            layout.label(text=group.label)
            for entry in group.entries:
                if not entry.is_own:
                    layout.operator("rle_splat.apply_preset", text=entry.label).preset = entry.name
                else:
                    layout.operator("rle_splat.apply_user_preset", text=entry.label).name = entry.name
            layout.separator()
        layout.operator("rle_splat.save_user_preset", text=with_ellipsis("Save as Preset"), icon="ADD")
        layout.separator()
        layout.operator("rle_splat.load_transfer_function", text=with_ellipsis("Load from File"), icon="FILE_FOLDER")
        layout.operator("rle_splat.save_transfer_function", text=with_ellipsis("Save to File"), icon="FILE_TICK")
