"""Render Image: the volume through the active camera, as a float image and a depth image."""

import bpy
from bpy.props import BoolProperty

from ..bridge import pictures, render_scene, volumes
from ..bridge.canvas import Canvas
from ..bridge.jobs import StepwiseOperator
from ..bridge.settings import tolerance_of
from .refusal import has_volume


class ThroughCamera(StepwiseOperator):
    """Makes images of what the active camera sees of the volume, among meshes or alone."""

    bl_options = {"REGISTER", "UNDO"}

    use_meshes: BoolProperty(
        name="Meshes Occlude", default=False,
        description="Stop each ray at the first mesh surface, and let meshes cast shadows on the volume; otherwise the "
        "volume is there alone")

    @classmethod
    def poll(cls, context):
        return has_volume_and_camera(cls, context)

    def read_scene(self, context, *, moving: bool):
        """(Scene, Quality), see ``render_scene.read_scene``; the volume's name is kept in ``_name``."""
        volume_object = volumes.volume_object(context)
        self._name = volume_object.name
        return render_scene.read_scene(
            volume_object, context.evaluated_depsgraph_get(), with_meshes=self.use_meshes, moving=moving,
            warn=lambda sentence: self.report({"WARNING"}, sentence))


class RLE_SPLAT_OT_render_image(ThroughCamera, bpy.types.Operator):
    bl_idname = "rle_splat.render_image"
    bl_label = "Render Image"
    bl_description = "Splat the volume through the active camera into a float image and a depth image"

    def prepare(self, context):
        plain, quality = self.read_scene(context, moving=True)
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


def has_volume_and_camera(cls, context) -> bool:
    """For ``poll``: whether there is a volume and a camera; the button's tooltip says what is missing."""
    if not has_volume(cls, context):
        return False
    if context.scene.camera is None:
        cls.poll_message_set("The scene has no active camera; add one and make it active with Ctrl+Numpad 0")
        return False
    return True


def report_picture(operator, image, rendering) -> None:
    """Say what was made and what is odd about it; a blank picture is a warning."""
    sentences = " ".join(rendering.report["remarks"])
    if rendering.rgba[..., 3].any():
        height, width = rendering.depth.shape
        operator.report({"INFO"}, f"{image.name}: {width} x {height} pixels. {sentences}".rstrip())
    else:
        operator.report({"WARNING"}, sentences or "The picture is blank: the volume is hidden or transparent here.")


CLASSES = (RLE_SPLAT_OT_render_image,)
