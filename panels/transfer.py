"""The Color and Opacity panel: histogram, opacity curve, color ramp, level and window."""

import bpy

from ..bridge import linked
from ..bridge.data.automatic import draw_length
from ..bridge.look import transfer, transfer_nodes
from ..bridge.translations import filled, with_unit
from ..bridge.volumes import encoded, volumes
from ..operators.window_level import WINDOWS, windows_of
from .histogram import draw_curve
from .places import DataTab, OfVolume, paragraph


class WindowMenu:
    """A menu of common windows."""

    @classmethod
    def poll(cls, context):
        return volumes.volume_object(context) is not None


class RLE_SPLAT_MT_windows(WindowMenu, bpy.types.Menu):
    bl_label = "Window and Level"

    def draw(self, context):
        draw_windows(self.layout, volumes.volume_object(context).rle_splat)
        self.layout.separator()
        wider = self.layout.operator("rle_splat.window_level", text="Show All Values, Keep Colors")
        wider.preset, wider.keep_values = "DATA", True


def draw_windows(layout, properties, of_slices: bool = False) -> None:
    """The common windows of a volume in a menu, each with its level and window."""
    whole = layout.operator("rle_splat.window_level", text="All Values")
    whole.preset, whole.of_slices = "DATA", of_slices
    for name in windows_of(properties, of_slices):
        label, level, width, _ = WINDOWS[name]
        numbers = filled("L {level}, W {width}", level=f"{level:g}", width=f"{width:g}")
        one = layout.operator("rle_splat.window_level", text=with_unit(label, numbers), translate=False)
        one.preset, one.of_slices = name, of_slices


class ColorPanel:
    """Draws the panel in the sidebar and in the object data properties."""

    bl_label = "Color and Opacity"

    def draw(self, context):
        layout = self.layout
        owner = volumes.volume_object(context)
        if encoded.is_of(owner):
            paragraph(context, layout, encoded.STORED_VALUES, icon="INFO")
            return
        tree = owner.rle_splat.transfer
        if tree is None or not transfer_nodes.is_transfer_tree(tree):
            layout.label(text="No transfer function. Apply a preset", icon="ERROR")
            return
        draw_curve(context, layout, owner)
        ramp = layout.column()
        ramp.enabled = linked.is_own(tree)
        ramp.template_color_ramp(tree.nodes[transfer_nodes.COLOR_NODE], "color_ramp", expand=True)
        _draw_window(layout, owner.rle_splat)
        _draw_opacity(layout, owner.rle_splat)
        layout.operator("rle_splat.keyframe_transfer_function", icon="KEY_HLT")
        if transfer.is_shared(owner):
            label = filled("Make Single-User Copy ({users} Users)", users=tree.users)
            layout.operator("rle_splat.make_single_user", text=label, icon="DUPLICATE")


def _draw_window(layout, properties) -> None:
    """Level and window, and the menu of common ones."""
    unit = properties.transfer_unit
    row = layout.row(align=True)
    column = row.column(align=True)
    column.prop(properties, "window_center", text=with_unit("Level", unit), translate=False)
    column.prop(properties, "window_width", text=with_unit("Window", unit), translate=False)
    row.menu("RLE_SPLAT_MT_windows", text="", icon="DOWNARROW_HLT")
    row.operator("rle_splat.use_window_tool", text="", icon="MOUSE_LMB_DRAG")


def _draw_opacity(layout, properties) -> None:
    """The length to which opacities refer, and the opacity of flat regions."""
    draw_length(
        layout, properties, "opacity_unit_distance", "use_smallest_spacing", "Opacity Unit Distance",
        min(properties.found_spacing))  # fmt: skip
    layout.prop(properties, "use_gradient_opacity")
    if properties.use_gradient_opacity:
        if transfer_nodes.gradient_mapping(properties.transfer) is not None:
            curve = layout.column()
            curve.enabled = linked.is_own(properties.transfer)
            curve.template_curve_mapping(properties.transfer.nodes[transfer_nodes.GRADIENT_NODE], "mapping")
        column = layout.column(align=True)
        for name in ("gradient_low", "gradient_high"):
            column.prop(properties, name)


class RLE_SPLAT_PT_transfer(ColorPanel, OfVolume, bpy.types.Panel):
    bl_order = 2


class RLE_SPLAT_PT_data_transfer(ColorPanel, DataTab, bpy.types.Panel):
    bl_order = 2
    bl_options = {"DEFAULT_CLOSED"}
