"""The top of the tab: the active volume, its views and its status."""

import bpy

from ..bridge.loop import work
from ..bridge.loop.jobs import StepwiseOperator
from ..bridge.translations import translate
from ..bridge.volumes import volumes
from ..operators.refusal import WHICH_VOLUME
from ..rle_splat.runtime.jit import NUMBA_PROBLEM
from ..rle_splat.volume.volume import PATIENT
from . import first_run
from .live_view import draw_state, draw_switch
from .picture import draw_in_renders
from .places import Sidebar, paragraph
from .volume_menu import icon_of


class RLE_SPLAT_PT_volume(Sidebar, bpy.types.Panel):
    """With a header, without which Blender draws no background behind a panel's text."""

    bl_label = "Volume"
    bl_order = 0

    def draw_header_preset(self, context):
        if volumes.volume_object(context) is not None:
            draw_switch(self.layout, context.space_data)
            draw_in_renders(self.layout, context.scene.rle_splat.use_composite, text="")

    def draw(self, context):
        layout = self.layout
        _warn_without_numba(context, layout)
        _draw_progress(layout)
        owner = volumes.volume_object(context)
        if owner is not None:
            layout.menu("RLE_SPLAT_MT_volumes", text=owner.name, icon=icon_of(owner))
            _draw_views(layout, owner.rle_splat)
            draw_state(context, layout)
        elif volumes.volume_objects(context.scene):
            layout.menu("RLE_SPLAT_MT_volumes", text="Choose a Volume", icon="OUTLINER_OB_VOLUME")
            paragraph(context, layout, WHICH_VOLUME, icon="INFO")
        else:
            first_run.draw(context, layout)


def _draw_views(layout, properties) -> None:
    """Buttons that move the view to the volume, for a patient from each side."""
    is_patient = properties.space == PATIENT
    row = layout.split(factor=0.47, align=True) if is_patient else layout
    row.operator("rle_splat.frame_volume", icon="ZOOM_SELECTED").side = "NONE"
    if is_patient:
        sides = row.row(align=True)
        for side in "APLRSI":
            sides.operator("rle_splat.frame_volume", text=side).side = side


def _draw_progress(layout) -> None:
    """Say how far a file is read, or another long job is."""
    progress = StepwiseOperator.progress() or work.progress()
    if progress is not None:
        layout.progress(factor=progress.fraction, type="BAR", text=translate(progress.message))


def _warn_without_numba(context, layout) -> None:
    """Say that numba is missing or broken, what follows from it, and what to do."""
    if NUMBA_PROBLEM:
        box = layout.box()
        box.alert = True
        box.label(text="No compiled code: rendering is very slow", icon="ERROR")
        paragraph(context, box, f"numba cannot be loaded ({NUMBA_PROBLEM}). Disable other extensions that bring a "
                                "numba of their own, or reinstall this one, then restart Blender")  # fmt: skip
