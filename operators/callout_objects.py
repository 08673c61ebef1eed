"""Texts beside a picture with lines to what they name, as objects: names of segments, and labels of points."""

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..bridge.live import letters, slices
from ..bridge.scene.callouts import MARK, POINT
from ..bridge.volumes import box
from ..rle_splat.figure.callouts import split, spread
from ..rle_splat.scene import RleSplatError
from .letter_objects import add_object, depths_of, new_emission, new_shape, new_text, plane_before

# Shares of the picture's height: size of a text, distance from text to text, space beside a text, and a line's width.
SIZE, STEP, SPACE, LINE = 0.03, 0.05, 0.012, 0.0018
EDGE, DOT = 0.75, 2.25  # widths of a line: its dark edge, and the radius of the dot at its end
CORNERS = 32  # of a dot
WIDE = 0.45  # of a letter, in sizes of the text


@dataclass(frozen=True)
class Callout:
    """A text and the place in the plane of ``view_frame`` to which its line leads.

    ``mark``: the custom property that says what it is, ``SEGMENT`` or ``POINT``, and its value.
    """

    text: str
    place: np.ndarray
    mark: tuple


def callouts_of(owner, scene, kind: str) -> list[Callout]:
    """The callouts of a volume with a mark of one kind, as they are, also where a user has changed their texts."""
    found = []
    for one in scene.objects:
        if one.type == "FONT" and kind in one and one.get(MARK) == owner.name:
            line = next((other for other in scene.objects if other.type == "CURVE" and _same(one, other, kind)), None)
            if line is not None:
                found.append(Callout(one.data.body, end_of(line.data), (kind, one[kind])))
    return found


def _same(one, other, kind: str) -> bool:
    """Whether two objects have the same mark of a kind."""
    return kind in other and other.get(MARK) == one[MARK] and _plain(one[kind]) == _plain(other[kind])


def _plain(mark):
    """A mark that can be compared: Blender gives arrays as objects of their own."""
    return mark.to_list() if hasattr(mark, "to_list") else mark


def labels_in_picture(owner, scene) -> list[Callout]:
    """The labels of a volume's points that the camera's picture shows, each with its place in it."""
    found = (place_label(one.text, owner, scene, one.mark[1]) for one in callouts_of(owner, scene, POINT))
    return [one for one in found if one is not None]


def place_label(text: str, owner, scene, point) -> Callout | None:
    """The label of a point, in the space of the volume's object; None where the picture does not show the point."""
    frame, (high, _, low, _) = scene.camera.matrix_world.normalized(), scene.camera.data.view_frame(scene=scene)
    world = owner.matrix_world @ Vector(point)
    place = np.array(in_picture(world, scene, frame)[:2])
    is_ahead = (frame.inverted() @ world).z < 0.0
    if not is_ahead or (place <= low[:2]).any() or (place >= high[:2]).any():
        return None
    return Callout(text, place, (POINT, [*point]))


def lay_out(context, owner, callouts: list, edges) -> None:
    """Write callouts on both sides of what they name, in place of those of the volume with the same marks.

    Parameters
    ----------
    callouts : list of Callout
    edges : (left, right) of float
        Ends of what is named, in the plane of ``view_frame``; the texts stand beyond them.

    Raises
    ------
    RleSplatError
        If the picture has no room for so many.
    """
    scene = context.scene
    frame = scene.camera.matrix_world.normalized()
    high, _, low, _ = scene.camera.data.view_frame(scene=scene)
    tall, room = high.y - low.y, 2 * int(0.95 / STEP)
    step = STEP * tall
    if len(callouts) > room:
        raise RleSplatError(f"{len(callouts)} names are shown, and a picture has room for {room}; hide or delete some.")
    marks = [(kind, _plain(value)) for kind, value in (one.mark for one in callouts)]
    for one in list(scene.objects):
        if one.get(MARK) == owner.name and any(kind in one and _plain(one[kind]) == of for kind, of in marks):
            bpy.data.objects.remove(one)
    edges = _widen(edges, owner, scene, frame, (low.x, high.x))
    plane = plane_before(scene, frame, depths_of(frame, box.world_corners(owner)))
    taken = [in_picture(one.matrix_world.translation, scene, frame)[:2] for one in _letters_of(owner, scene)]
    material = new_emission()
    places = {number: one.place for number, one in enumerate(callouts)}
    for column, toward, edge, end in zip(split(places), (-1.0, 1.0), edges, (low.x, high.x)):
        wide = max((len(callouts[number].text) for number in column), default=0) * WIDE * SIZE * tall
        x = toward * min(toward * edge + 3.0 * SPACE * tall, toward * end - 2.0 * SPACE * tall - wide)
        own = [one for one in taken if one[0] * toward > 0.0]
        heights = spread(column, places, x, low.y + 0.5 * step, high.y - 0.5 * step, dict.fromkeys(column, step), own)
        for number, y in heights.items():
            body, (kind, value) = callouts[number].text, callouts[number].mark
            text = new_text(body, "RIGHT" if toward < 0.0 else "LEFT")
            at = plane @ Matrix.Translation((x + toward * SPACE * tall, y, 0.0)) @ Matrix.Scale(SIZE * tall, 4)
            line = _line((x, y), places[number], LINE * tall)
            for name, data, matrix in ((body, text, at), (f"Line to {body}", line, plane)):
                add_object(context, name, data, material, owner, scene.camera, matrix)[kind] = value


def in_picture(point, scene, frame) -> Vector:
    """A point of the world in the plane of ``view_frame``."""
    place = frame.inverted() @ point
    if scene.camera.data.type != "ORTHO":
        place *= scene.camera.data.view_frame(scene=scene)[2].z / min(place.z, -scene.camera.data.clip_start)
    return place


def _letters_of(owner, scene) -> list:
    """The orientation letters and the scale bar's length of a volume."""
    return [one for one in scene.objects if one.type == "FONT" and letters.is_letter(one, owner)]


def _widen(edges, owner, scene, frame, ends) -> tuple[float, float]:
    """The left and right end of what is named and of slices beside it, so that texts stand beyond both.

    ``ends``: the lowest and the highest x of the picture.  What is cut off there does not count.
    """
    points = []
    for one in slices.slice_objects(scene):
        if slices.volume_of(one) == owner and not (one.hide_render or slices.is_on_cut(one)):
            points += (one.matrix_world @ Vector(corner) for corner in one.bound_box)
    across = [in_picture(point, scene, frame).x for point in points]
    across = [x for x in across if ends[0] < x < ends[1]]
    return min((edges[0], *across)), max((edges[1], *across))


def _line(begin, end, width: float):
    """A straight line in the plane z = 0 with a dot at its end, both with a dark edge."""
    begin, end = np.array(begin), np.array(end)
    along = (end - begin) / np.linalg.norm(end - begin)
    side = 0.5 * width * np.array((-along[1], along[0]))
    touch = end - DOT * width * along  # outlines that overlap would leave a hole
    angles = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
    dot = end + DOT * width * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    return new_shape("Line", EDGE * width, (begin + side, begin - side, touch - side, touch + side), dot)


def end_of(line) -> np.ndarray:
    """The middle of the dot at the end of a line, (2,)."""
    return np.mean([point.co[:2] for point in line.splines[1].points], axis=0)
