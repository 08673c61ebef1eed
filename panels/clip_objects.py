"""The Clip Objects panel: boxes and planes that cut the volume."""

import bpy

from ..bridge import clip_objects, volumes
from .places import Sidebar


class RLE_SPLAT_PT_clip_objects(Sidebar, bpy.types.Panel):
    bl_label = "Clip Objects"
    bl_idname = "RLE_SPLAT_PT_clip_objects"
    bl_order = 2
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return volumes.volume_object(context) is not None or bool(clip_objects.clip_objects(context.scene))

    def draw(self, context):
        layout = self.layout
        layout.prop(context.scene.rle_splat, "clip_objects", text="")
        for one in clip_objects.clip_objects(context.scene):
            row = layout.row(align=True)
            row.label(text=one.name, icon="CUBE")
            row.prop(one.rle_splat, "clip_keep", text="")
            row.prop(one.rle_splat, "clip_only_parent", text="", icon="LINKED")
            row.prop(one, "hide_render", text="")
        row = layout.row(align=True)
        for kind, text, icon in (("BOX", "Add Box", "CUBE"), ("PLANE", "Add Plane", "EMPTY_SINGLE_ARROW")):
            row.operator("rle_splat.add_clip", text=text, icon=icon).kind = kind
        layout.operator_menu_enum("rle_splat.clip_to_view", "through", text="Clip to View", icon="VIEW_PERSPECTIVE")


CLASSES = (RLE_SPLAT_PT_clip_objects,)
