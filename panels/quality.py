"""The Quality panel and its Advanced sub-panel: how accurate a picture is, and the time it takes."""

import bpy

from ..bridge.settings import OF_PRE
from .places import RenderTab, Sidebar, paragraph

KNOBS = (
    "depth_rule", "sheet_density", "kernel", "minification", "warp_filter", "termination", "rays", "axis_fade", "model",
)
MACHINE = ("record", "threads", "backend")  # count with every quality
# The knobs that the planner chooses when a maximum error is set.
PLANNED = ("depth_rule", "sheet_density", "warp_filter", "termination", "rays", "axis_fade")


def taken_away(scene) -> list[str]:
    """Names of the effects that the scene asks for and that pictures with a Maximum Error leave out."""
    settings = scene.rle_splat
    casts = settings.use_shadows and settings.lighting == "SCENE" and any(
        one.type == "LIGHT" and one.data.use_shadow and not one.hide_render for one in scene.objects)
    asked = {
        "shadows": casts, "ambient occlusion": settings.ambient_occlusion > 0.0,
        "motion blur": scene.render.use_motion_blur,
    }  # fmt: skip
    return [name for name, is_asked in asked.items() if is_asked]


class QualityPanel:
    """Draws the panel in the sidebar and in the render properties."""

    bl_label = "Quality"

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.rle_splat
        layout.prop(settings, "mode")
        layout.prop(settings, "max_error")
        if settings.max_error and (lost := taken_away(context.scene)):
            paragraph(context, layout, f"Pictures with a Maximum Error have no {' and no '.join(lost)}.", "INFO")
        row = layout.row()
        row.active = not settings.max_error or settings.quality in ("paper", "custom")  # some of their knobs count
        row.prop(settings, "quality")
        layout.prop(settings, "scene_scale")
        layout.prop(settings, "meshes_occlude")


class AdvancedPanel:
    """Draws the knobs for experts in both places, closed by default."""

    bl_label = "Advanced"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.rle_splat
        if settings.quality != "paper":
            layout.prop(settings, "classification")
            if settings.classification == "refined":
                layout.prop(settings, "refinement")
        for name in (*(KNOBS if settings.quality == "custom" else ()), *MACHINE):
            row = layout.row()
            # Inactive rows can still be edited: another value of one of OF_PRE switches the classification to pre.
            counts = name not in OF_PRE or settings.classification != "post" or settings.quality == "paper"
            counts = counts and (name != "rays" or settings.classification == "post")
            row.active = counts and not (settings.max_error and name in PLANNED)
            row.prop(settings, name)


class RLE_SPLAT_PT_quality(QualityPanel, Sidebar, bpy.types.Panel):
    bl_idname = "RLE_SPLAT_PT_quality"
    bl_order = 2


class RLE_SPLAT_PT_advanced(AdvancedPanel, Sidebar, bpy.types.Panel):
    bl_idname = "RLE_SPLAT_PT_advanced"
    bl_parent_id = "RLE_SPLAT_PT_quality"


class RLE_SPLAT_PT_render_quality(QualityPanel, RenderTab, bpy.types.Panel):
    bl_idname = "RLE_SPLAT_PT_render_quality"
    bl_parent_id = "RLE_SPLAT_PT_render"


class RLE_SPLAT_PT_render_advanced(AdvancedPanel, RenderTab, bpy.types.Panel):
    bl_idname = "RLE_SPLAT_PT_render_advanced"
    bl_parent_id = "RLE_SPLAT_PT_render_quality"


CLASSES = (RLE_SPLAT_PT_quality, RLE_SPLAT_PT_advanced)
RENDER_CLASSES = (RLE_SPLAT_PT_render_quality, RLE_SPLAT_PT_render_advanced)  # registered after their parent
