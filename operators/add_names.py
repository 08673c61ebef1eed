"""Add Names of Segments: the names of the segments that are shown, with lines to them, as objects."""

import bpy
import numpy as np
from mathutils import Vector

from ..bridge.scene import render_scene
from ..bridge.scene.callouts import MARK, POINT, SEGMENT
from ..bridge.translations import filled
from ..bridge.volumes import volumes
from ..rle_splat.figure.names import find_segments
from ..rle_splat.figure.plan import Name
from ..rle_splat.figure.words import in_words
from ..rle_splat.scene import RleSplatError
from ..rle_splat.segment.label_map import BACKGROUND
from .callout_objects import Callout, callouts_of, labels_in_picture, lay_out
from .reading import LoadsFirst
from .refusal import has_segments, refuses
from .through_camera import evaluated, has_volume_and_camera


class RLE_SPLAT_OT_add_names(LoadsFirst, bpy.types.Operator):
    """Add the names of the segments that are shown, each with a line to what the camera sees of it, as objects that
    turn with the camera. Click again after a change: texts that you have edited stay"""

    bl_idname = "rle_splat.add_names"
    bl_label = "Add Names of Segments"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return has_volume_and_camera(cls, context) and has_segments(cls, context)

    @refuses
    def execute(self, context):
        owner, scene = volumes.volume_object(context), context.scene
        shown = {one.label for one in names_of(owner, scene) if one.point is None}
        if not shown:
            raise RleSplatError("No segment is shown; show those that are to have a name by their eyes.")
        plain, _ = render_scene.read_scene(owner, evaluated(context, owner), with_meshes=False)
        places, edges = find_segments(plain, shown)
        if not places:
            raise RleSplatError("The camera sees none of the segments that are shown; turn it to them.")
        high, _, low, _ = scene.camera.data.view_frame(scene=scene)
        begin, pixel = np.array(low[:2]), np.array((high - low)[:2]) / (plain.width, plain.height)
        places = {number: begin + pixel * place for number, place in places.items()}
        edges = tuple(low.x + pixel[0] * end for end in edges)
        names = [Callout(one.text, places[one.label], (SEGMENT, one.label))
                 for one in names_of(owner, scene) if one.label in places]  # fmt: skip
        lay_out(context, owner, [*names, *labels_in_picture(owner, scene)], edges)
        for one in list(scene.objects):  # the names of segments that are hidden now
            number = one.get(SEGMENT, BACKGROUND)
            if one.get(MARK) == owner.name and number not in (BACKGROUND, *places):
                bpy.data.objects.remove(one)
        if left := len(shown) - len(places):
            said = filled("{number} segments that are shown are not in the picture.", number=left)
            self.report({"INFO"}, said)
        return {"FINISHED"}


def names_of(owner, scene) -> tuple[Name, ...]:
    """The names of the segments of a volume that are shown, and of its points, with the texts of their objects."""
    texts = {one.mark[1]: one.text for one in callouts_of(owner, scene, SEGMENT)}
    shown = (row for row in owner.rle_splat.labels if row.show and row.label != BACKGROUND)
    named = [Name(texts.get(row.label) or _text(row), row.label) for row in shown]
    of_points = ((one.text, owner.matrix_world @ Vector(one.mark[1])) for one in callouts_of(owner, scene, POINT))
    return *named, *(Name(text, point=tuple(point)) for text, point in of_points)


def _text(row) -> str:
    """The name of a segment's row in words, or its number."""
    return in_words(row.label_name) if row.label_name.strip(" _") else str(row.label)
