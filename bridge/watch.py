"""Looks after our pictures when the scene has changed: edits, frames, undo, deleted objects, copied scenes.

In a window this waits until the edits pause, so that dragging stays smooth.  In background mode, where no timer
ever runs, it is done at once.
"""

from __future__ import annotations

import time

import bpy
from bpy.app.handlers import persistent

from . import follow_scene, following, freshness, jobs, pictures, presence
from .camera import marked_camera
from .canvas import redraw

PAUSE = 0.15  # seconds without a change before the scene is looked at
POLL = 0.5  # seconds between looks at the transfer function of a followed backdrop: a script's edit is no event

_due = [0.0]  # when, on the performance counter
_seen = [0.0]  # what ``_due`` was when the scene was last looked at
_attending: list = []  # not empty while the scene is looked at: what that changes is no new event


@persistent
def _on_change(scene=None, depsgraph=None):
    if (depsgraph is not None and depsgraph.mode == "RENDER") or _attending or not _concerns_us():
        return
    if not bpy.app.background:
        _due[0] = time.perf_counter() + PAUSE
        if not bpy.app.timers.is_registered(_tick):
            bpy.app.timers.register(_tick, first_interval=PAUSE)
    elif scene is not None and depsgraph is not None:
        attend(scene, depsgraph)


@persistent
def _on_frame_change_post(scene, depsgraph=None):
    """Follow the timeline at once: what comes after the pause would lag behind a playing animation."""
    if depsgraph is not None and depsgraph.mode != "RENDER" and not _attending:
        follow_scene.follow(scene, depsgraph, following.is_moving(), marked_camera(scene))


HANDLERS = (
    ("depsgraph_update_post", _on_change),
    ("undo_post", _on_change),
    ("redo_post", _on_change),
    ("load_post", _on_change),
    ("frame_change_post", _on_frame_change_post),
)


def attend(scene, depsgraph) -> None:
    """Settle copies, let go of what was deleted, follow, and judge what is out of date."""
    _attending.append(scene)
    try:
        pictures.settle_copies()
        for one in bpy.data.scenes:
            if one.library is None:
                follow_scene.remove_deleted(one)
                _release_composited(one)
                pictures.release_deleted(one, presence.is_deleted)
        follow_scene.follow(scene, depsgraph, later=not bpy.app.background)
        if freshness.judge(scene, depsgraph):
            redraw(bpy.context)
    finally:
        _attending.clear()


def _release_composited(scene) -> None:
    """Let go of a composited volume that was deleted, so that a purge removes it; its name stays for the message."""
    settings = scene.rle_splat
    if settings.composite_object is not None and presence.is_deleted(settings.composite_object):
        settings.deleted_volume = settings.composite_object.name
        settings.composite_object = None


def stop() -> None:
    """Look at nothing any more."""
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def _concerns_us() -> bool:
    """Whether any scene has pictures of ours."""
    return any(scene.rle_splat.scene_id for scene in bpy.data.scenes)


def _followed() -> list:
    """The scenes of open windows whose backdrop follows."""
    scenes = (window.scene for window in bpy.context.window_manager.windows)
    return [one for one in scenes if one.rle_splat.backdrop_follows and one.rle_splat.backdrop_object is not None]


def _tick():
    """Blender calls this again after the seconds it returns, and no more after None."""
    left = _due[0] - time.perf_counter()
    if left > 0.0:
        return left
    if _due[0] == _seen[0] and not any(freshness.have_new_looks(scene) for scene in _followed()):
        return POLL if _followed() else None
    if bpy.app.is_job_running("RENDER") or jobs.StepwiseOperator.is_running() or following.is_moving():
        return PAUSE
    _seen[0] = _due[0]
    for window in bpy.context.window_manager.windows:
        if window.view_layer.depsgraph is not None:
            attend(window.scene, window.view_layer.depsgraph)
    return POLL if _followed() else None
