"""The Render panel: volumes in renders, their quality, messages, the camera view, letters and names, and files."""

import bpy
from bpy.app.translations import pgettext_iface

from ..bridge.translations import filled, with_ellipsis
from ..bridge.volumes import volumes
from ..rle_splat.scene import PRESET_AIMS
from .outdated import draw_outdated
from .places import RenderTab, Sidebar, paragraph


class PicturePanel:
    """Draws the panel in the sidebar and in the render properties."""

    def draw(self, context):
        layout = self.layout
        settings = context.scene.rle_splat
        layout.label(text="In Every Render (F12)")
        draw_in_renders(_tall(layout), settings.use_composite, text="Show in Renders")
        _draw_composite(context, layout)
        _draw_quality(context, layout)
        column = layout.column()
        column.use_property_split = False  # else the names would be cut off
        row = column.row()
        row.enabled = not settings.max_error
        row.prop(settings, "antialias")
        column.prop(settings, "meshes_occlude")
        draw_outdated(context, layout)
        # A backdrop that follows the scene clears ``message``; ``render_problem`` stays until the next render.
        for sentence in dict.fromkeys(filter(None, (settings.render_problem, settings.message))):
            alert = layout.column()
            alert.alert = True
            paragraph(context, alert, sentence, icon="ERROR")
        # Last: the panel below would lie over what follows a closed one (5.2).
        header, body = layout.panel("rle_splat_camera_view", default_closed=True)
        header.label(text="Camera View")
        if body is not None:
            _draw_preview(body, settings)
        header, body = layout.panel("rle_splat_lettering", default_closed=True)
        header.label(text="Letters and Names")
        if body is not None:
            _draw_lettering(body)
        header, body = layout.panel("rle_splat_export", default_closed=True)
        header.label(text="Pictures and Files")
        if body is not None:
            _draw_files(body)


def draw_in_renders(layout, is_on: bool, text: str) -> None:
    """A button that shows whether renders include the scene's volumes, and changes it."""
    layout.operator(
        "rle_splat.remove_from_renders" if is_on else "rle_splat.show_in_renders", text=text, depress=is_on,
        icon="RESTRICT_RENDER_OFF" if is_on else "RESTRICT_RENDER_ON")  # fmt: skip


def _tall(layout):
    """A row for a button that starts long work."""
    row = layout.row(align=True)
    row.scale_y = 1.2
    return row


def _draw_preview(layout, settings) -> None:
    """The picture in the active camera's view, which renders do not include."""
    row = _tall(layout)
    row.operator("rle_splat.preview_in_camera_view", icon="VIEW_CAMERA")
    row.operator("rle_splat.remove_from_camera_view", text="", icon="X")
    row = layout.split(factor=0.42)
    row.label(text="Preview Position")
    row.row().prop(settings, "backdrop_depth", expand=True)
    layout.prop(settings, "backdrop_follows")


def _draw_lettering(layout) -> None:
    """Buttons that add letters, a scale bar and names, as objects, for renders."""
    column = layout.column(align=True)
    column.operator("rle_splat.add_letters", icon="FONT_DATA")
    column.operator("rle_splat.add_names", icon="OUTLINER_OB_FONT")
    column.operator("rle_splat.name_structure", icon="EYEDROPPER")


def _draw_files(layout) -> None:
    """Buttons that make pictures, a mesh or a file of the volume."""
    pictures, export = (layout.column(align=True) for _ in range(2))
    row = _tall(pictures)
    row.operator("rle_splat.render_image", icon="IMAGE_DATA")
    row.operator("rle_splat.turntable", text=with_ellipsis("Turntable"), icon="RENDER_ANIMATION")
    pictures.operator("rle_splat.shadow_pass", icon="IMAGE_DATA")
    _tall(pictures).operator("rle_splat.save_figure", text=with_ellipsis("Save Figure"), icon="DOCUMENTS")
    export.operator("rle_splat.extract_surface", text=with_ellipsis("Extract Surface"), icon="MESH_ICOSPHERE")
    export.operator("rle_splat.bake_volume", text=with_ellipsis("Bake to Cycles Volume"), icon="VOLUME_DATA")


def _draw_quality(context, layout) -> None:
    """The named qualities; the others are in Advanced."""
    settings = context.scene.rle_splat
    layout.label(text="Quality")
    grid = layout.grid_flow(row_major=True, columns=2, even_columns=True, align=True)
    grid.enabled = not settings.max_error
    for name in PRESET_AIMS:
        grid.prop_enum(settings, "quality", name)
    if settings.max_error:
        layout.label(text="A maximum error is set in Advanced", icon="INFO")
    elif settings.quality not in PRESET_AIMS:
        layout.label(text="The quality is set in Advanced", icon="INFO")


def _draw_composite(context, layout) -> None:
    """What renders include, and what happens if a frame of them fails."""
    settings = context.scene.rle_splat
    if not settings.use_composite:
        return
    target = settings.composite_object
    if target is not None:
        names = [one.name for one in volumes.volume_objects(context.scene) if not one.hide_render]
        if len(names) > 1:
            sentence = filled(
                "{volumes} and {last} are included in every render.", volumes=", ".join(names[:-1]), last=names[-1]
            )
            paragraph(context, layout, sentence, icon="CHECKMARK")
        elif names:
            sentence = filled("{volume} is included in every render.", volume=names[0])
            paragraph(context, layout, sentence, icon="CHECKMARK")
        else:
            paragraph(context, layout, "All volumes are disabled in renders, so renders show none.", icon="INFO")
    else:
        sentence = filled(
            "{volume} was deleted and is missing in renders. Include another volume, or turn Show in Renders off.",
            volume=settings.deleted_volume or pgettext_iface("The volume"),
        )
        paragraph(context, layout, sentence, icon="ERROR")
    if not context.scene.render.use_lock_interface:
        paragraph(context, layout, "Without Lock Interface, Blender may crash during a render.", icon="ERROR")
        layout.prop(context.scene.render, "use_lock_interface")
    row = layout.row()
    row.use_property_split, row.use_property_decorate = True, False
    row.prop(settings, "on_failed_frame")


class RLE_SPLAT_PT_picture(PicturePanel, Sidebar, bpy.types.Panel):
    bl_label = "Render"
    bl_order = 8


class RLE_SPLAT_PT_render(PicturePanel, RenderTab, bpy.types.Panel):
    bl_label = "RLE Splat"
    bl_options = {"DEFAULT_CLOSED"}
