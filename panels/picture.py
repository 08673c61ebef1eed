"""The Picture panel: render, backdrop and composite, and the messages about them."""

import bpy

from ..bridge import facts, freshness, kernel_preparation, transfer, volumes
from ..bridge.camera import image_size
from ..bridge.settings import quality_of
from ..rle_splat.runtime.jit import NUMBA_PROBLEM
from ..rle_splat.scene import RleSplatError
from .places import RenderTab, Sidebar, paragraph
from .quality import RENDER_CLASSES


def _memory(context) -> str:
    """The memory that the next picture needs, as a sentence; "" without a volume that can be rendered."""
    owner = volumes.volume_object(context)
    if owner is None:
        return ""
    try:
        function, quality = transfer.read_transfer(owner), quality_of(context.scene)
    except RleSplatError:
        return ""
    meshes = context.scene.rle_splat.meshes_occlude and any(
        one.type == "MESH" and not one.hide_render for one in context.scene.objects)
    return facts.picture_memory(owner.rle_splat, function, quality, *image_size(context.scene.render), meshes)


def _warn_without_numba(context, layout) -> None:
    """Say that numba is missing or broken, what follows from it, and what to do."""
    if NUMBA_PROBLEM:
        box = layout.box()
        box.alert = True
        box.label(text="No compiled kernels: rendering is very slow", icon="ERROR")
        paragraph(context, box, f"numba cannot be loaded ({NUMBA_PROBLEM}). Disable other extensions that bring a "
                                "numba of their own, or reinstall this one, then restart Blender")


class PicturePanel:
    """Draws the panel in the sidebar and in the render properties."""

    def draw(self, context):
        layout = self.layout
        settings = context.scene.rle_splat
        _warn_without_numba(context, layout)
        preparing = kernel_preparation.text()
        if preparing:
            paragraph(context, layout, preparing, icon="TIME")
        needed = _memory(context)
        if needed:
            layout.label(text=needed, icon="MEMORY")
        column = layout.column()
        column.scale_y = 1.2
        column.operator("rle_splat.render_image", icon="RENDER_STILL")
        row = column.row(align=True)
        row.operator("rle_splat.set_backdrop", icon="CAMERA_DATA")
        row.operator("rle_splat.remove_backdrop", text="", icon="X")
        row = column.row(align=True)
        row.operator("rle_splat.composite", icon="NODE_COMPOSITING")
        row.operator("rle_splat.remove_composite", text="", icon="X")
        row = layout.row()
        row.prop(settings, "backdrop_depth", expand=True)
        layout.prop(settings, "backdrop_follows")
        layout.prop(settings, "use_previews")
        for image in freshness.out_of_date(context.scene):
            paragraph(context, layout, f"Out of date: {image.name}. The scene has changed since", icon="FILE_REFRESH")
        if settings.use_composite:
            target = settings.composite_object
            if target is not None:
                paragraph(context, layout, f"{target.name} is composited into every render. Lock Interface is on "
                                           "while rendering.", icon="CHECKMARK")
            else:
                paragraph(context, layout, f"{settings.deleted_volume or 'The volume'} was deleted and is missing in "
                                           "renders. Composite another volume, or press Remove from Render.",
                          icon="ERROR")
            layout.prop(settings, "on_failed_frame", text="On Error")  # the full name would be cut off
        # A backdrop that follows the scene clears ``message``; ``render_problem`` stays until the next render.
        for sentence in dict.fromkeys(filter(None, (settings.render_problem, settings.message))):
            alert = layout.column()
            alert.alert = True
            paragraph(context, alert, sentence, icon="ERROR")


class RLE_SPLAT_PT_picture(PicturePanel, Sidebar, bpy.types.Panel):
    bl_label = "Picture"
    bl_idname = "RLE_SPLAT_PT_picture"
    bl_order = 3


class RLE_SPLAT_PT_render(PicturePanel, RenderTab, bpy.types.Panel):
    bl_label = "RLE Splat"
    bl_idname = "RLE_SPLAT_PT_render"
    bl_options = {"DEFAULT_CLOSED"}


CLASSES = (RLE_SPLAT_PT_picture, RLE_SPLAT_PT_render, *RENDER_CLASSES)  # a parent before its children
