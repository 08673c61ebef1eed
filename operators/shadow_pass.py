"""Shadow Pass: how much of the volume's light shadows take away, as an image of numbers."""

import bpy
from bpy.props import BoolProperty

from ..bridge import pictures, render_scene, volumes
from ..bridge.jobs import StepwiseOperator
from ..bridge.settings import tolerance_of
from ..rle_splat.scene import RleSplatError
from ..rle_splat.shadow_pass import shadow_pass_steps
from .render_image import has_volume_and_camera


class RLE_SPLAT_OT_shadow_pass(StepwiseOperator, bpy.types.Operator):
    bl_idname = "rle_splat.shadow_pass"
    bl_label = "Shadow Pass"
    bl_description = (
        "Make an image of the share of each pixel's light that shadows and ambient occlusion take away, 0 to 1")
    bl_options = {"REGISTER", "UNDO"}

    use_meshes: BoolProperty(
        name="Meshes Occlude", default=False,
        description="Stop each ray at the first mesh surface; meshes then cast shadows on the volume, too")

    @classmethod
    def poll(cls, context):
        return has_volume_and_camera(cls, context)

    def prepare(self, context):
        volume_object = volumes.volume_object(context)
        self._name = volume_object.name
        if tolerance_of(context.scene) is not None:
            raise RleSplatError("Pictures to a Maximum Error have no shadows: turn it off for a shadow pass.")
        plain, quality = render_scene.read_scene(
            volume_object, context.evaluated_depsgraph_get(), with_meshes=self.use_meshes,
            warn=lambda sentence: self.report({"WARNING"}, sentence))
        return shadow_pass_steps(plain, quality, render_scene.KEPT)

    def commit(self, context, made):
        _, share = made
        image = pictures.keep_numbers(render_scene.still_there(self._name), share, "shadow")
        self.report({"INFO"}, f"{image.name}: at most {share.max():.0%} of a pixel's light is taken away.")


CLASSES = (RLE_SPLAT_OT_shadow_pass,)
