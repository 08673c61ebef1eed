"""Delete Clip Object: remove an object that cuts the volume."""

import bpy
from bpy.props import StringProperty

from ..bridge.scene import clip_objects
from .refusal import needs, refuse


class RLE_SPLAT_OT_delete_clip(bpy.types.Operator):
    """Delete this clip object, so that it no longer cuts the volume"""

    bl_idname = "rle_splat.delete_clip"
    bl_label = "Delete Clip Object"
    bl_options = {"REGISTER", "UNDO"}

    name: StringProperty(name="Name", description="Name of a clip object of the scene")

    @classmethod
    def poll(cls, context):
        return needs(
            cls, clip_objects.clip_objects(context.scene), "The scene has no clip objects; add a box or a plane"
        )

    def execute(self, context):
        found = next((one for one in clip_objects.clip_objects(context.scene) if one.name == self.name), None)
        if found is None:
            return refuse(self, f"{self.name!r} is no clip object of this scene; choose one from the list.")
        if found.library is not None:
            return refuse(self, f"{self.name!r} is linked from another file; delete it there.")
        bpy.data.objects.remove(found)
        return {"FINISHED"}
