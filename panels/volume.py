"""The Volume panel: file, grid, values, memory, and remarks on unusual data."""

import bpy

from ..bridge import read_ahead, volumes
from ..bridge.jobs import StepwiseOperator
from ..operators.refusal import WHICH_VOLUME
from ..rle_splat.volume.volume import PATIENT
from .live_view import draw_state, draw_switch
from .places import Sidebar, paragraph


class RLE_SPLAT_PT_volume(Sidebar, bpy.types.Panel):
    bl_label = "Volume"
    bl_idname = "RLE_SPLAT_PT_volume"
    bl_order = 0

    def draw(self, context):
        layout = self.layout
        _draw_progress(layout)
        owner = volumes.volume_object(context)
        if owner is None:
            if volumes.volume_objects(context.scene):
                paragraph(context, layout, WHICH_VOLUME, icon="INFO")
            layout.operator("rle_splat.import_volume", icon="IMPORT")
            return
        properties = owner.rle_splat
        row = layout.row()
        row.label(text=owner.name, icon=_icon(owner))
        draw_switch(row, context.space_data)
        draw_state(context, layout)
        _draw_views(layout, properties)
        column = layout.column(align=True)
        for line in properties.facts.split("\n"):
            name, _, value = line.partition(": ")
            row = column.split(factor=0.32, align=True)
            row.label(text=name)
            row.label(text=value)
        for sentence in filter(None, properties.remarks.split("\n")):
            paragraph(context, layout, sentence, icon="INFO")
        row = layout.row(align=True)
        row.prop(properties, "filepath", text="")
        row.operator("rle_splat.relocate", text="Relocate")
        layout.operator("rle_splat.import_volume", text="Import Another", icon="IMPORT")


def _draw_views(layout, properties) -> None:
    """Buttons that move the view to the volume, for a patient from each side."""
    is_patient = properties.space == PATIENT
    row = layout.split(factor=0.36, align=True) if is_patient else layout
    row.operator("rle_splat.frame_volume", text="Frame", icon="ZOOM_SELECTED").side = "NONE"
    if is_patient:
        sides = row.row(align=True)
        for side in "APLRSI":
            sides.operator("rle_splat.frame_volume", text=side).side = side


def _draw_progress(layout) -> None:
    """Say how far a file is read, or another long job is."""
    progress = StepwiseOperator.progress() or read_ahead.progress()
    if progress is not None:
        layout.progress(factor=progress.fraction, type="BAR", text=progress.message)


def _icon(owner) -> str:
    """The outliner's icon for a local, linked or overridden volume; linked ones have disabled buttons."""
    if owner.library is not None:
        return "LIBRARY_DATA_DIRECT"
    return "OUTLINER_OB_VOLUME" if owner.override_library is None else "LIBRARY_DATA_OVERRIDE"


CLASSES = (RLE_SPLAT_PT_volume,)
