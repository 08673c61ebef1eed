"""The Effects panel: one row for each effect with its state, the reason, its time, and a switch to force it."""

import bpy

from ..bridge.effects import property_of
from ..rle_splat.effects.analyze import EFFECTS
from .places import RenderTab, Sidebar, paragraph

NAME_SHARE = 0.62  # of a row's width that the effect's name takes
ON, OFF, UNKNOWN = "CHECKBOX_HLT", "CHECKBOX_DEHLT", "QUESTION"


class EffectsPanel:
    """Draws the panel in the sidebar and in the render properties."""

    bl_label = "Effects"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, settings = self.layout, context.scene.rle_splat
        layout.operator("rle_splat.list_effects", icon="VIEWZOOM")
        for name in EFFECTS:
            row = settings.effect_rows.get(name)
            box = layout.box().column(align=True)
            split = box.split(factor=NAME_SHARE)
            split.label(text=title(name), icon=UNKNOWN if row is None else ON if row.on else OFF)
            split.prop(settings.effect_overrides, property_of(name), text="")
            if row is not None:
                paragraph(context, box, row_text(row))
        if settings.effects_note:
            paragraph(context, layout, settings.effects_note)


def title(name: str) -> str:
    """The name of an effect in Title Case: Depth of Field."""
    return name.title().replace(" Of ", " of ")


def row_text(row) -> str:
    """One line: whether an effect is on, its time in milliseconds, and the reason."""
    took = f", {row.ms:.1f} ms" if row.is_timed and (row.on or row.ms) else ""
    return f"{'On' if row.on else 'Off'}{took}: {row.reason}"


class RLE_SPLAT_PT_effects(EffectsPanel, Sidebar, bpy.types.Panel):
    bl_idname = "RLE_SPLAT_PT_effects"
    bl_parent_id = "RLE_SPLAT_PT_diagnostics"


class RLE_SPLAT_PT_render_effects(EffectsPanel, RenderTab, bpy.types.Panel):
    bl_idname = "RLE_SPLAT_PT_render_effects"
    bl_parent_id = "RLE_SPLAT_PT_render_diagnostics"


CLASSES = (RLE_SPLAT_PT_effects, RLE_SPLAT_PT_render_effects)
