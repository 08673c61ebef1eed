"""How much time a picture may take, and with what."""

import bpy

from ..bridge.settings import OF_PRE
from .places import RenderTab, Sidebar, paragraph

KNOBS = (
    "depth_rule", "sheet_density", "kernel", "minification", "warp_filter", "termination", "rays", "axis_fade", "model",
    "threads", "backend",
)
# Those that the plan of a picture to a maximum error decides.
PLANNED = ("depth_rule", "sheet_density", "warp_filter", "termination", "rays", "axis_fade")


def taken_away(scene) -> list[str]:
    """What the scene asks for that pictures to a Maximum Error have not."""
    settings = scene.rle_splat
    casts = settings.use_shadows and settings.lighting == "SCENE" and any(
        one.type == "LIGHT" and one.data.use_shadow and not one.hide_render for one in scene.objects)
    asked = {
        "shadows": casts, "ambient occlusion": settings.ambient_occlusion > 0.0,
        "motion blur": scene.render.use_motion_blur,
    }  # fmt: skip
    return [name for name, is_asked in asked.items() if is_asked]


class QualityPanel:
    """Drawn in both places."""

    bl_label = "Quality"

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.rle_splat
        layout.prop(settings, "mode")
        layout.prop(settings, "max_error")
        if settings.max_error and (lost := taken_away(context.scene)):
            paragraph(context, layout, f"Pictures to a Maximum Error have no {' and no '.join(lost)}.", "INFO")
        row = layout.row()
        row.active = not settings.max_error or settings.quality in ("paper", "custom")  # some of their knobs count
        row.prop(settings, "quality")
        column = layout.column()
        if settings.quality != "paper":
            column.prop(settings, "classification")
            if settings.classification == "refined":
                column.prop(settings, "refinement")
        for name in (*(KNOBS if settings.quality == "custom" else ()), "record"):
            row = column.row()
            # Greyed out, but not out of reach: choosing another value of these chooses pre.
            of_this = name not in OF_PRE or settings.classification != "post" or settings.quality == "paper"
            of_this = of_this and (name != "rays" or settings.classification == "post")  # which alone has them
            row.active = of_this and not (settings.max_error and name in PLANNED)
            row.prop(settings, name)
        layout.prop(settings, "scene_scale")
        layout.prop(settings, "meshes_occlude")


class RLE_SPLAT_PT_quality(QualityPanel, Sidebar, bpy.types.Panel):
    bl_idname = "RLE_SPLAT_PT_quality"
    bl_order = 2


class RLE_SPLAT_PT_render_quality(QualityPanel, RenderTab, bpy.types.Panel):
    bl_idname = "RLE_SPLAT_PT_render_quality"
    bl_parent_id = "RLE_SPLAT_PT_render"


CLASSES = (RLE_SPLAT_PT_quality,)  # the other is a child of a panel in picture.py and registered there
