"""Motion blur: pictures at several times while the shutter is open."""

import math

import numpy as np

from ..scene import Quality, Scene
from ..scene.changed import change
from ..view.eye import index_view
from .kind import Kind

STILL = 0.5  # pixels: what moves no further is not blurred
SPACING = 1.5  # pixels that anything moves from one picture to the next
MOST_PICTURES = 64
FEWEST_PICTURES = 4


def at_time(scene: Scene, time: float) -> Scene:
    """The scene at one time, without motion.

    Parameters
    ----------
    scene : Scene
        With at least two poses in ``motion``, evenly spaced in time; matrices are interpolated linearly between them.
    time : float
        From 0, when the shutter opens, to 1, when it closes.
    """
    position = time * (len(scene.motion) - 1)
    first = min(int(position), len(scene.motion) - 2)
    part = position - first
    before, after = scene.motion[first], scene.motion[first + 1]
    camera = change(scene.camera, matrix_world=_interpolate(before.camera_matrix, after.camera_matrix, part))
    placed = _interpolate(before.volume_matrix, after.volume_matrix, part)
    return change(scene, camera=camera, volume_matrix=placed, motion=())


def _interpolate(before: np.ndarray, after: np.ndarray, part: float) -> np.ndarray:
    return (1.0 - part) * before + part * after


def distance_moved(scene: Scene) -> float:
    """The longest path in pixels of a corner of the volume's box while the shutter is open; 0 without poses."""
    if len(scene.motion) < 2:
        return 0.0
    paths = []
    for time in np.linspace(0.0, 1.0, len(scene.motion)):
        posed = at_time(scene, time)
        view = index_view(posed.camera, posed.index_to_world, scene.width, scene.height)
        ends = ((0.0, n - 1.0) for n in scene.volume.shape_xyz)
        corners = np.array([*np.array(np.meshgrid(*ends, indexing="ij")).reshape(3, -1), np.ones(8)])
        seen = view.projection @ corners
        # What is behind the eye is not seen: it counts as where it passes the eye at the clip distance.
        ahead = np.maximum(seen[2], 1.0 if view.is_parallel else posed.camera.clip_start)
        paths.append(seen[:2] / ahead)
    return float(np.linalg.norm(np.diff(paths, axis=0), axis=1).sum(axis=0).max())


def motion_pictures(scene: Scene) -> int:
    """The number of times at which the volume is rendered while the shutter is open; 1 for a still scene."""
    moved = distance_moved(scene)
    if moved <= STILL:
        return 1
    return int(np.clip(math.ceil(moved / SPACING), FEWEST_PICTURES, MOST_PICTURES))


def _judge(scene: Scene, _: Quality) -> tuple[bool, str]:
    if not scene.motion:
        return False, "nothing moves while the shutter is open"
    moved = distance_moved(scene)
    if moved <= STILL:
        return False, f"nothing moves by more than {STILL:g} pixels while the shutter is open"
    return True, f"{moved:.1f} pixels while the shutter is open: {motion_pictures(scene)} pictures"


MOTION_BLUR = Kind("Blur what moves while the shutter is open", _judge, lambda scene: change(scene, motion=()))
