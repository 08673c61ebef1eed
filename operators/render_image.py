"""Render Image: the volume through the active camera, as a float image and a depth image."""

import bpy

from ..bridge import pictures, render_scene
from ..bridge.canvas import Canvas
from ..bridge.settings import tolerance_of
from .through_camera import ThroughCamera, report_picture


class RLE_SPLAT_OT_render_image(ThroughCamera, bpy.types.Operator):
    bl_idname = "rle_splat.render_image"
    bl_label = "Render Image"
    bl_description = "Splat the volume through the active camera into a float image and a depth image"

    def prepare(self, context):
        plain, quality = self.read_scene(context)
        self._canvas = Canvas(self._name, "color")
        tolerance = tolerance_of(context.scene)
        return render_scene.steps(plain, quality, tolerance=tolerance, previews=self.wants_previews)

    def show_preview(self, context, preview):
        self._canvas.show(preview.rendering.rgba)

    def put_back(self, context):
        self._canvas.put_back()

    def commit(self, context, rendering):
        volume_object = render_scene.still_there(self._name)
        settings = context.scene.rle_splat
        settings.image, settings.depth_image = pictures.keep(volume_object, rendering.rgba, rendering.depth)
        pictures.note_report(settings, rendering.report)
        report_picture(self, settings.image, rendering)


CLASSES = (RLE_SPLAT_OT_render_image,)
