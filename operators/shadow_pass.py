"""Shadow Pass: how much of the volume's light shadows take away, as an image of numbers."""

import bpy

from ..bridge import pictures, render_scene
from ..bridge.settings import tolerance_of
from ..rle_splat.pipeline.shadow_pass import shadow_pass_steps
from ..rle_splat.scene import RleSplatError
from .through_camera import ThroughCamera


class RLE_SPLAT_OT_shadow_pass(ThroughCamera, bpy.types.Operator):
    bl_idname = "rle_splat.shadow_pass"
    bl_label = "Shadow Pass"
    bl_description = (
        "Make an image of the share of each pixel's light that shadows and ambient occlusion take away, 0 to 1")

    def prepare(self, context):
        if tolerance_of(context.scene) is not None:
            raise RleSplatError("Pictures to a Maximum Error have no shadows: turn it off for a shadow pass.")
        plain, quality = self.read_scene(context)
        return shadow_pass_steps(plain, quality, render_scene.KEPT)

    def commit(self, context, made):
        _, share = made
        image = pictures.keep_numbers(self._scene.get(), self._volume.get(), share, "shadow")
        self.report({"INFO"}, f"{image.name}: at most {share.max():.0%} of a pixel's light is taken away.")


CLASSES = (RLE_SPLAT_OT_shadow_pass,)
