"""The Advanced panel: the maximum error, classification, settings of quality, memory and threads."""

import bpy
from bpy.app.translations import pgettext_iface

from ..bridge.data.automatic import draw_number
from ..bridge.data.settings import OF_PRE, is_pre_classified, quality_of
from ..bridge.look import transfer
from ..bridge.scene.camera import image_size
from ..bridge.scene.lights import any_casts_shadows
from ..bridge.translations import filled
from ..bridge.volumes import facts, volumes
from ..rle_splat.scene import RleSplatError
from .places import RenderTab, Sidebar, paragraph

METHOD_SHARE = 0.6  # of a row, for Original 2003 Method beside Custom
KNOBS = (
    "depth_rule", "sheet_density", "kernel", "minification", "warp_filter", "termination", "rays", "axis_fade", "model",
)  # fmt: skip
# The knobs that the planner chooses when a maximum error is set.
PLANNED = ("depth_rule", "sheet_density", "warp_filter", "termination", "rays", "axis_fade")


def taken_away(scene) -> list[str]:
    """Names of the effects that the scene asks for and that pictures with a Maximum Error leave out."""
    settings = scene.rle_splat
    pre = is_pre_classified(settings)
    asked = {
        "shadows": pre and any_casts_shadows(scene), "ambient occlusion": pre and settings.ambient_occlusion > 0.0,
        "motion blur": scene.render.use_motion_blur,
    }  # fmt: skip
    return [name for name, is_asked in asked.items() if is_asked]


class AdvancedPanel:
    """Draws the knobs for experts in both places, closed by default."""

    bl_label = "Advanced"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.rle_splat
        _draw_error(context, layout)
        chosen = settings.bl_rna.properties["quality"].enum_items[settings.quality]
        layout.label(text=filled("Quality: {quality}", quality=pgettext_iface(chosen.name)))
        row = layout.split(factor=METHOD_SHARE, align=True)
        row.use_property_split = False
        for name in ("paper", "custom"):
            row.prop_enum(settings, "quality", name)
        if settings.quality != "paper":
            layout.prop(settings, "classification")
        for name in (*(KNOBS if settings.quality == "custom" else ()), "record"):  # which counts with every quality
            if _counts(settings, name):
                layout.prop(settings, name)
        draw_number(layout, settings, "threads", "use_all_cores")
        needed = _memory(context)
        if needed:
            paragraph(context, layout, needed, icon="MEMORY")


def _counts(settings, name: str) -> bool:
    """Whether a knob has an effect with the chosen classification and maximum error."""
    if name in OF_PRE:
        return is_pre_classified(settings)
    if settings.max_error and name in PLANNED:
        return False
    return name != "rays" or not is_pre_classified(settings)


def _draw_error(context, layout) -> None:
    """The maximum error, and what pictures lose by it, also before it is set."""
    settings = context.scene.rle_splat
    layout.prop(settings, "use_max_error")
    if settings.use_max_error:
        layout.prop(settings, "max_error", text="8-Bit Steps")
    if lost := taken_away(context.scene):
        paragraph(context, layout, f"Pictures with a Maximum Error have no {' and no '.join(lost)}.", "INFO")


def _memory(context) -> str:
    """The memory that the next picture needs, as a sentence; "" without a volume that can be rendered."""
    owner = volumes.volume_object(context)
    if owner is None:
        return ""
    try:
        function, quality = transfer.shown_transfer(owner), quality_of(context.scene)
    except RleSplatError:
        return ""
    meshes = context.scene.rle_splat.meshes_occlude and any(
        one.type == "MESH" and not one.hide_render for one in context.scene.objects
    )
    return facts.picture_memory(owner.rle_splat, function, quality, *image_size(context.scene.render), meshes)


class RLE_SPLAT_PT_advanced(AdvancedPanel, Sidebar, bpy.types.Panel):
    bl_order = 10


class RLE_SPLAT_PT_render_advanced(AdvancedPanel, RenderTab, bpy.types.Panel):
    bl_parent_id = "RLE_SPLAT_PT_render"
