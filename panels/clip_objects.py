"""The Cut panel: boxes and planes that cut the volume."""

import bpy

from ..bridge.scene import clip_objects
from ..bridge.volumes import volumes
from ..operators import gray_values_on_cut
from .places import Sidebar
from .slices import draw_window


class RLE_SPLAT_PT_clip_objects(Sidebar, bpy.types.Panel):
    bl_label = "Cut"
    bl_order = 4
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return volumes.volume_object(context) is not None or bool(clip_objects.clip_objects(context.scene))

    def draw_header(self, context):
        if clip_objects.clip_objects(context.scene):
            self.layout.prop(context.scene.rle_splat, "use_clips", text="")

    def draw(self, context):
        layout = self.layout
        layout.active = context.scene.rle_splat.use_clips
        row = layout.row(align=True)
        for kind, text, icon in (("BOX", "Add Box", "MESH_CUBE"), ("PLANE", "Add Plane", "MESH_PLANE")):
            row.operator("rle_splat.add_cutting_object", text=text, icon=icon).kind = kind
        layout.operator_menu_enum("rle_splat.cut_along_view", "through", icon="VIEW_PERSPECTIVE")
        found = clip_objects.clip_objects(context.scene)
        if found:
            if any(map(_is_box, found)):
                layout.operator("rle_splat.fit_cutting_object", icon="FULLSCREEN_ENTER")
            column = layout.box().column(align=True)
            for one in found:
                _draw_one(context, column, one)
            layout.prop(context.scene.rle_splat, "clip_objects", text="")
            owner = volumes.volume_object(context)
            shows = owner is not None and gray_values_on_cut.shows_values(context.scene, owner)
            layout.operator("rle_splat.gray_values_on_cut", icon="IMAGE_DATA", depress=shows)
            if shows:
                draw_window(context, layout, owner.rle_splat)


def _draw_one(context, layout, one) -> None:
    """A row of the list: switch, name, flip and delete."""
    row = layout.row(align=True)
    switch = row.row(align=True)
    switch.enabled = one.type == "EMPTY"  # a mesh cuts, hidden or not
    switch.prop(one.rle_splat, "clip_is_on", text="")
    is_active = context.view_layer.objects.active == one
    icon = "MESH_CUBE" if _is_box(one) else "MESH_PLANE"
    row.operator("rle_splat.choose_object", text=one.name, icon=icon, emboss=is_active).name = one.name
    is_linked = one.rle_splat.clip_only_parent
    row.prop(one.rle_splat, "clip_only_parent", text="", icon="LINKED" if is_linked else "UNLINKED")
    row.prop(one.rle_splat, "clip_flipped", text="", icon="ARROW_LEFTRIGHT")
    row.operator("rle_splat.delete_cutting_object", text="", icon="X", emboss=False).name = one.name


def _is_box(one) -> bool:
    """Whether an object cuts as a box, as far as its own shape tells: a cube Empty, or a mesh that is not flat."""
    if one.type == "EMPTY":
        return one.empty_display_type == "CUBE"
    return min(one.dimensions) > clip_objects.FLAT * max(one.dimensions)
