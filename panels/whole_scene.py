"""The Whole Scene panel: mist, meshes and scale, which all volumes of a scene share."""

import bpy

from .places import RenderTab, Sidebar


class ScenePanel:
    """Draws the panel in the sidebar and in the render properties."""

    bl_label = "Whole Scene"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, settings = self.layout, context.scene.rle_splat
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(settings, "use_mist")
        row = layout.row(heading="Meshes")  # the name in one would be cut off
        row.prop(settings, "meshes_occlude", text="Hide Volume")
        layout.prop(settings, "scene_scale")


class RLE_SPLAT_PT_whole_scene(ScenePanel, Sidebar, bpy.types.Panel):
    bl_parent_id = "RLE_SPLAT_PT_picture"


class RLE_SPLAT_PT_render_whole_scene(ScenePanel, RenderTab, bpy.types.Panel):
    bl_parent_id = "RLE_SPLAT_PT_render"
