"""Add Names of Segments: the names of the segments that are shown, with lines to them, as objects."""

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..bridge.data.settings import scene_scale_of
from ..bridge.live import letters, slices
from ..bridge.look import transfer
from ..bridge.scene.callouts import find_places, split, spread
from ..bridge.scene.clip_objects import read_clips
from ..bridge.translations import filled
from ..bridge.volumes import attached, box, labels, volumes
from ..rle_splat.effects.clips import half_spaces
from ..rle_splat.scene import RleSplatError
from ..rle_splat.segment.label_map import BACKGROUND
from .letter_objects import add_object, depths_of, new_emission, new_text, plane_before
from .reading import LoadsFirst
from .refusal import has_segments, refuses
from .through_camera import evaluated, has_volume_and_camera

# Shares of the picture's height: size of a name, distance from name to name, space beside a name, and a line's width.
SIZE, STEP, SPACE, LINE = 0.03, 0.05, 0.012, 0.0018
BALL, BALL_STEPS = 4.5, 17  # the ball at the end of a line: widths of the line, and points of its profile
WIDE = 0.45  # of a letter, in sizes of the text
MOST = 4_000_000  # voxels that are looked at; of larger maps every second one, third one and so on
CELL = 1.5  # side of the squares in which a voxel hides others, in distances of voxels


class RLE_SPLAT_OT_add_names(LoadsFirst, bpy.types.Operator):
    """Add the names of the segments that are shown, each with a line to what the camera sees of it, as objects that
    turn with the camera. Click again after a change: texts that you have edited are kept"""

    bl_idname = "rle_splat.add_names"
    bl_label = "Add Names of Segments"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return has_volume_and_camera(cls, context) and has_segments(cls, context)

    @refuses
    def execute(self, context):
        owner, scene = volumes.volume_object(context), context.scene
        frame = scene.camera.matrix_world.normalized()
        rows = {row.label: row for row in owner.rle_splat.labels if row.show and row.label != BACKGROUND}
        if not rows:
            raise RleSplatError("No segment is shown; show those that are to have a name by their eyes.")
        high, _, low, _ = scene.camera.data.view_frame(scene=scene)
        places, edges = _find_places(context, owner, rows, frame, np.array((low[:2], high[:2])))
        if not places:
            raise RleSplatError("The camera sees none of the segments that are shown; turn it to them.")
        tall = high.y - low.y
        room = 2 * int(0.95 / STEP)
        if len(places) > room:
            raise RleSplatError(
                f"{len(places)} segments are shown, and a picture has room for {room} names; hide some."
            )
        before = [one for one in scene.objects if letters.SEGMENT in one and one.get(letters.MARK) == owner.name]
        bodies = {one[letters.SEGMENT]: one.data.body for one in before if one.type == "FONT"}
        for one in before:
            bpy.data.objects.remove(one)
        bodies = {number: bodies.get(number) or _in_words(rows[number]) for number in places}
        edges = _widen(edges, owner, scene, frame, (low.x, high.x))
        plane = plane_before(scene, frame, depths_of(frame, box.world_corners(owner)))
        taken = [_in_picture(one.matrix_world.translation, scene, frame)[:2] for one in _letters_of(owner, scene)]
        material = new_emission()
        for column, toward, edge, end in zip(split(places), (-1.0, 1.0), edges, (low.x, high.x)):
            wide = max((len(bodies[number]) for number in column), default=0) * WIDE * SIZE * tall
            x = toward * min(toward * edge + 3.0 * SPACE * tall, toward * end - 2.0 * SPACE * tall - wide)
            own = [one for one in taken if one[0] * toward > 0.0]
            heights = spread(column, places, x, low.y + STEP * tall, high.y - STEP * tall, STEP * tall, own)
            for number, y in heights.items():
                text = new_text(bodies[number], "RIGHT" if toward < 0.0 else "LEFT")
                at = plane @ Matrix.Translation((x + toward * SPACE * tall, y, 0.0)) @ Matrix.Scale(SIZE * tall, 4)
                line = _line((x, y), places[number], LINE * tall)
                for name, data, matrix in ((bodies[number], text, at), (f"Line to {bodies[number]}", line, plane)):
                    one = add_object(context, name, data, material, owner, scene.camera, matrix)
                    one[letters.SEGMENT] = number
        if left := len(rows) - len(places):
            said = filled("{number} segments that are shown are not in the picture.", number=left)
            self.report({"INFO"}, said)
        return {"FINISHED"}


def _find_places(context, owner, rows, frame, ends) -> tuple[dict, tuple[float, float]]:
    """For each segment in the picture the place that its line leads to, and the left and right end of all of them.

    ``ends``: the lowest and the highest x and y of the picture, in the plane of ``view_frame``.
    """
    depsgraph, camera = evaluated(context, owner), context.scene.camera.data
    volume = volumes.load_volume(owner, depsgraph=depsgraph)
    found = labels.read_labels(owner, depsgraph, volume, transfer.read_transfer(owner, depsgraph))
    map_of = found.volume.voxels
    stride = int(np.ceil((map_of.size / MOST) ** (1.0 / 3.0)))
    index = np.argwhere(np.isin(map_of[::stride, ::stride, ::stride], list(rows))) * stride
    numbers, index = map_of[tuple(index.T)], index[:, ::-1].astype(np.float64)
    to_world = attached.volume_frame(volume, owner, scene_scale_of(context.scene, volume.unit))
    for clip in read_clips(depsgraph, owner):
        sides = half_spaces(clip, to_world)
        inside = (index @ sides[:, :3].T + sides[:, 3] <= 0.0).all(axis=1)
        kept = ~inside if clip.kind == "box" and clip.keep == "outside" else inside
        numbers, index = numbers[kept], index[kept]
    to_camera = np.array(frame.inverted(), np.float64) @ to_world
    points = index @ to_camera[:3, :3].T + to_camera[:3, 3]
    cell = CELL * stride * np.linalg.norm(to_camera[:3, :3], axis=0).max()
    if camera.type != "ORTHO":
        away = camera.view_frame(scene=context.scene)[2].z
        before = points[:, 2] < 0.0
        numbers, points = numbers[before], points[before]
        points[:, :2] *= away / points[:, 2:]
        cell *= away / points[:, 2].mean() if len(points) else 1.0
    places = points[:, :2]
    shown = ((places > ends[0]) & (places < ends[1])).all(axis=1)
    if not shown.any():
        return {}, (0.0, 0.0)
    places = places[shown]
    found = find_places(numbers[shown], places, -points[shown, 2], cell)
    return found, (places[:, 0].min(), places[:, 0].max())


def _in_picture(point, scene, frame) -> Vector:
    """A point of the world in the plane of ``view_frame``."""
    place = frame.inverted() @ point
    if scene.camera.data.type != "ORTHO":
        place *= scene.camera.data.view_frame(scene=scene)[2].z / min(place.z, -scene.camera.data.clip_start)
    return place


def _letters_of(owner, scene) -> list:
    """The orientation letters and the scale bar's length of a volume."""
    return [one for one in scene.objects
            if one.type == "FONT" and one.get(letters.MARK) == owner.name and letters.SEGMENT not in one]  # fmt: skip


def _widen(edges, owner, scene, frame, ends) -> tuple[float, float]:
    """The left and right end of the segments and of slices and letters beside them, so that names stand beyond all.

    ``ends``: the lowest and the highest x of the picture.  What is cut off there does not count.
    """
    points = [one.matrix_world.translation for one in _letters_of(owner, scene) if one.data.body in letters.LETTERS]
    for one in slices.slice_objects(scene):
        if slices.volume_of(one) == owner and not one.hide_render:
            points += (one.matrix_world @ Vector(corner) for corner in one.bound_box)
    across = [_in_picture(point, scene, frame).x for point in points]
    across = [x for x in across if ends[0] < x < ends[1]]
    return min((edges[0], *across)), max((edges[1], *across))


def _in_words(row) -> str:
    """The name of a segment as one reads it: ``kidney_left`` as "Left kidney", ``vertebrae_T12`` as "T12"."""
    words = row.label_name.replace("_", " ").split() or [str(row.label)]
    if len(words) > 1 and words[0].lower() in ("vertebrae", "vertebra"):
        words = words[1:]
    words.sort(key=lambda word: word not in ("left", "right"))  # the side first
    return words[0][0].upper() + " ".join(words)[1:]


def _line(begin, end, width: float):
    """A straight line in the plane z = 0, as round as ``width``, with a ball at its end."""
    curve = bpy.data.curves.new("Line", "CURVE")
    curve.dimensions, curve.bevel_depth = "3D", 0.5 * width
    spline, ball = curve.splines.new("POLY"), curve.splines.new("POLY")
    spline.points.add(1)
    for point, place in zip(spline.points, (begin, end)):
        point.co = (*Vector(place).to_3d(), 1.0)
    along = np.linspace(-1.0, 1.0, BALL_STEPS)
    ball.points.add(BALL_STEPS - 1)
    for point, share in zip(ball.points, along):
        point.co = (end[0], end[1] + share * 0.5 * BALL * width, 0.0, 1.0)
        point.radius = BALL * np.sqrt(1.0 - share**2)
    return curve
