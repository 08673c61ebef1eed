"""Shadow Image: an image of the share of light that shadows remove in each pixel."""

import bpy

from ..bridge.data.settings import tolerance_of
from ..bridge.pictures import pictures
from ..bridge.scene import render_scene
from ..rle_splat.pipeline.shadow_pass import shadow_pass_steps
from ..rle_splat.scene import RleSplatError
from .through_camera import ThroughCamera, has_values_and_camera


class RLE_SPLAT_OT_shadow_pass(ThroughCamera, bpy.types.Operator):
    bl_idname = "rle_splat.shadow_pass"
    bl_label = "Shadow Image"
    bl_description = (
        "Make a grayscale image of how much of each pixel's light shadows and ambient occlusion remove: 0 is none, 1 "
        "is all"
    )

    poll = classmethod(has_values_and_camera)

    def prepare(self, context):
        plain, quality = self.read_scene(context)
        if tolerance_of(context.scene) is not None and quality.classification == "pre":
            raise RleSplatError(
                "With interpolated colors and a Maximum Error pictures have no shadows; turn Maximum Error off "
                "to make a shadow image."
            )
        return shadow_pass_steps(plain, quality, render_scene.KEPT)

    def commit(self, context, made):
        _, share = made
        image = pictures.keep_numbers(self._scene.get(), self._volume.get(), share, "shadow")
        self.report({"INFO"}, f"{image.name}: shadows remove at most {share.max():.0%} of a pixel's light.")
