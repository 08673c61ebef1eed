"""The Display panel: what each pixel shows, the preset, and the opacity of the whole volume."""

import bpy

from ..bridge.look import transfer_nodes
from ..bridge.look.preset_entries import modality_of
from ..bridge.scene import clip_objects
from ..bridge.translations import with_unit
from ..bridge.volumes import encoded, labels, volumes
from ..operators import plain_background
from ..rle_splat.classify.presets import PRESETS
from ..rle_splat.scene import MODES
from ..rle_splat.segment.body import NAMES
from ..rle_splat.volume.volume import PATIENT
from .places import DataTab, OfVolume, paragraph

MINIP = "Air is the smallest value on most lines of sight: cut the volume to a slab with Cut > Add Box"
LABELS = {preset.label.casefold(): preset.label for preset in PRESETS.values()}  # as the menu has them
WIDE = 50.0  # range of values above which a drag shifts by whole units


class DisplayPanel:
    """Draws the panel in the sidebar and in the object data properties."""

    bl_label = "Display"

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        owner = volumes.volume_object(context)
        properties = owner.rle_splat
        layout.prop(properties, "display")
        if properties.mode != MODES[0]:
            row = layout.row(heading="Grays")
            row.prop(properties, "use_grays", text="")
            row = row.row()
            row.enabled = properties.use_grays and properties.mode != "xray"
            row.prop(properties, "use_inverted_grays")
        in_view = getattr(context.space_data, "type", "") == "VIEW_3D"
        if in_view and (properties.mode != MODES[0] or plain_background.wants_white(owner)):
            plain_background.draw_button(layout, context.space_data.shading, owner)
        is_whole = not (clip_objects.clip_objects(context.scene) or labels.hides_rest(owner))
        if properties.mode == "minip" and is_whole:
            paragraph(context, layout, MINIP, icon="INFO")
        is_encoded = encoded.is_of(owner)
        is_there = properties.transfer is not None and transfer_nodes.is_transfer_tree(properties.transfer)
        name = properties.transfer_name if is_there or is_encoded else ""
        layout = layout.column()
        layout.enabled = not is_encoded
        layout.menu("RLE_SPLAT_MT_presets", text=LABELS.get(name.casefold(), name) or "Presets", icon="PRESET")
        span = properties.value_high - properties.value_low
        unit = with_unit("Shift", properties.value_unit)
        layout.prop(properties, "shift_by" if span >= WIDE else "shift_finely", text=unit, translate=False)
        row = layout.row()
        row.enabled = properties.mode == MODES[0] or not properties.use_grays
        row.prop(properties, "opacity_scale", slider=True)
        if not is_encoded:
            _draw_table(self.layout, properties)
        row = self.layout.row()
        row.use_property_split = False
        for name in ("show_scale_bar", "show_color_bar"):
            row.prop(context.scene.rle_splat, name)


def _draw_table(layout, properties) -> None:
    """One button, which hides the table of a CT, then shows it and hides it again."""
    layout, rows = layout.column(), properties.labels
    layout.use_property_split = False
    if not rows and properties.space == PATIENT and modality_of(properties) == "CT":
        layout.operator("rle_splat.hide_table", icon="USER")
    elif [row.label_name for row in rows] == [one.name for one in NAMES]:
        layout.prop(properties, "hide_table", icon="USER", toggle=True)


class RLE_SPLAT_PT_display(DisplayPanel, OfVolume, bpy.types.Panel):
    bl_order = 1


class RLE_SPLAT_PT_data_display(DisplayPanel, DataTab, bpy.types.Panel):
    bl_order = 1
