"""Update World Light: render the light of a world that is neither one color nor an image that can be read."""

import bpy

from ..bridge.held import Held
from ..bridge.loop.jobs import StepwiseOperator
from ..bridge.scene import world_render
from ..bridge.translations import filled
from .refusal import needs


class RLE_SPLAT_OT_update_world_light(StepwiseOperator, bpy.types.Operator):
    """Update how this world lights volumes, after its nodes or images have changed. Renders an animated world in every
    frame of the scene"""

    bl_idname = "rle_splat.update_world_light"
    bl_label = "Update World Light"

    @classmethod
    def poll(cls, context):
        return needs(
            cls, world_render.is_needed(context.scene),
            "The light of this world needs no rendering, or volumes do not use it; see Lighting")  # fmt: skip

    def loading(self, _context):
        return None

    def prepare(self, context):
        self._scene = Held(context.scene)
        return world_render.update_steps(context.scene)

    def commit(self, _context, lines):
        self._scene.get().rle_splat.world_light = lines
        count = lines.count("\n") + 1
        self.report({"INFO"}, filled("Rendered the light of {count} states of the world.", count=count)
                    if count > 1 else filled("Rendered the world's light."))  # fmt: skip
