"""Text over the viewport: the patient's sides at the faces of a volume's box, and why a volume is not shown.

R and L, A and P, I and S stand where the patient's right, left, front, back, feet and head are, for volumes whose file
says where that is.  Views of slices also have a line with the place of the slice.
"""

import textwrap

import blf
import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector

from ...rle_splat.volume.orientation import face_letters
from ...rle_splat.volume.volume import PATIENT
from .. import live
from ..scene import placements
from ..scene.callouts import MARK, POINT, SEGMENT
from ..translations import translate
from ..volumes import box, volumes
from . import drawing, slice_places

LETTERS = frozenset("RLAPIS")
SIZE = 15  # points; scaled with Blender's interface
ALONG = 0.75  # cosine with the view above which letters lie in front of the volume and behind it
ALIKE = 0.7  # cosine in the picture above which of two axes only the one more across the view has letters
ASLANT = 1e-6  # of the most that a line faces a direction: lines along it, which no letter passes
APART = 0.04  # distance from the face, as a fraction of the box's length along that axis
FONT = 0  # Blender's own


def placed_letters(volume_object, part=None) -> list:
    """The letters of a volume and their places.

    Parameters
    ----------
    part : (8, 3) ndarray of float64, optional
        The corners of the box in world space, in the order of ``box.CORNERS``; left out, those of the volume.

    Returns
    -------
    list of (str, ndarray of shape (3,))
        One letter for each face of the box, and a point in world space just outside the face. Empty for a volume that
        is not in patient space.
    """
    corners = box.world_corners(volume_object) if part is None else part
    if volume_object.rle_splat.space != PATIENT or len(corners) == 0:
        return []
    axes = np.stack([corners[index] - corners[0] for index in (1, 2, 4)], axis=1)  # in the order of box.CORNERS
    own = np.eye(4)
    own[:3, :3] = np.linalg.pinv(np.array(volume_object.matrix_world)[:3, :3]) @ axes
    middle = corners.mean(axis=0)
    return [
        (letter, middle + side * axes[:, axis])
        for axis, letters in enumerate(face_letters(own))
        for letter, side in zip(letters, (-0.5 - APART, 0.5 + APART))
    ]


def letters_beside(corners: np.ndarray, middle: np.ndarray, axes: list) -> list:
    """The axes that have letters in a picture, which stand beside the volume: over it, they would name a part of it.

    Letters along whose axis the view looks are left out: A would lie on what is seen from the front.

    Parameters
    ----------
    corners : (n, 2) ndarray of float64
        Where the picture shows the corners of the volume's box.
    middle : (2,) ndarray of float64
    axes : list of (float, Vector)
        Of each axis the cosine with the view, and its direction in the picture.

    Returns
    -------
    list of (int, Vector, float)
        The axis, its direction, and how far the outline of the box is from its middle to that side and to the other.
    """
    found, corners = [], corners - middle
    # Of the lines through two corners, moved outward until all corners are behind them, the nearest are the outline.
    sides = (corners[:, None] - corners).reshape(-1, 2)[:, ::-1] * (1.0, -1.0)  # normals of the lines
    reach = np.abs(corners @ sides.T).max(axis=0)
    for n, (along, across) in sorted(enumerate(axes), key=lambda one: abs(one[1][0])):
        if abs(along) <= ALONG and all(abs(across.dot(other)) <= ALIKE for _, other, _ in found):
            facing = np.abs(sides @ np.array(across))
            ahead = facing > ASLANT * facing.max()
            found.append((n, across, float((reach[ahead] / facing[ahead]).min())))
    return found


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
    seen, middle = np.array(seen), Vector(corners.mean(axis=0).tolist())
    center = location_3d_to_region_2d(context.region, view, middle)
    if not (0.0 < center.x < context.region.width and 0.0 < center.y < context.region.height):
        return []
    sight = (view.view_matrix @ middle).normalized() if view.is_perspective else Vector((0.0, 0.0, -1.0))
    placed = placed_letters(owner)
    pairs, axes = list(zip(placed[::2], placed[1::2])), []
    for (_, first), (_, second) in pairs:
        axis = (view.view_matrix.to_3x3() @ Vector((second - first).tolist())).normalized()
        axes.append((axis.dot(sight), axis.to_2d().normalized()))
    found, space = [], SIZE * context.preferences.system.ui_scale
    for n, across, reach in letters_beside(seen, np.array(center), axes):
        for (letter, _), toward in zip(pairs[n], (-across, across)):
            found.append((letter, center + toward * (reach + space), toward.x))
    return found


HANDLERS = drawing.Handlers((_draw, "POST_PIXEL"))
