"""The backdrop that follows the scene: a fresh picture whenever something it is made from has changed.

The camera that shows it is the scene's active one, also where a marker of the timeline makes another camera active.
"""

from __future__ import annotations

from ..rle_splat.runtime.steps import drain
from . import backdrop, following, freshness, images, messages, pictures, presence, render_scene
from .camera import camera_object, image_size
from .held import Held
from .settings import tolerance_of

HIDDEN = freshness.MadeFrom("hidden", "", False)  # of a volume that is hidden from renders
FAILED = freshness.MadeFrom("failed", "", False)


def follow(scene, depsgraph, later: bool, camera=None) -> None:
    """Bring the backdrop of the active camera up to date, if the scene's backdrop follows; a message on failure.

    ``later``: the picture may come from a timer, with previews until then if the scene wants them.  ``camera``: a
    camera object that is about to become active.
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
            return  # the user took it out of the camera by hand
        if not render_scene.is_rendered(volume_object, depsgraph):
            _hide(scene, volume_object, image)
            return
        with_meshes = settings.meshes_occlude and settings.backdrop_depth == "FRONT"
        plain, quality = render_scene.read_scene(volume_object, depsgraph, with_meshes=with_meshes, camera=camera)
        tolerance = tolerance_of(depsgraph.scene_eval)
        made_from = freshness.made_of(plain, quality, tolerance, with_meshes)
        if image is not None and (freshness.made_from(image) == made_from or following.is_making(made_from)):
            return
        following.stop()
        if image is None:
            image = pictures.find_or_make(
                scene, volume_object, "backdrop", *image_size(depsgraph.scene_eval.render), camera)
        backdrop.show(camera, image, settings.backdrop_depth)
        wish = dict(tolerance=tolerance, refuse_empty_view=False)
        if later and settings.use_previews:
            steps = render_scene.steps(plain, quality, **wish, previews=True)
            following.begin(_refinement(steps, Held(scene), Held(image), made_from))
            return
        _finish(scene, image, drain(render_scene.steps(plain, quality, **wish)), made_from)
    except Exception as problem:  # a traceback from every frame would help no one: one sentence
        _fail(scene, image, problem)


def remove_deleted(scene) -> None:
    """Take the backdrops of deleted volumes out of their cameras, and say so."""
    settings = scene.rle_splat
    gone = {
        row.volume for row in settings.pictures
        if row.kind == "backdrop" and row.volume is not None and presence.is_deleted(row.volume)
    }
    if settings.backdrop_object is not None and presence.is_deleted(settings.backdrop_object):
        gone.add(settings.backdrop_object)
    for row in settings.pictures:
        if row.kind == "backdrop" and row.volume in gone and row.camera is not None:
            entry = backdrop.find(scene, row.camera)
            if entry is not None and entry.image == row.image:
                backdrop.hide(scene, row.camera)
    if settings.backdrop_object in gone:
        following.stop()
        settings.backdrop_object = None
    if gone:
        names = " and ".join(sorted(repr(one.name) for one in gone))
        messages.complain(settings, f"The volume {names} was deleted, so its backdrop was removed.")


def _refinement(steps, scene: Held, image: Held, made_from) -> following.Refinement:
    """A backdrop's work for a timer: what it writes to is found anew each time, or left alone."""

    def with_both(act):
        found = scene.find(), image.find()
        if None not in found:
            act(*found)

    return following.Refinement(
        steps,
        show=lambda rendering: with_both(lambda _scene, one: pictures.show(one, rendering)),
        finish=lambda rendering: with_both(lambda one, other: _finish(one, other, rendering, made_from)),
        fail=lambda problem: with_both(lambda one, other: _fail(one, other, problem)),
        wish=made_from,
    )


def _finish(scene, image, rendering, made_from) -> None:
    """Show the picture, and what it took."""
    pictures.show(image, rendering)
    freshness.note(image, made_from)
    scene.rle_splat.message = ""
    pictures.note_report(scene.rle_splat, rendering.report)


def _hide(scene, volume_object, image) -> None:
    """Show nothing of a volume that is hidden from renders, and say so."""
    if image is not None and freshness.made_from(image) != HIDDEN:
        following.stop()
        images.clear(image)
        freshness.note(image, HIDDEN)
    _say(scene, f"{volume_object.name!r} is hidden from renders, so its backdrop is empty.")


def _fail(scene, image, problem) -> None:
    """Show nothing rather than what is stale, and say why."""
    following.stop()
    if image is not None:
        images.clear(image)
        freshness.note(image, FAILED)
    _say(scene, messages.sentence_of(problem))


def _say(scene, sentence: str) -> None:
    if scene.rle_splat.message != sentence:  # once, not with every redraw
        messages.complain(scene.rle_splat, sentence)
