"""Hide Mesh: hide an object that lies before a volume, in viewports and in renders."""

import bpy
from bpy.props import StringProperty

from ..bridge import linked
from ..bridge.translations import filled
from .refusal import refuse


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
