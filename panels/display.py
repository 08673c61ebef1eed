"""The Display panel: what each pixel shows, the preset, and the opacity of the whole volume."""

import bpy

from ..bridge.look import transfer_nodes
from ..bridge.volumes import encoded, volumes
from ..rle_splat.scene import MODES
from .places import DataTab, OfVolume


class DisplayPanel:
    """Draws the panel in the sidebar and in the object data properties."""

    bl_label = "Display"

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        owner = volumes.volume_object(context)
        properties = owner.rle_splat
        settings = context.scene.rle_splat
        layout.prop(settings, "display")
        if settings.mode != MODES[0]:
            layout.prop(settings, "use_grays")
        is_encoded = encoded.is_of(owner)
        is_there = properties.transfer is not None and transfer_nodes.is_transfer_tree(properties.transfer)
        name = properties.transfer_name if is_there or is_encoded else ""
        layout = layout.column()
        layout.enabled = not is_encoded
        layout.menu("RLE_SPLAT_MT_presets", text=name or "Presets", icon="PRESET")
        layout.prop(properties, "shift", slider=True)
        row = layout.row()
        row.active = settings.mode == MODES[0] or not settings.use_grays
        row.prop(properties, "opacity_scale", slider=True)


class RLE_SPLAT_PT_display(DisplayPanel, OfVolume, bpy.types.Panel):
    bl_idname = "RLE_SPLAT_PT_display"
    bl_order = 1


class RLE_SPLAT_PT_data_display(DisplayPanel, DataTab, bpy.types.Panel):
    bl_idname = "RLE_SPLAT_PT_data_display"
    bl_order = 1


CLASSES = (RLE_SPLAT_PT_display, RLE_SPLAT_PT_data_display)
