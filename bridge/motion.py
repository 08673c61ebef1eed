"""Where the camera and a volume are while the shutter is open, read without touching the scene that is worked on."""

from __future__ import annotations

import math
from contextlib import contextmanager

import bpy
import numpy as np

from ..rle_splat.scene import Pose
from .camera import camera_object, without_scale

POSES = 5  # read while the shutter is open; between two of them things move straight on
OPENS = {"START": 0.0, "CENTER": -0.5, "END": -1.0}  # when the shutter opens, in parts of the time it stays open


def read_poses(scene, volume_object) -> tuple[Pose, ...]:
    """Poses while the scene's shutter is open about its frame; none if motion is not blurred or nothing moves.

    The frames beside it are evaluated in a copy of the scene that goes away again: setting the frame of the scene
    itself would take back every change that the user has not keyed yet.
    """
    render = scene.render
    if not render.use_motion_blur or render.motion_blur_shutter <= 0.0:
        return ()
    opens = scene.frame_current_final + OPENS[render.motion_blur_position] * render.motion_blur_shutter
    with _copy_of(scene) as other:
        poses = [
            _pose_at(other, volume_object, opens + part * render.motion_blur_shutter)
            for part in np.linspace(0.0, 1.0, POSES)
        ]
    first = poses[0]
    moves = any(
        not np.array_equal(getattr(pose, name), getattr(first, name))
        for pose in poses
        for name in ("camera_matrix", "volume_matrix")
    )
    return tuple(poses) if moves else ()


@contextmanager
def _copy_of(scene):
    """A scene with the same objects, whose frame may be set; the copy's own following and compositing are off."""
    copy = scene.copy()
    try:
        copy.rle_splat.backdrop_follows = copy.rle_splat.use_composite = False
        yield copy
    finally:
        bpy.data.scenes.remove(copy)


def _pose_at(scene, volume_object, time: float) -> Pose:
    frame = math.floor(time)
    scene.frame_set(frame, subframe=time - frame)
    depsgraph = scene.view_layers[0].depsgraph
    depsgraph.update()
    placed = np.array(volume_object.evaluated_get(depsgraph).matrix_world, dtype=np.float64)
    return Pose(without_scale(camera_object(depsgraph).matrix_world), placed)
