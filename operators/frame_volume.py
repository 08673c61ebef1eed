"""Frame Volume: move the views of the window so that all that is visible is seen, from any side of the patient."""

import math

import bpy
import numpy as np
from bpy.app.translations import pgettext_tip
from bpy.props import EnumProperty

from ..bridge.scene import viewports
from ..bridge.volumes import box, loading, volumes
from ..rle_splat.volume.volume import PATIENT
from .add_cutting_object import visible_corners
from .refusal import has_volume, refuse

AS_IT_IS = "NONE"
MOST_VOXELS = 1 << 29  # of which what is visible is found in about a second
SIDES = (
    (AS_IT_IS, "As It Is", "Keep the direction of the view"),
    ("A", "Anterior", "Look at the patient's front"), ("P", "Posterior", "Look at the patient's back"),
    ("L", "Left", "Look at the patient's left side"), ("R", "Right", "Look at the patient's right side"),
    ("S", "Superior", "Look down from the head, with the front up"),
    ("I", "Inferior", "Look up from the feet, with the front up, as axial slices are shown"),
)  # fmt: skip


class RLE_SPLAT_OT_frame_volume(bpy.types.Operator):
    """Fit what is visible of the volume into the 3D viewports of this window. The letters also turn them to a side
    of the patient: A anterior (front), P posterior (back), L left, R right, S superior (head), I inferior (feet)"""

    bl_idname = "rle_splat.frame_volume"
    bl_label = "Frame Volume"

    side: EnumProperty(name="From", description="The side of the patient to look from", items=SIDES)

    poll = classmethod(has_volume)

    @classmethod
    def description(cls, _context, properties):
        item = next(item for item in SIDES if item[0] == properties.side)
        return pgettext_tip(cls.bl_description if properties.side == AS_IT_IS else item[2])

    def execute(self, context):
        owner = volumes.volume_object(context)
        if not viewports.has_viewport(context.window):
            return refuse(self, "No 3D viewport is open in this window; open one.")
        corners = visible_corners(owner, context.scene) if _is_quick(owner) else box.world_corners(owner)
        if len(corners) == 0:
            return refuse(self, f"The box of {owner.name} was changed or removed; import the volume again.")
        matrix = np.array(owner.matrix_world)
        rotation = None
        if self.side != AS_IT_IS:
            if owner.rle_splat.space != PATIENT:
                problem = f"The file of {owner.name} does not say how the patient lies"
                return refuse(self, f"{problem}; click Edit in the File panel and set Orientation.")
            if abs(np.linalg.det(matrix[:3, :3])) < 1e-30:
                return refuse(self, f"{owner.name} has a scale of 0; set it above 0.")
            rotation = viewports.rotation_from(self.side, matrix)
        viewports.frame(context.window, [corners], rotation)
        return {"FINISHED"}


def _is_quick(owner) -> bool:
    """Whether what is visible of a volume is found without a wait."""
    return loading.is_at_hand(owner) and math.prod(volumes.at_hand(owner).shape_xyz) <= MOST_VOXELS
