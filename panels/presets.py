"""The Presets panel: pictures of the volume with each preset, which a button below applies."""

import bpy

from ..bridge import linked
from ..bridge.look import preset_entries, thumbnails
from ..bridge.translations import with_ellipsis
from ..bridge.volumes import encoded, volumes
from .places import BORDERS, BUTTON, OfVolume

# Pixels at interface scale 1: width of a picture, and of one with a second button or a name of more letters than fit.
SMALLEST, WIDE = 72.0, 100.0
LETTERS = 11
MOST_COLUMNS = 6


class RLE_SPLAT_PT_presets(OfVolume, bpy.types.Panel):
    bl_label = "Presets"
    bl_parent_id = "RLE_SPLAT_PT_display"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        owner = volumes.volume_object(context)
        row = layout.row(align=True)
        row.operator("rle_splat.save_user_preset", text=with_ellipsis("Save as Preset"), icon="ADD")
        row.operator("rle_splat.import_presets", text=with_ellipsis("Import"), icon="IMPORT")
        for group in preset_entries.groups(owner.rle_splat):
            header, body = layout.panel(f"RLE_SPLAT_presets_{group.name}", default_closed=not group.is_open)
            header.label(text=group.label)
            if body is not None:
                body.enabled = not (linked.why_not_editable(owner) or encoded.is_of(owner))
                _draw_grid(context, body, owner, group)


def _draw_grid(context, layout, owner, group) -> None:
    is_short = group.name != preset_entries.OWN and max(len(entry.label) for entry in group.entries) <= LETTERS
    columns, scale = _columns(context, SMALLEST if is_short else WIDE)
    grid = layout.grid_flow(row_major=True, columns=columns, even_columns=True, even_rows=True, align=False)
    for entry in group.entries:
        cell = grid.column(align=True)
        icon = thumbnails.icon(owner, entry)
        if icon:
            cell.template_icon(icon_value=icon, scale=scale)
        else:
            _draw_placeholder(cell, scale)
        row = cell.row(align=True)
        kind = "apply_user_preset" if entry.is_own else "apply_preset"
        button = row.operator(f"rle_splat.{kind}", text=entry.label, depress=entry.is_of(owner.rle_splat))
        if entry.is_own:
            button.name = entry.name
            row.operator("rle_splat.delete_user_preset", text="", icon="TRASH").name = entry.name
        else:
            button.preset = entry.name


def _draw_placeholder(layout, scale: float) -> None:
    """A picture's room with an icon in its middle."""
    row = layout.row()
    row.scale_y = scale
    row.alignment = "CENTER"
    row.label(text="", icon="IMAGE_DATA")


def _columns(context, narrowest: float) -> tuple[int, float]:
    """How many pictures stand side by side, and their icon scale."""
    scale = context.preferences.system.ui_scale or 1.0
    width = context.region.width / scale if context.region is not None else 0.0
    room = max(width - BORDERS, narrowest)
    columns = max(1, min(int(room / narrowest), MOST_COLUMNS))
    return columns, room / columns / BUTTON
