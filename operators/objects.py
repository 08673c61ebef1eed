"""Objects of the scene: choose a volume or a cutting object, delete a cutting object, hide what covers a volume."""

import bpy
from bpy.props import StringProperty

from ..bridge import linked
from ..bridge.live import cut_slices
from ..bridge.scene import clip_objects
from ..bridge.translations import filled
from .placing import select_alone
from .refusal import needs, refuse


class RLE_SPLAT_OT_choose_object(bpy.types.Operator):
    """Select only this object and make it active"""

    bl_idname = "rle_splat.choose_object"
    bl_label = "Choose Object"
    bl_options = {"REGISTER", "UNDO"}

    name: StringProperty(name="Name", description="Name of an object of the scene")

    @classmethod
    def poll(cls, context):
        return needs(cls, context.mode == "OBJECT", "Switch to Object Mode first")

    def execute(self, context):
        chosen = context.view_layer.objects.get(self.name)
        if chosen is None:
            return refuse(self, f"{self.name!r} is not in this view layer; include its collection in the Outliner.")
        select_alone(context, chosen)
        return {"FINISHED"}


class RLE_SPLAT_OT_delete_cutting_object(bpy.types.Operator):
    """Delete this cutting object, so that it no longer cuts the volume"""

    bl_idname = "rle_splat.delete_cutting_object"
    bl_label = "Delete Cutting Object"
    bl_options = {"REGISTER", "UNDO"}

    name: StringProperty(name="Name", description="Name of a cutting object of the scene")

    @classmethod
    def poll(cls, context):
        return needs(
            cls, clip_objects.clip_objects(context.scene), "The scene has no cutting objects; add a box or a plane"
        )

    def execute(self, context):
        found = next((one for one in clip_objects.clip_objects(context.scene) if one.name == self.name), None)
        if found is None:
            return refuse(self, f"{self.name!r} is no cutting object of this scene; choose one from the list.")
        if found.library is not None:
            return refuse(self, f"{self.name!r} is linked from another file; delete it there.")
        for one in cut_slices.slices_of(context.scene, found):
            cut_slices.remove(one)
        bpy.data.objects.remove(found)
        return {"FINISHED"}


class RLE_SPLAT_OT_hide_mesh(bpy.types.Operator):
    """Hide the object that covers the volume, in viewports and in renders"""

    bl_idname = "rle_splat.hide_mesh"
    bl_label = "Hide Mesh"
    bl_options = {"REGISTER", "UNDO"}

    mesh: StringProperty(name="Object", description="Name of the object", options={"SKIP_SAVE"})

    def execute(self, context):
        one = context.view_layer.objects.get(self.mesh)
        if one is None:
            return refuse(self, f"There is no object {self.mesh!r} in this view layer; give the name of one.")
        one.hide_set(True)
        if linked.is_own(one):
            one.hide_render = True
        self.report({"INFO"}, filled("{mesh} is hidden in viewports and renders.", mesh=one.name))
        return {"FINISHED"}
