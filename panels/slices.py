"""The Slices panel: planes that show a volume's values in gray."""

import bpy

from ..bridge.live import slice_pictures, slice_places, slices
from ..bridge.translations import filled, with_unit
from ..bridge.volumes import volumes
from .places import Sidebar, paragraph
from .transfer import WindowMenu, draw_windows

NAME_SHARE = 0.54  # of a row, for the name of a slice beside its place
TRUE_GRAYS = "Standard", "Raw"  # view transforms


class RLE_SPLAT_PT_slices(Sidebar, bpy.types.Panel):
    bl_label = "Slices"
    bl_order = 5
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return volumes.volume_object(context) is not None or bool(slices.slice_objects(context.scene))

    def draw(self, context):
        layout = self.layout
        row = layout.row(align=True)
        for kind in ("axial", "coronal", "sagittal"):
            row.operator("rle_splat.add_slice", text=kind.title()).kind = kind.upper()
        is_quad = context.space_data is not None and len(getattr(context.space_data, "region_quadviews", ()))
        layout.operator("rle_splat.four_up_view", icon="MESH_GRID", depress=bool(is_quad))
        found = [one for one in slices.slice_objects(context.scene) if not slices.is_on_cut(one)]
        if not found:
            return
        depsgraph = context.evaluated_depsgraph_get()
        for one in found:
            halves = layout.split(factor=NAME_SHARE, align=True)
            unit = one.parent.rle_splat.length_unit if one.parent is not None else ""
            side = slice_places.growing_side(one, depsgraph)
            name = with_unit(_short_name(one), ", ".join(filter(None, (side, unit))))
            halves.operator("rle_splat.choose_object", text=name, icon="IMAGE_DATA", emboss=False).name = one.name
            row = halves.row(align=True)
            row.prop(one.rle_splat, "slice_position", text="")
            row.prop(one, "hide_viewport", text="")
            row.prop(one, "hide_render", text="")
            problem = slice_pictures.problem_of(one)
            if problem:
                paragraph(context, layout, problem, icon="ERROR")
        owner = volumes.volume_object(context) or slices.volume_of(found[0])
        if owner is not None:
            draw_window(context, layout, owner.rle_splat)


def _short_name(one) -> str:
    """A slice's name without that of its volume, which would be cut off."""
    owner = slices.volume_of(one)
    return one.name if owner is None else one.name.removeprefix(owner.name[: slices.LONGEST_NAME]).strip() or one.name


def draw_window(context, layout, properties) -> None:
    """Level and window of the volume's slices, and what changes their grays in renders."""
    unit, prefix = properties.value_unit, "slice" if not properties.slices_follow_window else "window"
    row = layout.row(align=True)
    own = row.row(align=True)
    own.enabled = not properties.slices_follow_window
    column = own.column(align=True)
    column.prop(properties, f"{prefix}_center", text=with_unit("Slice Level", unit), translate=False)
    column.prop(properties, f"{prefix}_width", text=with_unit("Slice Window", unit), translate=False)
    own.menu("RLE_SPLAT_MT_slice_windows", text="", icon="DOWNARROW_HLT")
    row.operator("rle_splat.use_window_tool", text="", icon="MOUSE_LMB_DRAG")
    row = layout.row(align=True)
    row.prop(properties, "slices_follow_window", toggle=True)
    row.prop(properties, "slices_clear_black", toggle=True)
    view = context.scene.view_settings.view_transform
    if view not in TRUE_GRAYS:
        said = filled("Renders change these grays: Color Management > View is {view}, not Standard", view=view)
        paragraph(context, layout, said, "INFO")


class RLE_SPLAT_MT_slice_windows(WindowMenu, bpy.types.Menu):
    bl_label = "Window and Level of Slices"

    def draw(self, context):
        draw_windows(self.layout, volumes.volume_object(context).rle_splat, of_slices=True)
