"""A camera that turns about a volume: a child of an Empty whose rotation is keyframed.

The Empty is in the middle of the volume's box.  Its own Z is the patient's length, or the volume's z axis.  That
placement is in its delta rotation, so that the one animated number is the azimuth, as of ``view.turntable``.
"""

import math

import bpy
import numpy as np
from mathutils import Matrix

from ...rle_splat.scene import RleSplatError
from ...rle_splat.view.turntable import distance_to_see, turning_extent, turntable_axes
from ...rle_splat.volume.volume import PATIENT
from .. import linked
from ..data.playback import curves_of
from ..volumes import box

MARK = "rle_splat_turntable"  # custom property of the Empty: the volume
ROOM = 1.05  # the view over what the volume fills of it
LONGEST_NAME = 40  # characters of the volume's name in the names of its camera and Empty
FULL_TURN = 360.0


def turning_camera(context, owner, *, is_perspective: bool, elevation: float):
    """The camera that turns about a volume, and its Empty; made where there are none.

    Parameters
    ----------
    elevation : float
        Degrees.

    Returns
    -------
    camera, pivot : bpy.types.Object
        The camera sees all of the volume from every side. A camera that was made before keeps its lens.

    Raises
    ------
    RleSplatError
        If the volume's box was changed, or has no size.
    """
    corners = box.checked_corners(owner)
    middle = corners.mean(axis=0)
    axes = _axes(owner, corners)
    pivot = _made_before(context.scene, owner) or _new_pivot(context.scene, owner)
    camera = next(child for child in pivot.children if child.type == "CAMERA")
    pivot.location = middle
    pivot.delta_rotation_euler = Matrix(axes.tolist()).to_euler()
    extent = turning_extent((corners - middle) @ axes, elevation)
    _place(context.scene, camera, extent, is_perspective, elevation)
    return camera, pivot


def _axes(owner, corners: np.ndarray) -> np.ndarray:
    """(3, 3) float64: right-handed orthonormal columns, the patient's left, back and head where the file says these."""
    own = np.array(owner.matrix_world, np.float64)[:3, :3]
    if owner.rle_splat.space != PATIENT:
        sides = (corners[[1, 2, 4]] - corners[0]).T
        own = sides if abs(np.linalg.det(sides)) > 0.0 else own
    up = own[:, 2] / (np.linalg.norm(own[:, 2]) or 1.0)
    back = own[:, 1] - up * (own[:, 1] @ up)
    if np.linalg.norm(up) == 0.0 or np.linalg.norm(back) == 0.0:
        raise RleSplatError(f"{owner.name} has a scale of 0; set it above 0.")
    back /= np.linalg.norm(back)
    return np.stack((np.cross(back, up), back, up), axis=1)


def _made_before(scene, owner):
    """The Empty of an earlier turntable of a volume with its camera, or None."""
    for one in scene.objects:
        if one.get(MARK) == owner and linked.is_own(one) and any(c.type == "CAMERA" for c in one.children):
            return one
    return None


def _new_pivot(scene, owner):
    name = owner.name[:LONGEST_NAME]
    pivot = bpy.data.objects.new(f"{name} Turntable", None)
    pivot.empty_display_type, pivot.empty_display_size = "ARROWS", owner.empty_display_size
    pivot.hide_render = True
    pivot[MARK] = owner
    camera = bpy.data.objects.new(f"{name} Turntable Camera", bpy.data.cameras.new(f"{name} Turntable Camera"))
    camera.parent = pivot
    for one in (pivot, camera):
        scene.collection.objects.link(one)
    return pivot


def _place(scene, camera, extent: np.ndarray, is_perspective: bool, elevation: float) -> None:
    """Move a camera back until it sees all of ``extent``, see ``turning_extent``."""
    data = camera.data
    data.type = "PERSP" if is_perspective else "ORTHO"
    radius = float(np.abs(extent).max())
    frame = np.abs(np.array([corner[:] for corner in data.view_frame(scene=scene)]))
    if is_perspective:
        distance = ROOM * distance_to_see(extent, (frame[:, :2] / frame[:, 2:]).max(axis=0))
    else:
        distance = 3.0 * radius
        data.ortho_scale *= ROOM * float((extent[:, :2].max(axis=0) / frame[:, :2].max(axis=0)).max())
    right, up, forward = turntable_axes(0.0, elevation)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack((right, up, -forward), axis=1)
    matrix[:3, 3] = -distance * forward
    camera.matrix_parent_inverse = Matrix.Identity(4)
    camera.matrix_basis = Matrix(matrix.tolist())
    data.clip_start = max(0.5 * (distance - math.sqrt(3.0) * radius), 1e-3 * distance)
    data.clip_end = max(100.0 * distance, data.clip_end)


def keyframe_turn(pivot, azimuth: float, angle: float, frames: range) -> None:
    """Keyframe the rotation of an Empty that ``turning_camera`` made.

    Parameters
    ----------
    azimuth : float
        At the first frame, in degrees; 0 shows a patient's face.
    angle : float
        By how much it turns, in degrees. Of a full turn the last frame is one step before the first, so that the
        animation can be repeated; the last frame of an arc is its end.
    """
    pivot.animation_data_clear()
    pivot.rotation_mode = "XYZ"
    pivot.rotation_euler = (0.0, 0.0, math.radians(azimuth))
    pivot.keyframe_insert("rotation_euler", index=2, frame=frames[0])
    is_closed = abs(angle) >= FULL_TURN
    end = frames[-1] + 1 if is_closed else frames[-1]
    if end > frames[0]:
        pivot.rotation_euler[2] = math.radians(azimuth + angle)
        pivot.keyframe_insert("rotation_euler", index=2, frame=end)
    for curve in curves_of(pivot):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
