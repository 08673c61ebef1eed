"""Name Structure and Add Name: a text and a line to a point of the volume, as objects that renders show."""

import bpy
import numpy as np
from bpy.props import FloatVectorProperty, StringProperty
from mathutils import Vector

from ..bridge.scene.callouts import SEGMENT
from ..bridge.volumes import volumes
from ..rle_splat.scene import RleSplatError
from .add_cutting_object import visible_corners
from .callout_objects import callouts_of, in_picture, labels_in_picture, lay_out, place_label
from .picking import PicksSurface
from .reading import LoadsFirst
from .refusal import refuses
from .through_camera import has_volume_and_camera


class RLE_SPLAT_OT_name_structure(PicksSurface, bpy.types.Operator):
    """Click on a structure of the volume in a 3D viewport, and type its name: a text and a line to it, as objects that
    turn with the camera"""

    bl_idname = "rle_splat.name_structure"
    bl_label = "Name Structure"
    bl_options = set()

    for_scripts = "This needs a click in a window; scripts use add_name with a point and a text."
    poll = classmethod(has_volume_and_camera)

    def pick(self, found):
        bpy.ops.rle_splat.add_name("INVOKE_DEFAULT", point=found.surface.world)


class RLE_SPLAT_OT_add_name(LoadsFirst, bpy.types.Operator):
    """Add a text and a line to a point of the volume, and place the other names for the camera again"""

    bl_idname = "rle_splat.add_name"
    bl_label = "Add Name"
    bl_options = {"REGISTER", "UNDO"}

    text: StringProperty(name="Text", description="What is written beside the picture", options={"SKIP_SAVE"})
    point: FloatVectorProperty(
        name="Point", description="Where the line leads, in world space", subtype="XYZ", options={"SKIP_SAVE"}
    )

    poll = classmethod(has_volume_and_camera)

    def invoke(self, context, event):
        if context.window is None or bpy.app.background:
            return super().invoke(context, event)
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, _context):
        row = self.layout.row()
        row.activate_init = True  # the text can be typed at once
        row.prop(self, "text")

    @refuses
    def execute(self, context):
        owner, scene = volumes.volume_object(context), context.scene
        text = " ".join(self.text.split())
        if not text:
            raise RleSplatError("The name is empty; type what is to stand beside the picture.")
        label = place_label(text, owner, scene, owner.matrix_world.inverted() @ Vector(self.point))
        if label is None:
            raise RleSplatError("The camera does not see the point; turn it to the point, or click on another one.")
        frame, (high, _, low, _) = scene.camera.matrix_world.normalized(), scene.camera.data.view_frame(scene=scene)
        across = [in_picture(Vector(corner), scene, frame).x for corner in visible_corners(owner, scene).tolist()]
        edges = np.clip((min(across), max(across)), low.x, high.x)
        names = callouts_of(owner, scene, SEGMENT)
        lay_out(context, owner, [*names, *labels_in_picture(owner, scene), label], edges)
        return {"FINISHED"}
