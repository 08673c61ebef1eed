"""The Lighting panel: what shines on the volume, and the shadows of the scene."""

import bpy

from ..bridge.data import effects
from ..bridge.data.settings import is_pre_classified
from ..bridge.scene import first_light, world_render
from ..bridge.scene.lights import any_casts_shadows, is_any_lit
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
        if encoded.is_of(owner):
            paragraph(context, layout, encoded.STORED_VALUES, icon="INFO")
        else:
            layout.operator_menu_enum("rle_splat.add_lights", "kind", icon="LIGHT")
            _draw_source(context, layout, owner.rle_splat)
        _draw_scene(context, layout)


def _draw_source(context, layout, properties) -> None:
    """Which lights shine on the volume, and what of the scene's lights and world is left out."""
    layout.prop(properties, "lighting")
    unused = first_light.unused_lights(context.scene, properties.lighting)
    if unused:
        paragraph(context, layout, unused, icon="INFO")
    paragraph(context, layout, world_state(context.scene, properties.lighting), icon="WORLD")
    if world_render.is_needed(context.scene):
        layout.operator("rle_splat.update_world_light", icon="FILE_REFRESH")


def _draw_scene(context, layout) -> None:
    """What all volumes of the scene share: shadows, the light from all sides and mist."""
    scene, settings = context.scene, context.scene.rle_splat
    is_pre, is_lit, casts = is_pre_classified(settings), is_any_lit(scene), any_casts_shadows(scene)
    has_shadows = not (settings.max_error and is_pre)
    layout.label(text="All Volumes")
    column = layout.column(align=True)
    column.enabled = is_lit
    row = column.row()
    row.enabled = has_shadows
    row.prop(settings, "use_shadows")
    row = column.split(factor=0.6)
    row.use_property_split = False  # the longer name would be cut off
    row.label(text="Shadows on Meshes")
    row.prop(settings.effect_overrides, effects.property_of(effects.SHADOWS_ON_MESHES), text="")
    for name in ("use_world", "use_mist"):
        column.prop(settings, name)
    column = layout.column(align=True)
    column.use_property_split = False  # the longer name would be cut off
    row = column.row(align=True)
    row.enabled = has_shadows
    row.prop(settings, "ambient_occlusion", slider=True)
    row.prop_decorator(settings, "ambient_occlusion")
    row = column.row(align=True)
    row.enabled = casts and not is_pre
    row.prop(settings, "indirect_light", slider=True)
    row.prop_decorator(settings, "indirect_light")
    if is_lit and not casts:
        paragraph(context, column, "Scattering needs a light that casts shadows", icon="INFO")
    elif is_lit and is_pre:
        paragraph(context, column, "Scattering needs Interpolate: Values in Advanced", icon="INFO")
