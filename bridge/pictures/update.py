"""Updates our pictures after changes of the scene: edits, frame changes, undo, deleted objects, copied scenes.

In a window this waits for a pause in the edits, so that dragging stays smooth.  In background mode, where timers never
run, it is done at once.

A backdrop that follows the scene is made again whenever something that it depends on has changed.  It is shown by the
scene's active camera, including a camera that a timeline marker makes active.  In a window it is work of the loop, with
a draft first; scripts that set a frame, and background mode, get the full picture at once.
"""

import time
from collections.abc import Generator

import bpy
from bpy.app.handlers import persistent

from ...rle_splat.runtime.steps import drain
from .. import messages, presence
from ..data.settings import tolerance_of
from ..held import Held
from ..loop import timer, work
from ..render import compositor, mesh_shadows
from ..scene import render_scene
from ..scene.camera import camera_object, image_size, marked_camera
from ..volumes import volumes
from . import backdrop, images, outdated, pictures
from .canvas import redraw
from .drafts import Draft

PAUSE = 0.15  # seconds without a change before the scene is checked, or a picture goes on after its draft
DRAFT, FAILED, HIDDEN = (outdated.MadeFrom(why, "", False) for why in ("draft", "failed", "hidden"))  # of no picture

_due = [0.0]  # time of the next check, on the performance counter
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
        follow(scene, depsgraph, _is_moving(), marked_camera(scene))


@persistent
def _on_save_pre(*_arguments):
    """Handler: save a followed backdrop as it is now, since a script may move points of a curve without an event."""
    if bpy.app.background and outdated.out_of_date(bpy.context.scene):
        follow(bpy.context.scene, bpy.context.evaluated_depsgraph_get(), later=False)


HANDLERS = (
    ("save_pre", _on_save_pre),
    ("depsgraph_update_post", _on_change),
    ("undo_post", _on_change),
    ("redo_post", _on_change),
    ("load_post", _on_change),
    ("frame_change_post", _on_frame_change_post),
)


def _is_moving() -> bool:
    """Whether the user plays the animation or drags through it."""
    screens = [] if bpy.app.background else [window.screen for window in bpy.context.window_manager.windows]
    return any(one.is_animation_playing or one.is_scrubbing for one in screens)


def _tick():
    """Timer function: check the scenes of all windows after a pause in the edits."""
    if (left := _due[0] - time.perf_counter()) > 0.0:
        return left
    if timer.must_wait() or _is_moving():
        return PAUSE
    for window in bpy.context.window_manager.windows:
        if window.view_layer.depsgraph is not None:
            attend(window.scene, window.view_layer.depsgraph)
    return None


def attend(scene, depsgraph) -> None:
    """Check a scene: copies of scenes, deleted objects, links of the compositor, the followed backdrop, outdated
    pictures, grids for shadows.
    """
    _attending.append(scene)
    try:
        pictures.settle_copies()
        for one in bpy.data.scenes:
            if one.library is None:
                _remove_deleted(one)
                _hand_over_renders(one)
                if one.rle_splat.use_composite:
                    compositor.settle(one)
                pictures.release_deleted(one, presence.is_deleted)
        follow(scene, depsgraph, later=not bpy.app.background)
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


def _remove_deleted(scene) -> None:
    """Remove the backdrops of deleted volumes from their cameras, with a message."""
    settings, gone = scene.rle_splat, set()
    for row in settings.pictures:
        if row.volume is not None and not presence.is_deleted(row.volume):
            if row.name != row.volume.name:  # an assignment would count as another edit
                row.name = row.volume.name
        elif row.kind == "backdrop":
            gone.add(row.name if row.volume is None else row.volume.name)
            entry = None if row.camera is None else backdrop.find(scene, row.camera)
            if entry is not None and entry.image == row.image:
                backdrop.hide(scene, row.camera)
    followed = settings.backdrop_object
    if followed is not None and presence.is_deleted(followed):
        gone.add(followed.name)
        settings.backdrop_object = None
    if gone:
        work.drop(work.BACKDROP)
        messages.complain(settings, f"{messages.the_volume(*gone)} was deleted, so its backdrop was removed.")


def follow(scene, depsgraph, later: bool, camera=None) -> None:
    """Update the backdrop of the active camera if it follows the scene; a failure becomes a message in the panel.

    Parameters
    ----------
    later : bool
        Whether the picture may be made by the loop, with a draft first.
    camera : bpy.types.Object, optional
        A camera object that is about to become active.
    """
    settings = scene.rle_splat
    volume_object = settings.backdrop_object
    if not settings.backdrop_follows or volume_object is None:
        return
    image = None
    try:
        camera = camera or camera_object(depsgraph).original
        image = pictures.find(scene, volume_object, "backdrop", camera)
        if image is not None and backdrop.find(scene, camera) is None:
            return  # the user removed the background image by hand
        if not render_scene.is_rendered(volume_object, depsgraph):
            _blank(scene, image, HIDDEN, f"{volume_object.name!r} is hidden from renders, so its backdrop is empty.")
            return
        if later and work.want(volume_object, depsgraph):
            return  # the object is tagged when its voxels are there
        with_meshes = settings.meshes_occlude and settings.backdrop_depth == "FRONT"
        plain, quality = render_scene.read_scene(volume_object, depsgraph, with_meshes=with_meshes, camera=camera)
        tolerance = tolerance_of(depsgraph.scene_eval)
        made_from = outdated.made_of(plain, quality, tolerance, with_meshes)
        if work.is_making(work.BACKDROP, made_from) and later:
            return
        work.drop(work.BACKDROP)
        if image is None:
            size = image_size(depsgraph.scene_eval.render)
            image = pictures.find_or_make(scene, volume_object, "backdrop", *size, camera)
        elif outdated.made_from(image) == made_from:
            return
        backdrop.show(camera, image, settings.backdrop_depth)
        steps = render_scene.steps(plain, quality, tolerance=tolerance, refuse_empty_view=False, drafts=later)
        steps = _show_steps(Held(scene), Held(image), steps, made_from)
        if not later:
            drain(steps)
            return
        is_moving = _is_moving()
        while is_moving and not isinstance(step := next(steps, None), Draft):  # at once: the next frame drops the rest
            if step is None:
                return
        work.begin(work.BACKDROP, made_from, steps, PAUSE if is_moving else 0.0)
    except Exception as problem:  # a handler runs for every frame: one sentence instead of many tracebacks
        _blank(scene, image, FAILED, messages.sentence_of(problem))


def _show_steps(scene: Held, image: Held, steps: Generator, made_from) -> Generator:
    """Generator: show the drafts and the picture, which ``steps`` yields and returns, until its image is gone."""
    rendering = None
    while rendering is None:
        try:
            step = next(steps)
        except StopIteration as finished:
            step = rendering = finished.value
        except Exception as problem:
            if (found := scene.find()) is not None:
                _blank(found, image.find(), FAILED, messages.sentence_of(problem))
            return
        found, shown = scene.find(), image.find()
        if found is None or shown is None:
            return
        if isinstance(step, Draft):
            _show(shown, step.rendering, DRAFT)
        if rendering is None:
            yield step
    _show(shown, rendering, made_from)
    found.rle_splat.message = ""
    pictures.note_report(found.rle_splat, rendering.report)


def _show(image, rendering, made_from) -> None:
    pictures.show(image, rendering)
    outdated.note(image, made_from)
    redraw(bpy.context)


def _blank(scene, image, why: outdated.MadeFrom, sentence: str) -> None:
    """Clear the backdrop instead of showing an outdated picture, with a message."""
    work.drop(work.BACKDROP)
    if image is not None and outdated.made_from(image) != why:
        images.clear(image)
        outdated.note(image, why)
    if scene.rle_splat.message != sentence:  # print it once, not at every redraw
        messages.complain(scene.rle_splat, sentence)
