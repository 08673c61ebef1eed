"""The opacity curve with the histogram inside it, its value axis, and the selected point."""

from ..bridge import linked
from ..bridge.look import previews, transfer_nodes
from ..bridge.look.probe import number_text, value_text
from ..bridge.look.transfer import window_of
from ..bridge.translations import filled
from ..bridge.volumes import facts
from .places import BORDERS, BUTTON, paragraph

# In buttons, as measured on screens: the row above Blender's curve, the curve, and what is free beside an icon.
ABOVE_CURVE, CURVE, MARGIN = 0.9, 7.78, 0.8


def draw_curve(context, layout, owner) -> None:
    """Draw the opacity curve of a volume, its histogram, and the values at both ends and in the middle of their range.

    The picture of the histogram is laid over the curve: it is added later, to a column above that has no height.
    Blender gives no mouse events to pictures.
    """
    problem = facts.histogram_problem(owner.rle_splat)
    if problem:
        paragraph(context, layout, problem, icon="ERROR")
    column = layout.column(align=True)
    over, curve = column.column(align=True), column.column()
    curve.enabled = linked.is_own(owner.rle_splat.transfer)
    curve.template_curve_mapping(owner.rle_splat.transfer.nodes[transfer_nodes.OPACITY_NODE], "mapping")
    side = _side(context)
    icon = previews.histogram_icon(owner, CURVE / (side - MARGIN))
    if icon:
        over.ui_units_y = 0.01  # 0 is as high as what is in it
        above = over.row()
        above.scale_y = ABOVE_CURVE
        above.label(text="")
        over.template_icon(icon_value=icon, scale=side)
    low, high = window_of(owner.rle_splat)
    axis = column.grid_flow(columns=3, even_columns=True, align=True)
    for value, alignment in ((low, "LEFT"), (0.5 * (low + high), "CENTER"), (high, "RIGHT")):
        place = axis.row()
        place.alignment = alignment
        place.label(text=number_text(value, low, high, owner.rle_splat.value_unit))  # Level and Window name the unit
    _draw_selected(column, owner)


def _draw_selected(layout, owner) -> None:
    """Tell the value and the opacity of the curve's selected point, where one is selected."""
    properties = owner.rle_splat
    points = transfer_nodes.opacity_mapping(properties.transfer).curves[0].points
    chosen = [point.location for point in points if point.select]
    if len(chosen) == 1:
        low, high = window_of(properties)
        value = value_text(low + chosen[0].x * (high - low), low, high, properties.value_unit)
        opacity = min(max(chosen[0].y * properties.opacity_scale, 0.0), 1.0)
        layout.label(text=filled("Selected: {value}, opacity {opacity}", value=value, opacity=f"{opacity:.2f}"))


def _side(context) -> float:
    """The side, in buttons, of a square icon that is as wide as the panel."""
    scale = context.preferences.system.ui_scale or 1.0
    width = context.region.width / scale if context.region is not None else 0.0
    return max(2.0, (width - BORDERS) / BUTTON)
