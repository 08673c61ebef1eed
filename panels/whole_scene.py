"""The Whole Scene panel: shadows, the world's light, mist and scale, which all volumes of a scene share."""

import bpy

from ..bridge.data import effects
from ..bridge.data.settings import is_pre_classified
from ..bridge.scene.lights import is_any_lit
from .places import RenderTab, Sidebar


class ScenePanel:
    """Draws the panel in the sidebar and in the render properties."""

    bl_label = "Whole Scene"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, settings = self.layout, context.scene.rle_splat
        layout.use_property_split = True
        layout.use_property_decorate = False
        has_shadows, is_lit = not settings.max_error or not is_pre_classified(settings), is_any_lit(context.scene)
        column = layout.column(align=True)
        column.active = is_lit
        row = column.row()
        row.active = has_shadows
        row.prop(settings, "use_shadows")
        column.prop(settings.effect_overrides, effects.property_of(effects.SHADOWS_ON_MESHES), text="On Meshes")
        column.prop(settings, "use_world")
        column = layout.column(align=True)
        column.use_property_split = False  # the longer name would be cut off
        row = column.row(align=True)
        row.active = has_shadows
        row.prop(settings, "ambient_occlusion", slider=True)
        row = column.row(align=True)
        row.active = is_lit and settings.use_shadows and not is_pre_classified(settings)
        row.prop(settings, "indirect_light", slider=True)
        layout.prop(settings, "use_mist")
        row = layout.row(heading="Meshes")  # the name in one would be cut off
        row.prop(settings, "meshes_occlude", text="Hide Volume")
        layout.prop(settings, "scene_scale")


class RLE_SPLAT_PT_whole_scene(ScenePanel, Sidebar, bpy.types.Panel):
    bl_parent_id = "RLE_SPLAT_PT_picture"


class RLE_SPLAT_PT_render_whole_scene(ScenePanel, RenderTab, bpy.types.Panel):
    bl_parent_id = "RLE_SPLAT_PT_render"
