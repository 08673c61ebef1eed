"""Cut Along View: a cut plane that faces the view, so that what lies before it is removed."""

import bpy
import numpy as np
from bpy.props import EnumProperty

from ..bridge.scene import clip_objects, viewports
from ..bridge.volumes import box, volumes
from ..rle_splat.scene import RleSplatError
from .placing import make_active
from .refusal import has_volume, refuses


class RLE_SPLAT_OT_cut_along_view(bpy.types.Operator):
    """Cut away what is in front of a plane that faces the view. Moves the active cutting plane there, or adds one.
    Without a window, the view is the camera's"""

    bl_idname = "rle_splat.cut_along_view"
    bl_label = "Cut Along View"
    bl_options = {"REGISTER", "UNDO"}

    through: EnumProperty(
        name="Through", description="Point that the plane goes through",
        items=[("VIEW", "View Center", "The point about which the view turns; the middle of the volume if that point "
                                       "is beside it, or in a camera view"),
               ("CURSOR", "3D Cursor", "The 3D cursor, which Shift and the right mouse button set")])  # fmt: skip

    poll = classmethod(has_volume)

    @refuses
    def execute(self, context):
        owner = volumes.volume_object(context)
        matrix = self._facing_plane(context, owner)
        plane = clip_objects.active_plane(context, owner)
        if plane is None:
            clip_objects.check_can_add(context.scene, context.view_layer)
        if plane is None:
            plane = clip_objects.add_clip(context.scene, owner, "PLANE", "INSIDE", matrix)
            make_active(self, context, plane, "cuts the volume")
        else:
            plane.matrix_world = matrix.T.tolist()  # a sequence of columns
            plane.rle_splat.clip_keep = "INSIDE"
        return {"FINISHED"}

    def _facing_plane(self, context, owner) -> np.ndarray:
        """(4, 4) float64: the plane's unit space to the world; RleSplatError if it would not cut the volume."""
        corners = box.checked_corners(owner)
        view, pivot = viewports.view_of(context)
        middle = corners.mean(axis=0)
        if self.through == "CURSOR":
            point = np.array(context.scene.cursor.location, dtype=np.float64)
            if not clip_objects.is_at_depth(view, corners, point):
                raise RleSplatError(
                    f"The 3D cursor lies before or behind all of {owner.name}, so a plane there would hide all of it "
                    "or nothing; put the cursor on the volume, or choose View Center."
                )
        else:
            point = middle if pivot is None or not clip_objects.is_at_depth(view, corners, pivot) else pivot
        return clip_objects.facing(view, corners, point)
