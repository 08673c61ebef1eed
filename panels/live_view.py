"""The switch that shows volumes live in one viewport: beside the volume's name, and among the viewport's overlays."""

import bpy

from ..bridge import live
from ..bridge.data import preferences
from ..bridge.live import shown
from ..bridge.translations import filled, with_ellipsis
from ..bridge.volumes import volumes
from .outdated import draw_outdated
from .places import paragraph


def draw_switch(layout, space, text: str = "") -> None:
    """Draw the switch of a viewport: an eye without a text, a checkbox with one.

    Parameters
    ----------
    space : bpy.types.Space
        Nothing is drawn for another editor than a 3D view.
    """
    if space is None or space.type != "VIEW_3D":
        return
    if text:
        layout.prop(space, shown.SWITCH, text=text)
    else:
        icon = "HIDE_OFF" if shown.is_on(space) else "HIDE_ON"
        layout.prop(space, shown.SWITCH, text="", icon=icon)


def draw_state(context, layout) -> None:
    """Say whether the viewport is up to date, why it shows no volume, or which pictures are outdated.

    While a picture is made there is always one line, so that nothing below moves under the mouse.
    """
    area = context.area
    if area is None or area.type != "VIEW_3D":
        return
    if not shown.is_on(context.space_data):
        if not draw_outdated(context, layout):
            layout.label(text="Not shown in this viewport", icon="HIDE_ON")
        return
    for sentence in volumes.list_changes(context.scene):
        paragraph(context, layout, sentence, icon="ERROR")
    problem, remark = live.problem_of(area), live.remark_of(area)
    if remark:
        paragraph(context, layout, remark, icon="INFO")
    if problem:
        paragraph(context, layout, filled("Not shown in this viewport: {problem}", problem=problem), icon="ERROR")
        row = layout.row(align=True)
        owner = volumes.volume_object(context)
        if owner is not None and volumes.is_missing(owner):
            row.operator("rle_splat.relocate_volume", text=with_ellipsis("Relocate"), icon="FILE_FOLDER")
        row.operator("rle_splat.try_again", icon="FILE_REFRESH")
    elif mesh := live.mesh_before(area):
        paragraph(context, layout, live.sentence_of_mesh(area), icon="ERROR")
        layout.operator(
            "rle_splat.hide_mesh", text=filled("Hide {mesh}", mesh=mesh), translate=False, icon="HIDE_ON"
        ).mesh = mesh
    elif not preferences.value("show_live"):
        paragraph(
            context, layout, "Show Volumes Live is off; turn it on in the preferences of RLE Splat", icon="HIDE_ON"
        )
    elif viewports := live.viewports_of(area):
        if any(one.waits for one in viewports):
            layout.label(text="Reading files", icon="SORTTIME")
        elif any(one.is_busy for one in viewports):
            layout.label(text="Refining", icon="SORTTIME")
        elif all(one.is_refined or not one.pictures for one in viewports):
            layout.label(text="Up to date", icon="CHECKMARK")
        else:
            layout.label(text="Draft, up to date", icon="CHECKMARK")


def _draw_overlay(self, context) -> None:
    """An entry in the popover of viewport overlays."""
    if volumes.volume_objects(context.scene):
        draw_switch(self.layout, context.space_data, "Volumes (RLE Splat)")


def register():
    bpy.types.VIEW3D_PT_overlay.append(_draw_overlay)


def unregister():
    bpy.types.VIEW3D_PT_overlay.remove(_draw_overlay)
