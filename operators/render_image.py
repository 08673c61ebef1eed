"""Render to Image: render the volume through the active camera into a color image and a depth image."""

import bpy

from ..bridge.data.settings import tolerance_of
from ..bridge.held import Held
from ..bridge.pictures import outdated, pictures, show_image
from ..bridge.pictures.canvas import ProgressImage
from ..bridge.scene import render_scene
from .through_camera import ThroughCamera, report_picture


class RLE_SPLAT_OT_render_image(ThroughCamera, bpy.types.Operator):
    bl_idname = "rle_splat.render_image"
    bl_label = "Render to Image"
    bl_description = (
        "Render the volume alone, through the active camera, into a "
        "color image and a depth image, and open the color image. "
        "They are for compositing by hand and saved with the .blend; "
        "F12 does not need them"
    )

    def prepare(self, context):
        plain, quality = self.read_scene(context)
        self._canvas = ProgressImage(self._scene, self._volume, "color")
        tolerance = tolerance_of(context.scene)
        self._made_from = outdated.made_of(plain, quality, tolerance, self.with_meshes)
        return render_scene.steps(plain, quality, tolerance=tolerance, drafts=self.was_in_window)

    def show_draft(self, context, rendering):
        before = show_image.image_in_editor()
        self._in_editor = Held(before) if before is not None else None
        show_image.show_in_editor(self._canvas.show(rendering.rgba))

    def put_back(self, context):
        self._canvas.put_back()
        before = self._in_editor and self._in_editor.find()
        if before is not None:
            show_image.show_in_editor(before)

    def commit(self, context, rendering):
        scene, volume_object = self._scene.get(), self._volume.get()
        self.is_new = pictures.find(scene, volume_object, "color") is None
        image, depth_image = pictures.keep(scene, volume_object, rendering.rgba, rendering.depth)
        settings = scene.rle_splat
        settings.image, settings.depth_image = image, depth_image
        outdated.note(image, self._made_from)
        pictures.note_report(settings, rendering.report)
        report_picture(self, image, rendering)
        if self.was_in_window and not bpy.app.background:
            show_image.show_soon(image)
