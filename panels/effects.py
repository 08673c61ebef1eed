"""The Effects panel: the effects that are on with their times, and all of them with reasons and switches."""

import bpy

from ..bridge.data.effects import TEXTS, property_of, title
from .places import RenderTab, Sidebar, paragraph

NAME_SHARE = 0.62  # of a row's width that the effect's name takes


class EffectsPanel:
    """Draws the panel in the sidebar and in the render properties."""

    bl_label = "Effects"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, settings = self.layout, context.scene.rle_splat
        layout.operator("rle_splat.list_effects", icon="FILE_REFRESH")
        rows = {row.name: row for row in settings.effect_rows}
        used = [name for name in TEXTS if name in rows and rows[name].on]
        column = layout.column(align=True)
        for name in used:
            split = column.split(factor=NAME_SHARE)
            split.label(text=title(name))
            split.label(text=_time(rows[name]))
        if not used:
            column.label(text="No effect is on" if rows else "Not listed yet")
        if settings.effects_note:
            paragraph(context, layout, settings.effects_note)
        header, body = layout.panel("rle_splat_all_effects", default_closed=True)
        header.label(text="All Effects")
        if body is not None:
            _draw_all(context, body, rows)


def _draw_all(context, layout, rows: dict) -> None:
    """Every effect with the choice that forces it on or off, and why it is on or off."""
    for name in TEXTS:
        box = layout.box().column(align=True)
        split = box.split(factor=NAME_SHARE)
        split.label(text=title(name))
        split.prop(context.scene.rle_splat.effect_overrides, property_of(name), text="")
        if name in rows:
            paragraph(context, box, row_text(rows[name]))


def row_text(row) -> str:
    """One line: whether an effect is on, its time in milliseconds, and the reason."""
    took = f", {_time(row)}" if row.is_timed and (row.on or row.ms) else ""
    return f"{'On' if row.on else 'Off'}{took}: {row.reason}"


def _time(row) -> str:
    """The time of an effect in the last picture; "" where it is not known."""
    return f"{row.ms:.1f} ms" if row.is_timed else ""


class RLE_SPLAT_PT_effects(EffectsPanel, Sidebar, bpy.types.Panel):
    bl_parent_id = "RLE_SPLAT_PT_diagnostics"


class RLE_SPLAT_PT_render_effects(EffectsPanel, RenderTab, bpy.types.Panel):
    bl_parent_id = "RLE_SPLAT_PT_render_diagnostics"
