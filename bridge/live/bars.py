"""A scale bar and a color bar in the viewports, drawn over what they show."""

import math

import blf
import bpy
import gpu
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from gpu_extras.batch import batch_for_shader
from mathutils import Vector

from ...rle_splat.scene import MODES, RleSplatError
from ...rle_splat.scene.color import to_display
from ..data.settings import scene_scale_of
from ..look import transfer
from ..look.probe import value_text
from ..translations import filled
from ..volumes import box, volumes
from . import drawing
from .letters import ink_over

FONT, SIZE = 0, 12  # Blender's own font; points, scaled with Blender's interface
LONGEST = 160.0  # pixels of a scale bar at interface scale 1
THICK, TALL = 4.0, 160.0  # pixels: of the scale bar, and of the color bar
LEFT, BOTTOM = 70.0, 30.0  # pixels, beside the toolbar
STEPS = 32  # of the color bar


def length_of_bar(pixels_a_unit: float, longest: float) -> float:
    """The longest of 1, 2 and 5 times a power of ten whose bar has at most ``longest`` pixels.

    ``pixels_a_unit`` is above 0: pixels of one unit of length.
    """
    most = longest / pixels_a_unit
    power = 10.0 ** math.floor(math.log10(most))
    return max((digit * power for digit in (1.0, 2.0, 5.0) if digit * power <= most * (1.0 + 1e-9)), default=power)


def pixels_a_unit(context, owner) -> float:
    """Pixels of a unit of a volume's length, seen at the middle of its box; 0 where that is behind the view."""
    corners = box.world_corners(owner)
    if len(corners) == 0:
        return 0.0
    middle = Vector(corners.mean(axis=0).tolist())
    across = context.region_data.view_rotation @ Vector((1.0, 0.0, 0.0))
    world = scene_scale_of(context.scene, owner.rle_splat.length_unit)
    places = [location_3d_to_region_2d(context.region, context.region_data, point)
              for point in (middle, middle + world * across)]  # fmt: skip
    return 0.0 if None in places else (places[1] - places[0]).length


def colors_of(owner) -> np.ndarray:
    """(STEPS + 1, 4) display colors of a volume's window, from low to high; RleSplatError if it has no colors."""
    low, high = transfer.window_of(owner.rle_splat)
    if owner.rle_splat.mode != MODES[0] and owner.rle_splat.use_grays:
        rgb = np.repeat(np.linspace(*transfer.gray_ends(owner.rle_splat), STEPS + 1)[:, None], 3, axis=1)
    else:
        rgb = to_display(transfer.read_transfer(owner).color_at(np.linspace(low, high, STEPS + 1)))
    return np.column_stack((rgb, np.ones(STEPS + 1)))


def _draw() -> None:
    """POST_PIXEL: the bars of the volume that the buttons work on."""
    context = bpy.context
    settings = context.scene.rle_splat
    if not (settings.show_scale_bar or settings.show_color_bar) or not context.space_data.overlay.show_overlays:
        return
    owner = volumes.volume_object(context)
    if owner is None or not owner.visible_get():
        return
    scale = context.preferences.system.ui_scale
    ink = ink_over(context)
    blf.size(FONT, SIZE * scale)
    blf.color(FONT, *ink)
    if settings.show_scale_bar:
        _draw_scale(context, owner, scale, ink)
    if settings.show_color_bar:
        _draw_colors(owner, scale)


def _draw_scale(context, owner, scale: float, ink) -> None:
    a_unit = pixels_a_unit(context, owner)
    if a_unit <= 0.0:
        return
    length = length_of_bar(a_unit, LONGEST * scale)
    left, bottom, right = LEFT * scale, BOTTOM * scale, LEFT * scale + length * a_unit
    top = bottom + THICK * scale
    _strip([(left, bottom), (left, top), (right, bottom), (right, top)], [ink] * 4)
    text = f"{length:g} {owner.rle_splat.length_unit}"
    if context.region_data.is_perspective:
        text = filled("{length} at the middle of the volume", length=text)
    _write(text, left, bottom + 2.0 * THICK * scale)


def _draw_colors(owner, scale: float) -> None:
    try:
        colors = colors_of(owner)
    except RleSplatError:
        return  # the panel shows why
    left, bottom = LEFT * scale, 2.0 * BOTTOM * scale
    heights = bottom + TALL * scale * np.linspace(0.0, 1.0, len(colors))
    corners = [(x, y) for y in heights.tolist() for x in (left, left + 3.0 * THICK * scale)]
    _strip(corners, np.repeat(colors, 2, axis=0).tolist())
    low, high = transfer.window_of(owner.rle_splat)
    for share in (0.0, 0.5, 1.0):
        value = value_text(low + share * (high - low), low, high, owner.rle_splat.value_unit)
        _write(value, left + 4.5 * THICK * scale, bottom + share * TALL * scale - 0.35 * SIZE * scale)


def _strip(corners, colors) -> None:
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    content = {"pos": [(*corner, 0.0) for corner in corners], "color": colors}
    batch_for_shader(shader, "TRI_STRIP", content).draw(shader)


def _write(text: str, x: float, y: float) -> None:
    blf.position(FONT, x, y, 0.0)
    blf.draw(FONT, text)


HANDLERS = drawing.Handlers((_draw, "POST_PIXEL"))
