"""The menu of presets, by the kind of scan that they are made for."""

import bpy

from ..bridge.look import own_presets
from ..bridge.look.preset_items import BY_MODALITY, IMPORT_ITEMS, SUGGESTED


class RLE_SPLAT_MT_presets(bpy.types.Menu):
    bl_label = "Presets"

    def draw(self, _context):
        layout = self.layout
        labels = {item[0]: item[1] for item in IMPORT_ITEMS}
        layout.operator("rle_splat.apply_preset", text=labels[SUGGESTED]).preset = SUGGESTED
        for kind, names in BY_MODALITY.items():
            layout.separator()
            layout.label(text=kind)
            for name in names:
                layout.operator("rle_splat.apply_preset", text=labels[name]).preset = name
        layout.separator()
        for own in own_presets.listed():
            layout.operator("rle_splat.apply_own_preset", text=own.name).name = own.name
        layout.operator("rle_splat.save_own_preset", text="Save as Preset…", icon="ADD")
        layout.separator()
        layout.operator("rle_splat.load_transfer", text="Load from File…", icon="FILE_FOLDER")
        layout.operator("rle_splat.save_transfer", text="Save to File…", icon="FILE_TICK")
