"""The histogram above the opacity curve: one picture as wide as the curve, its value axis, and the selected point."""

from ..bridge.look import histogram_picture, previews, transfer_nodes
from ..bridge.look.probe import value_text
from ..bridge.look.transfer import window_of
from ..bridge.translations import filled
from ..bridge.volumes import facts
from .places import BORDERS, BUTTON, paragraph


def draw_histogram(context, layout, owner) -> None:
    """Draw the histogram of a volume and the values at both ends and in the middle of the curve's range.

    Blender draws icons as squares.  The picture is in the upper part of one, and the part of the panel that it takes is
    only as high as that; what is below is transparent, and other buttons are drawn over it.
    """
    problem = facts.histogram_problem(owner.rle_splat)
    if problem:
        paragraph(context, layout, problem, icon="ERROR")
    column = layout.column(align=True)
    icon = previews.histogram_icon(owner)
    if icon:
        side = _side(context)
        picture = column.column()
        picture.ui_units_y = side / histogram_picture.ASPECT
        picture.template_icon(icon_value=icon, scale=side)
    low, high = window_of(owner.rle_splat)
    axis = column.grid_flow(columns=3, even_columns=True, align=True)
    for value, alignment in ((low, "LEFT"), (0.5 * (low + high), "CENTER"), (high, "RIGHT")):
        place = axis.row()
        place.alignment = alignment
        place.label(text=value_text(value, low, high, owner.rle_splat.value_unit))


def draw_selected(layout, owner) -> None:
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
