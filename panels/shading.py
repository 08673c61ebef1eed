"""The Lighting panel: what shines on the volume, and its material."""

import bpy

from ..bridge.data.automatic import draw_number
from ..bridge.data.settings import is_pre_classified
from ..bridge.scene import first_light, world_render
from ..bridge.scene.world import state as world_state
from ..bridge.volumes import encoded, volumes
from .places import OfVolume, paragraph


class RLE_SPLAT_PT_shading(OfVolume, bpy.types.Panel):
    bl_label = "Lighting"
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
            return
        layout.prop(properties, "lighting")
        unused = first_light.unused_lights(context.scene, properties.lighting)
        if unused:
            paragraph(context, layout, unused, icon="INFO")
        paragraph(context, layout, world_state(context.scene, properties.lighting), icon="WORLD")
        if world_render.is_needed(context.scene):
            layout.operator("rle_splat.update_world_light", icon="FILE_REFRESH")
        layout.prop(properties, "use_shading")
        column = layout.column()
        column.active = properties.use_shading and not is_pre_classified(settings)
        draw_number(column, properties, "smoothness", "use_automatic_smoothness", text="Smoothness")
        column = layout.column(align=True)
        column.active = properties.use_shading
        for name in ("ambient", "diffuse", "specular", "shininess", "highlight", "two_sided"):
            column.prop(properties, name)
