"""The Slices panel: planes that show a volume's values as gray levels."""

import bpy

from ..bridge.live import slice_pictures, slices
from ..bridge.volumes import volumes
from .places import Sidebar, paragraph


class RLE_SPLAT_PT_slices(Sidebar, bpy.types.Panel):
    bl_label = "Slices"
    bl_idname = "RLE_SPLAT_PT_slices"
    bl_order = 4
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return volumes.volume_object(context) is not None or bool(slices.slice_objects(context.scene))

    def draw(self, context):
        layout = self.layout
        for one in slices.slice_objects(context.scene):
            halves = layout.split(factor=0.5, align=True)
            halves.label(text=one.name, icon="MESH_PLANE")
            row = halves.row(align=True)
            row.prop(one, "location", index=2, text="")
            row.prop(one, "hide_viewport", text="")
            row.prop(one, "hide_render", text="")
            problem = slice_pictures.problem_of(one)
            if problem:
                paragraph(context, layout, problem, icon="ERROR")
        row = layout.row(align=True)
        for kind in ("axial", "coronal", "sagittal"):
            row.operator("rle_splat.add_slice", text=kind.title()).kind = kind
        layout.operator("rle_splat.add_slice", text="Add All Three", icon="ADD").kind = "ALL"


CLASSES = (RLE_SPLAT_PT_slices,)
