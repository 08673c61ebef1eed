"""Add Names of Segments: the names of the segments that are shown, with lines to them, as objects."""

import bpy
import numpy as np

from ..bridge.data.settings import scene_scale_of
from ..bridge.look import transfer
from ..bridge.scene.callouts import MARK, SEGMENT, find_places
from ..bridge.scene.clip_objects import read_clips
from ..bridge.translations import filled
from ..bridge.volumes import attached, labels, volumes
from ..rle_splat.effects.clips import half_spaces
from ..rle_splat.scene import RleSplatError
from ..rle_splat.segment.label_map import BACKGROUND
from .callout_objects import Callout, callouts_of, labels_in_picture, lay_out
from .reading import LoadsFirst
from .refusal import has_segments, refuses
from .through_camera import evaluated, has_volume_and_camera

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
        texts = {one.mark[1]: one.text for one in callouts_of(owner, scene, SEGMENT)}
        names = [Callout(texts.get(number) or _in_words(rows[number]), place, (SEGMENT, number))
                 for number, place in places.items()]  # fmt: skip
        lay_out(context, owner, [*names, *labels_in_picture(owner, scene)], edges)
        for one in list(scene.objects):  # the names of segments that are hidden now
            number = one.get(SEGMENT, BACKGROUND)
            if one.get(MARK) == owner.name and number not in (BACKGROUND, *places):
                bpy.data.objects.remove(one)
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


def _in_words(row) -> str:
    """The name of a segment as one reads it: ``kidney_left`` as "Left kidney", ``vertebrae_T12`` as "T12"."""
    words = row.label_name.replace("_", " ").split() or [str(row.label)]
    if len(words) > 1 and words[0].lower() in ("vertebrae", "vertebra"):
        words = words[1:]
    words.sort(key=lambda word: word not in ("left", "right"))  # the side first
    return words[0][0].upper() + " ".join(words)[1:]
