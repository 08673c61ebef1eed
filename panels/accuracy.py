"""The Accuracy panel: measured times and errors of several quality settings, the choice of one, and the error map."""

import bpy
from bpy.app.translations import pgettext_iface

from ..bridge.data import accuracy
from ..bridge.data.properties import QUALITY_ITEMS
from ..bridge.translations import OURS
from .places import RenderTab, Sidebar, paragraph

NAME_SHARE = 0.485  # of a row's width that the plan's name takes


class AccuracyPanel:
    """Draws the panel in the sidebar and in the render properties."""

    bl_label = "Accuracy"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 1  # after what is known without measuring

    def draw(self, context):
        layout, settings = self.layout, context.scene.rle_splat
        layout.operator("rle_splat.measure_accuracy", icon="TIME")
        if not settings.accuracy_rows:
            layout.label(text="Not measured yet")
        truth = ""
        for index, row in enumerate(settings.accuracy_rows):
            if row.truth != truth:
                truth = row.truth
                paragraph(context, layout, accuracy.truth_sentence(truth) + ":")
                box = layout.box().column(align=True)
                _draw_cells(box, "Plan", ("ms", "RMSE", "Max"))
            cells = (_short(row.frame_ms, 0), _short(row.rmse, 2), _short(row.largest, 2))
            name, is_current = _title(row.name), accuracy.is_current(context.scene, row)
            _draw_cells(box, name, cells, index, is_current, row.on_front)
        if settings.accuracy_note:
            paragraph(context, layout, settings.accuracy_note)
        layout.operator("rle_splat.error_map", icon="IMAGE_DATA")
        if settings.error_image is not None:
            layout.prop(settings, "error_image", text="")
            paragraph(context, layout, settings.error_note)


def _title(name: str) -> str:
    """What the panels call a plan; the heading of its list says which edges it has."""
    quality = name.rpartition(" ")[2]
    return next((pgettext_iface(label, OURS) for item, label, _ in QUALITY_ITEMS if item == quality), name)


def _short(value: float, decimals: int) -> str:
    """A number in at most five characters, the width of a column."""
    if value >= 10_000:
        return f"{value / 1000:.0f}k"
    if value >= 10:
        return f"{value:.0f}"
    least = 10.0**-decimals
    return f"{value:.{decimals}f}" if value >= least else f"< {least:g}"


def _draw_cells(box, name: str, cells, index: int | None = None, current: bool = False, on_front: bool = True) -> None:
    """Draw one row of the list: a plan with its button, or the headings when ``index`` is None."""
    split = box.split(factor=NAME_SHARE)
    if index is None:
        split.label(text=name)
    else:
        icon = "RADIOBUT_ON" if current else "RADIOBUT_OFF"
        button = split.operator("rle_splat.choose_plan", text=name, icon=icon, emboss=current)
        button.index = index
    row = split.row()
    row.active = on_front
    for cell in cells:
        row.label(text=cell)


class RLE_SPLAT_PT_accuracy(AccuracyPanel, Sidebar, bpy.types.Panel):
    bl_parent_id = "RLE_SPLAT_PT_diagnostics"


class RLE_SPLAT_PT_render_accuracy(AccuracyPanel, RenderTab, bpy.types.Panel):
    bl_parent_id = "RLE_SPLAT_PT_render_diagnostics"
