"""Add Letters and Scale Bar: what viewports draw over a volume, as objects, which renders show too."""

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..bridge.data.settings import scene_scale_of
from ..bridge.live import bars, letters
from ..bridge.volumes import box, volumes
from .letter_objects import EDGE, add_object, depths_of, new_emission, new_shape, new_text, plane_before
from .reading import LoadsFirst
from .refusal import refuse
from .through_camera import has_volume_and_camera

SIZE, LONGEST, MARGIN = 0.036, 0.25, 0.04  # of a letter, of the bar and of the space beside it, shares of the picture
HALF = 0.4  # of a letter's width beside a second one, in its size


class RLE_SPLAT_OT_add_letters(LoadsFirst, bpy.types.Operator):
    """Add orientation letters at the edges of the picture, and a scale bar, as objects that renders show. They turn to
    the camera. In perspective, the bar is true at the depth of the volume's middle. Click again after a change"""

    bl_idname = "rle_splat.add_letters"
    bl_label = "Add Letters and Scale Bar"
    bl_options = {"REGISTER", "UNDO"}

    poll = classmethod(has_volume_and_camera)

    def execute(self, context):
        owner, scene, camera = volumes.volume_object(context), context.scene, context.scene.camera
        frame = camera.matrix_world.normalized()
        depths = depths_of(frame, box.world_corners(owner))
        if not depths or min(depths) + max(depths) <= 0.0:
            return refuse(self, "The camera does not see the volume; turn it to the volume.")
        for one in [one for one in scene.objects if letters.is_letter(one, owner)]:
            bpy.data.objects.remove(one)
        material = new_emission()
        for name, data, parent, matrix in (*_letters(owner, scene, frame), *_bar(owner, scene, frame, depths)):
            one = add_object(context, name, data, material, owner, parent, matrix)
            if parent == owner:
                one.constraints.new("COPY_ROTATION").target = camera
        return {"FINISHED"}


def _letters(owner, scene, frame):
    """Yield name, text, parent and matrix of each letter.

    They stand at the edges of the picture, at the depth of the volume's middle, and move with the volume.
    """
    middle = sum((frame.inverted() @ Vector(corner) for corner in box.world_corners(owner)), Vector()) / 8
    high, _, low, _ = scene.camera.data.view_frame(scene=scene)
    if middle.z > 0.0:  # behind the camera
        return
    away = 1.0 if scene.camera.data.type == "ORTHO" else middle.z / low.z
    size = SIZE * (high.y - low.y) * away
    turn = frame.to_3x3().to_4x4() @ Matrix.Scale(size, 4)
    for text, toward in letters.letters_of_sides(owner, np.array(frame.to_3x3()).T[:2]):
        inward = size * (1.0 + HALF * (len(text) - 1) * abs(toward.x))
        across, half = 0.5 * away * (high + low), 0.5 * away * (high - low)
        place = Vector((across.x + toward.x * (half.x - inward), across.y + toward.y * (half.y - inward), middle.z))
        yield text, new_text(text), owner, Matrix.Translation(frame @ place) @ turn


def _bar(owner, scene, frame, depths):
    """Yield name, curve or text, parent and matrix of a bar and of its length, at the lower left before the volume."""
    high, _, low, _ = scene.camera.data.view_frame(scene=scene)
    in_perspective = scene.camera.data.type != "ORTHO"
    a_unit = scene_scale_of(scene, owner.rle_splat.length_unit)  # of length in the middle of the volume, as seen
    if in_perspective:
        a_unit *= -2.0 * low.z / (min(depths) + max(depths))
    width, size = high.x - low.x, SIZE * (high.y - low.y)
    length = bars.length_of_bar(a_unit, LONGEST * width)
    corner = plane_before(scene, frame, depths)
    corner @= Matrix.Translation((low.x + MARGIN * width, low.y + MARGIN * width, 0.0))
    unit = length * a_unit
    height = 0.15 * size / unit
    bar = new_shape("Scale Bar", EDGE * size / unit, ((0, 0), (1, 0), (1, height), (0, height)))
    yield "Scale Bar", bar, scene.camera, corner @ Matrix.Scale(unit, 4)
    title = f"{length:g} {owner.rle_splat.length_unit}"
    above = Matrix.Translation((0.0, 0.9 * size, 0.0)) @ Matrix.Scale(0.85 * size, 4)
    yield title, new_text(title, "LEFT"), scene.camera, corner @ above
