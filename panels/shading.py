"""The Lighting panel: lights, shadows and the material of the volume."""

import bpy

from ..bridge.data import effects
from ..bridge.data.automatic import draw_number
from ..bridge.data.settings import is_pre_classified
from ..bridge.scene import first_light, world_render
from ..bridge.scene.world import state as world_state
from ..bridge.volumes import encoded, volumes
from .places import OfVolume, paragraph


class RLE_SPLAT_PT_shading(OfVolume, bpy.types.Panel):
    bl_label = "Lighting"
    bl_idname = "RLE_SPLAT_PT_shading"
    bl_order = 3
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        owner = volumes.volume_object(context)
        properties = owner.rle_splat
        settings = context.scene.rle_splat
        if encoded.is_of(owner):
            paragraph(context, layout, encoded.STORED_VALUES, icon="INFO")
            layout.prop(settings, "use_mist")
            return
        has_shadows = not settings.max_error or not is_pre_classified(settings)
        layout.prop(settings, "lighting")
        unused = first_light.unused_lights(context.scene)
        if unused:
            paragraph(context, layout, unused, icon="INFO")
        column = layout.column(align=True)
        column.active = settings.lighting == "SCENE"
        row = column.row()
        row.active = has_shadows
        row.prop(settings, "use_shadows")
        column.prop(settings.effect_overrides, effects.property_of(effects.SHADOWS_ON_MESHES), text="On Meshes")
        column.prop(settings, "use_world")
        paragraph(context, layout, world_state(context.scene), icon="WORLD")
        if world_render.is_needed(context.scene):
            layout.operator("rle_splat.update_world_light", icon="FILE_REFRESH")
        row = layout.row()
        row.active = has_shadows
        row.prop(settings, "ambient_occlusion", text="Occlusion")  # the full name would be cut off
        row = layout.row()
        row.active = settings.lighting == "SCENE" and settings.use_shadows and not is_pre_classified(settings)
        row.prop(settings, "indirect_light", text="Indirect")
        layout.prop(settings, "use_mist")
        layout.prop(properties, "use_shading")
        column = layout.column()
        column.active = properties.use_shading and not is_pre_classified(settings)
        draw_number(column, properties, "smoothness", "use_automatic_smoothness", text="Smoothness")
        column = layout.column(align=True)
        column.active = properties.use_shading
        for name in ("ambient", "diffuse", "specular", "shininess", "highlight", "two_sided"):
            column.prop(properties, name)


CLASSES = (RLE_SPLAT_PT_shading,)
