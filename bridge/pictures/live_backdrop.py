"""The backdrop that follows the scene: it is rendered again whenever something it depends on has changed.

It is shown by the scene's active camera, including a camera that a timeline marker makes active.  During playback,
scrubbing and edits a slow picture would block the window.  So a draft is shown at once and a timer continues until the
picture is done or something changes.  Scripts that set a frame, and background mode, get the full picture at once.
"""

from collections.abc import Generator
from typing import NamedTuple

import bpy

from ...rle_splat.runtime.steps import drain
from .. import messages, presence
from ..data.playback import is_playing
from ..data.settings import tolerance_of
from ..held import Held
from ..loop import timer, work
from ..scene import render_scene
from ..scene.camera import camera_object, image_size
from . import backdrop, images, outdated, pictures
from .canvas import redraw
from .drafts import Draft

WAIT = 0.2  # seconds between checks whether playback has ended
HIDDEN = outdated.MadeFrom("hidden", "", False)  # the volume is hidden from renders
FAILED = outdated.MadeFrom("failed", "", False)


class _Work(NamedTuple):
    """A picture in progress: ``steps`` yields Progress and at most one Draft, and returns a Rendering of inputs."""

    steps: Generator
    scene: Held
    image: Held
    made_from: outdated.MadeFrom


_unfinished: list[_Work] = []  # at most one


def is_moving() -> bool:
    """Whether the user plays the animation or drags through it."""
    if bpy.app.background:
        return False
    return is_playing() or any(window.screen.is_scrubbing for window in bpy.context.window_manager.windows)


def stop() -> None:
    """Drop the work in progress.

    The render thread may call this during a step, when the generator cannot be closed.  So the generator is only
    released, and ends after that step.
    """
    _unfinished.clear()


def follow(scene, depsgraph, later: bool, camera=None) -> None:
    """Update the backdrop of the active camera if it follows the scene; a failure becomes a message in the panel.

    Parameters
    ----------
    later : bool
        Whether the picture may be finished by a timer, with a draft until then.
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
            _hide(scene, volume_object, image)
            return
        if later and work.want(volume_object, depsgraph):
            return  # the object is tagged when its voxels are there
        with_meshes = settings.meshes_occlude and settings.backdrop_depth == "FRONT"
        plain, quality = render_scene.read_scene(volume_object, depsgraph, with_meshes=with_meshes, camera=camera)
        tolerance = tolerance_of(depsgraph.scene_eval)
        made_from = outdated.made_of(plain, quality, tolerance, with_meshes)
        if image is not None and made_from in (outdated.made_from(image), *(one.made_from for one in _unfinished)):
            return
        stop()
        if image is None:
            image = pictures.find_or_make(
                scene, volume_object, "backdrop", *image_size(depsgraph.scene_eval.render), camera
            )
        backdrop.show(camera, image, settings.backdrop_depth)
        wish = dict(tolerance=tolerance, refuse_empty_view=False)
        if later:
            steps = render_scene.steps(plain, quality, **wish, drafts=True)
            _begin(_Work(steps, Held(scene), Held(image), made_from))
            return
        _finish(scene, image, drain(render_scene.steps(plain, quality, **wish)), made_from)
    except Exception as problem:  # a handler runs for every frame: one sentence instead of many tracebacks
        _fail(scene, image, problem)


def remove_deleted(scene) -> None:
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
        stop()
        messages.complain(settings, f"{messages.the_volume(*gone)} was deleted, so its backdrop was removed.")


def _begin(one: _Work) -> None:
    """Work until the draft and leave the rest to a timer."""
    while (step := _advance(one)) is not None:
        if isinstance(step, Draft):
            _unfinished.append(one)
            timer.start(_tick)
            return


def _tick():
    """Timer function: do one step."""
    if _unfinished and is_playing():
        return WAIT
    for one in _unfinished[:1]:
        step = _advance(one)
        if step is None:
            stop()
        if step is None or isinstance(step, Draft):
            redraw(bpy.context)
    return timer.AT_ONCE if _unfinished else None


def _advance(one: _Work):
    """Do one step and show the draft if it is one; return the step, or None at the end."""
    scene, image = one.scene.find(), one.image.find()
    if scene is None or image is None:
        return None
    try:
        try:
            step = next(one.steps)
        except StopIteration as finished:
            _finish(scene, image, finished.value, one.made_from)
            return None
        if isinstance(step, Draft):
            pictures.show(image, step.rendering)
        return step
    except Exception as problem:
        _fail(scene, image, problem)
        return None


def _finish(scene, image, rendering, made_from) -> None:
    """Show the finished picture and its report."""
    pictures.show(image, rendering)
    outdated.note(image, made_from)
    scene.rle_splat.message = ""
    pictures.note_report(scene.rle_splat, rendering.report)


def _hide(scene, volume_object, image) -> None:
    """Clear the backdrop of a volume that is hidden from renders, with a message."""
    if image is not None and outdated.made_from(image) != HIDDEN:
        stop()
        images.clear(image)
        outdated.note(image, HIDDEN)
    _say(scene, f"{volume_object.name!r} is hidden from renders, so its backdrop is empty.")


def _fail(scene, image, problem) -> None:
    """Clear the backdrop instead of showing an outdated picture, with a message."""
    stop()
    if image is not None:
        images.clear(image)
        outdated.note(image, FAILED)
    _say(scene, messages.sentence_of(problem))


def _say(scene, sentence: str) -> None:
    if scene.rle_splat.message != sentence:  # print it once, not at every redraw
        messages.complain(scene.rle_splat, sentence)
