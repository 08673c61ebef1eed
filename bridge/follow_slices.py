"""Keeps the pictures of slices up to date: after edits, frame changes, undo and loading, and before rendered frames.

Undo restores a slice's place but not its pixels, and an image that undo has removed comes back without them.  So what
each image shows is recorded outside Blender's data, and the record is dropped after undo.  Images are saved as other
pictures are, see ``picture_files.py``.
"""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from . import messages, read_ahead, slices
from .placeholder import placeholder

SIZE = 64  # pixels along a side of a placeholder

_shown: dict = {}  # session id of an image -> what it shows
_sampled: dict = {}  # session id of an image -> (voxels and place, values): window and level change more often
_problems: dict = {}  # session id of a slice -> sentence
_updating: list = []  # not empty while images are written, whose own updates must not start another round


@persistent
def _on_update(scene=None, depsgraph=None):
    if scene is not None and depsgraph is not None and depsgraph.mode != "RENDER":
        update(scene, depsgraph, may_wait=not bpy.app.background)


@persistent
def _on_frame_change_post(scene=None, depsgraph=None):
    """Handler: also before each rendered frame, on the render thread, when voxels are read at once."""
    if scene is not None and depsgraph is not None:
        update(scene, depsgraph, may_wait=not bpy.app.background and depsgraph.mode != "RENDER")


@persistent
def _on_other_data(*_arguments):
    """Handler: after undo or loading, when images may have lost their pixels."""
    forget()
    if not bpy.app.background:
        if not bpy.app.timers.is_registered(_tick):
            bpy.app.timers.register(_tick, first_interval=0.0)
    elif bpy.context.scene is not None:
        update(bpy.context.scene, bpy.context.evaluated_depsgraph_get(), may_wait=False)


HANDLERS = (
    ("depsgraph_update_post", _on_update),
    ("frame_change_post", _on_frame_change_post),
    ("undo_post", _on_other_data),
    ("redo_post", _on_other_data),
    ("load_post", _on_other_data),
)


def _tick() -> None:
    """Timer function: update the scenes of all windows once."""
    if bpy.app.is_job_running("RENDER"):
        return
    for window in bpy.context.window_manager.windows:
        if window.view_layer.depsgraph is not None:
            update(window.scene, window.view_layer.depsgraph, may_wait=True)


def forget() -> None:
    """Drop all records."""
    _shown.clear()
    _sampled.clear()
    _problems.clear()


def stop() -> None:
    """Drop all records and the timer."""
    forget()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def problem_of(one) -> str:
    """Why a slice shows stripes instead of its volume; "" if it does not."""
    return _problems.get(one.session_uid, "")


def update(scene, depsgraph, may_wait: bool) -> None:
    """Make the pictures of a scene's slices that have changed.

    Parameters
    ----------
    scene : bpy.types.Scene
        The scene.
    depsgraph : bpy.types.Depsgraph
        The evaluated scene.
    may_wait : bool
        Whether voxels that are not in memory are read in steps, after which this is called again.
    """
    found = [] if _updating else slices.slice_objects(scene)
    if not found:
        return
    is_render = depsgraph.mode == "RENDER"
    _updating.append(scene)
    try:
        if not is_render:  # a handler of a render must create no datablock
            slices.settle_copies(one for one in bpy.data.objects if one.rle_splat.is_slice)
        for one in found:
            hidden = one.hide_render if is_render else not one.visible_get(view_layer=depsgraph.view_layer)
            owner = slices.volume_of(one)
            if one.rle_splat.slice_image is None or hidden:
                continue
            if may_wait and owner is not None and read_ahead.want(owner, depsgraph):
                continue
            _update(scene, one, depsgraph)
            if not is_render:
                one.rle_splat.slice_image.update_tag()
    finally:
        _updating.clear()


def _update(scene, one, depsgraph) -> None:
    """Make the picture of one slice if it has changed; on failure stripes and a message."""
    uid = one.rle_splat.slice_image.session_uid
    try:
        volume, matrix, window = slices.content(one, depsgraph)
        shows = volume.key, matrix.tobytes(), window
        if _shown.get(uid) == shows:
            return
        where, values = _sampled.get(uid, (None, None))
        if where != shows[:2]:
            values = slices.sampled(volume, matrix)
            _sampled[uid] = shows[:2], values
        slices.show(one, slices.picture_of(*values, window))
        if scene.rle_splat.message == _problems.pop(one.session_uid, None):
            scene.rle_splat.message = ""
    except Exception as problem:  # handlers run often: one sentence instead of many tracebacks
        shows = sentence = messages.sentence_of(problem)
        if _shown.get(uid) == shows:
            return
        slices.show(one, placeholder(SIZE, SIZE))
        _problems[one.session_uid] = sentence
        messages.complain(scene.rle_splat, sentence)
    _shown[uid] = shows
