"""Text over the viewport: the patient's sides beside a volume, and why a volume is not shown.

R and L, A and P, I and S stand where the patient's right, left, front, back, feet and head are, for volumes whose file
says where that is; two of them where a side of the picture is between two of the patient's.  Views of slices also have
a line with the place of the slice.
"""

import textwrap

import blf
import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector

from ...rle_splat.volume.orientation import letters_of
from ...rle_splat.volume.volume import PATIENT
from .. import live
from ..scene import placements
from ..scene.callouts import MARK, POINT, SEGMENT
from ..translations import translate
from ..volumes import box, volumes
from . import drawing, slice_places

SIZE = 15  # points; scaled with Blender's interface
SIDES = ((-1.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.0, -1.0))  # left, right, top and bottom of a picture
ASLANT = 1e-6  # of the most that a line faces a direction: lines along it, which no letter passes
FONT = 0  # Blender's own


def letters_of_sides(volume_object, view) -> list:
    """The letters at the sides of a picture, as figures have them; none where the volume's file does not say the sides.

    Parameters
    ----------
    view : (2, 3) array_like
        Unit vectors to the right and up of the picture, in world space.

    Returns
    -------
    list of (str, Vector)
        One or two letters, and the direction of their side in the picture.
    """
    if volume_object.rle_splat.space != PATIENT:
        return []
    own = np.linalg.pinv(np.array(volume_object.matrix_world)[:3, :3]) @ np.asarray(view).T
    sights = [own @ side for side in np.array(SIDES)]
    return [(letters_of(sight / np.linalg.norm(sight)), Vector(side)) for sight, side in zip(sights, SIDES)]


def is_letter(one, owner) -> bool:
    """Whether an object is an orientation letter, or a part of the scale bar, of a volume."""
    return one.get(MARK) == owner.name and SEGMENT not in one and POINT not in one


def has_objects(volume_object) -> bool:
    """Whether letters that are objects, and seen, stand at a volume."""
    return any(one.get(MARK) == volume_object.name and one.visible_get() for one in volume_object.children)


def ink_over(context) -> tuple[float, float, float, float]:
    """The color of text over a viewport: that of the theme, or black on a bright background of its own."""
    shading = context.space_data.shading
    if shading.type == "SOLID" and shading.background_type == "VIEWPORT" and min(shading.background_color) > 0.5:
        return 0.0, 0.0, 0.0, 1.0
    return *context.preferences.themes[0].view_3d.space.text_hi, 1.0


def _draw() -> None:
    """Draw the letters of all visible volumes, channels apart, into the region that is drawn."""
    context = bpy.context
    owners = volumes.volume_objects(context.scene)
    if not (owners and context.space_data.overlay.show_overlays):
        return
    sentence = live.sentence_of_last_render(context) or live.problem_of(context.area)
    sentence = sentence or live.sentence_of_mesh(context.area)
    faced = slice_places.faced_slice(context)
    if faced is not None and not sentence:
        sentence = slice_places.place_text(faced, context.evaluated_depsgraph_get())
    _draw_lines(context, sentence)
    shown = [owner for owner in owners if owner.visible_get()]
    channels = placements.as_channels(shown)
    blf.size(FONT, SIZE * context.preferences.system.ui_scale)
    *ink, strength = ink_over(context)
    if context.region_data.view_perspective == "CAMERA":  # to which the objects turn
        shown = [owner for owner in shown if not has_objects(owner)]
    for owner in (one for one in shown if one not in channels):
        for text, place, away in _on_screen(owner, context):
            width, height = blf.dimensions(FONT, text)
            left, bottom = place.x + 0.5 * (away * (width - height) - width), place.y - 0.5 * height
            left = min(max(left, 0.5 * height), context.region.width - width - 0.5 * height)
            bottom = min(max(bottom, 0.5 * height), context.region.height - 1.5 * height)
            blf.color(FONT, *ink, strength)
            blf.position(FONT, left, bottom, 0.0)
            blf.draw(FONT, text)


def _draw_lines(context, sentence: str) -> None:
    """Draw a sentence at the foot of the region, in as many lines as its width takes."""
    if not sentence:
        return
    size = SIZE * context.preferences.system.ui_scale
    blf.size(FONT, size)
    blf.color(FONT, *ink_over(context))
    left, right = context.region.x, context.region.x + context.region.width
    begin = left
    for one in context.area.regions:  # toolbar and sidebar lie over the view
        if one.type == "UI" and one.width > 1 and left < one.x:
            right = min(right, one.x)
        elif one.type == "TOOLS" and one.width > 1 and one.x <= left:
            begin = max(left, one.x + one.width)
    share = (right - begin - 2 * size) / blf.dimensions(FONT, sentence)[0]
    width = max(int(len(sentence) * share), 10)
    for number, line in enumerate(reversed(textwrap.wrap(translate(sentence), width))):
        blf.position(FONT, begin - left + size, (1.0 + 1.5 * number) * size, 0.0)
        blf.draw(FONT, line)


def _on_screen(owner, context) -> list:
    """The letters to draw: text, Vector in pixels, and -1 to 1 for how far to the left or right of the opposite side.

    A volume has none if its middle is out of view, or a part of it is behind the eye.
    """
    corners, view = box.world_corners(owner), context.region_data
    seen = [location_3d_to_region_2d(context.region, view, Vector(corner)) for corner in corners.tolist()]
    if None in seen or not seen:
        return []
    center = location_3d_to_region_2d(context.region, view, Vector(corners.mean(axis=0).tolist()))
    if not (0.0 < center.x < context.region.width and 0.0 < center.y < context.region.height):
        return []
    space = SIZE * context.preferences.system.ui_scale
    found = []
    for text, toward in letters_of_sides(owner, np.array(view.view_matrix)[:2, :3]):
        away = _outline_distance(np.array(seen) - np.array(center), np.array(toward)) + space
        found.append((text, center + toward * away, toward.x))
    return found


def _outline_distance(corners: np.ndarray, toward: np.ndarray) -> float:
    """How far the outline of a box, or its point reflection, is from its middle, the origin, along a direction.

    ``corners``, (n, 2): where the picture shows the corners. Of the lines through two of them, moved outward until all
    are behind them, the nearest are the outline.
    """
    across = (corners[:, None] - corners).reshape(-1, 2)[:, ::-1] * (1.0, -1.0)  # normals of the lines
    facing = np.abs(across @ toward)
    ahead = facing > ASLANT * facing.max()
    return float((np.abs(corners @ across[ahead].T).max(axis=0) / facing[ahead]).min())


HANDLERS = drawing.Handlers((_draw, "POST_PIXEL"))
