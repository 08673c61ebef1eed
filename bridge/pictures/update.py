"""Updates our pictures after changes of the scene: edits, frame changes, undo, deleted objects, copied scenes.

In a window this waits for a pause in the edits, so that dragging stays smooth.  In background mode, where timers never
run, it is done at once.
"""

import time

import bpy
from bpy.app.handlers import persistent

from .. import presence
from ..loop import timer, work
from ..render import compositor, mesh_shadows
from ..scene.camera import marked_camera
from ..volumes import volumes
from . import live_backdrop, outdated, pictures
from .canvas import redraw

PAUSE = 0.15  # seconds without a change before the scene is checked
POLL = 0.5  # seconds between checks of a followed backdrop's transfer function, as a script's edits send no event

_due = [0.0]  # time of the next check, on the performance counter
_seen = [0.0]  # ``_due`` at the last check
_attending: list = []  # not empty during a check, whose own changes must not start another one


@persistent
def _on_change(scene=None, depsgraph=None):
    if (depsgraph is not None and depsgraph.mode == "RENDER") or _attending:
        return
    if not any(one.rle_splat.scene_id for one in bpy.data.scenes):  # no scene has pictures of ours
        return
    if not bpy.app.background:
        _due[0] = time.perf_counter() + PAUSE
        timer.start(_tick, PAUSE)
    elif scene is not None and depsgraph is not None:
        attend(scene, depsgraph)


@persistent
def _on_frame_change_post(scene, depsgraph=None):
    """Handler: follow the timeline without the pause, so that a backdrop keeps up with playback."""
    if depsgraph is not None and depsgraph.mode != "RENDER" and not _attending:
        live_backdrop.follow(scene, depsgraph, live_backdrop.is_moving(), marked_camera(scene))
        work.consider()


@persistent
def _on_save_pre(*_arguments):
    """Handler: save a followed backdrop with the transfer function as it is now.

    Blender sends no event for a point of a curve that a script moves, which in a window a timer notices.
    """
    if bpy.app.background and outdated.have_new_transfer_functions(bpy.context.scene):
        live_backdrop.follow(bpy.context.scene, bpy.context.evaluated_depsgraph_get(), later=False)


HANDLERS = (
    ("save_pre", _on_save_pre),
    ("depsgraph_update_post", _on_change),
    ("undo_post", _on_change),
    ("redo_post", _on_change),
    ("load_post", _on_change),
    ("frame_change_post", _on_frame_change_post),
)


def attend(scene, depsgraph) -> None:
    """Check a scene: copies of scenes, deleted objects, links of the compositor, the followed backdrop, outdated
    pictures, grids for shadows.
    """
    _attending.append(scene)
    try:
        pictures.settle_copies()
        for one in bpy.data.scenes:
            if one.library is None:
                live_backdrop.remove_deleted(one)
                _hand_over_renders(one)
                if one.rle_splat.use_composite:
                    compositor.settle(one)
                pictures.release_deleted(one, presence.is_deleted)
        live_backdrop.follow(scene, depsgraph, later=not bpy.app.background)
        if outdated.update_status(scene, depsgraph):
            redraw(bpy.context)
        for one in bpy.data.scenes:  # last, for it adds and removes objects, of which the depsgraph knows nothing yet
            if one.library is None:
                mesh_shadows.settle(one)
    finally:
        _attending.clear()


def _hand_over_renders(scene) -> None:
    """Let another volume of the scene stand for renders once theirs was deleted, so that a purge can remove that one.

    The volume's name is kept for messages once it is deleted.
    """
    settings = scene.rle_splat
    owner = settings.composite_object
    if owner is not None and settings.deleted_volume != owner.name:
        settings.deleted_volume = owner.name
    if owner is not None and presence.is_deleted(owner):
        settings.composite_object = None
    if settings.use_composite and settings.composite_object is None:
        others = volumes.volume_objects(scene)
        if others:  # an assignment of None would count as another edit
            settings.composite_object = others[0]


def _followed() -> list:
    """The scenes of open windows whose backdrop follows the scene."""
    scenes = (window.scene for window in bpy.context.window_manager.windows)
    return [one for one in scenes if one.rle_splat.backdrop_follows and one.rle_splat.backdrop_object is not None]


def _tick():
    """Timer function: Blender calls it again after the returned seconds, and stops after None."""
    left = _due[0] - time.perf_counter()
    if left > 0.0:
        return left
    if _due[0] == _seen[0] and not any(outdated.have_new_transfer_functions(scene) for scene in _followed()):
        return POLL if _followed() else None
    if timer.must_wait() or live_backdrop.is_moving():
        return PAUSE
    _seen[0] = _due[0]
    for window in bpy.context.window_manager.windows:
        if window.view_layer.depsgraph is not None:
            attend(window.scene, window.view_layer.depsgraph)
    return POLL if _followed() else None
