"""How much time a picture may take, and with what."""

import bpy

from ..rle_splat.jit import NUMBA_PROBLEM
from .places import RenderTab, Sidebar, paragraph

KNOBS = (
    "classification", "refinement", "depth_rule", "sheet_density", "kernel", "minification", "warp_filter",
    "termination", "model", "threads", "backend",
)


class QualityPanel:
    """Drawn in both places."""

    bl_label = "Quality"

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.rle_splat
        if NUMBA_PROBLEM:
            box = layout.box()
            box.alert = True
            box.label(text="SLOW FALLBACK, no numba", icon="ERROR")
            paragraph(context, box, f"Pictures take many times as long. {NUMBA_PROBLEM}")
        layout.prop(settings, "max_error")
        layout.prop(settings, "quality")
        if settings.quality == "custom":
            column = layout.column()
            for name in KNOBS:
                if name != "refinement" or settings.classification == "refined":
                    column.prop(settings, name)
        layout.prop(settings, "record")
        layout.prop(settings, "scene_scale")
        layout.prop(settings, "meshes_occlude")


class RLE_SPLAT_PT_quality(QualityPanel, Sidebar, bpy.types.Panel):
    bl_idname = "RLE_SPLAT_PT_quality"
    bl_order = 2


class RLE_SPLAT_PT_render_quality(QualityPanel, RenderTab, bpy.types.Panel):
    bl_idname = "RLE_SPLAT_PT_render_quality"
    bl_parent_id = "RLE_SPLAT_PT_render"


CLASSES = (RLE_SPLAT_PT_quality,)  # the other is a child of a panel in picture.py and registered there
