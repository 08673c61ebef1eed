"""The Shading panel: lights, shadows and the shading of the volume."""

import bpy

from ..bridge import volumes
from .places import Sidebar


class RLE_SPLAT_PT_shading(Sidebar, bpy.types.Panel):
    bl_label = "Shading"
    bl_idname = "RLE_SPLAT_PT_shading"
    bl_parent_id = "RLE_SPLAT_PT_transfer"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return volumes.volume_object(context) is not None

    def draw_header(self, context):
        self.layout.prop(volumes.volume_object(context).rle_splat, "use_shading", text="")

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        properties = volumes.volume_object(context).rle_splat
        settings = context.scene.rle_splat
        layout.prop(settings, "lighting")
        column = layout.column(align=True)
        column.active = settings.lighting == "SCENE"
        row = column.row()
        row.active = not settings.max_error  # with a maximum error shadows are left out
        row.prop(settings, "use_shadows")
        column.prop(settings, "use_world")
        row = layout.row()
        row.active = not settings.max_error
        row.prop(settings, "ambient_occlusion", text="Occlusion")  # the full name would be cut off
        layout.prop(settings, "use_mist")
        layout.operator("rle_splat.shadow_pass", icon="IMAGE_DATA")
        column = layout.column(align=True)
        column.active = properties.use_shading
        for name in ("ambient", "diffuse", "specular", "shininess", "highlight", "two_sided"):
            column.prop(properties, name)
        layout.prop(properties, "use_gradient_opacity")
        column = layout.column(align=True)
        column.active = properties.use_gradient_opacity
        for name in ("gradient_low", "gradient_high"):
            column.prop(properties, name)


CLASSES = (RLE_SPLAT_PT_shading,)
