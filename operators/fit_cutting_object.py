"""Fit to Volume: make a cut box as large as the volume again, or as what is visible of it."""

import bpy
import numpy as np
from mathutils import Matrix

from ..bridge import linked
from ..bridge.data.settings import scene_scale_of
from ..bridge.scene import clip_handles
from ..bridge.volumes import volumes
from ..bridge.volumes.attached import volume_frame
from .add_cutting_object import FIT, fitted
from .reading import LoadsFirst
from .refusal import has_volume, needs, refuses


class RLE_SPLAT_OT_fit_cutting_object(LoadsFirst, bpy.types.Operator):
    """Fit the cutting box to the whole volume, or to what is visible of it"""

    bl_idname = "rle_splat.fit_cutting_object"
    bl_label = "Fit to Volume"
    bl_options = {"REGISTER", "UNDO"}

    fit: FIT

    @classmethod
    def poll(cls, context):
        one = clip_handles.active_box(context)
        return has_volume(cls, context) and needs(
            cls, one is not None and linked.is_own(one), "Add a cut box, or choose one in the list"
        )

    @refuses
    def execute(self, context):
        owner, one = volumes.volume_object(context), clip_handles.active_box(context)
        volume = volumes.load_volume(owner)
        matrix = volume_frame(volume, owner, scene_scale_of(context.scene, volume.unit)) @ fitted(
            owner, volume, self.fit
        )
        one.matrix_world = Matrix((matrix / np.array((*(one.empty_display_size,) * 3, 1.0))).tolist())
        return {"FINISHED"}
