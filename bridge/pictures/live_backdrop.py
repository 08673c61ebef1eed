"""The backdrop that follows the scene: it is rendered again whenever something it depends on has changed.

It is shown by the scene's active camera, including a camera that a timeline marker makes active.
"""

from __future__ import annotations

from ...rle_splat.runtime.steps import drain
from .. import messages, presence
from ..data.settings import tolerance_of
from ..held import Held
from ..loop import work
from ..scene import render_scene
from ..scene.camera import camera_object, image_size
from . import backdrop, backdrop_work, images, outdated, pictures

HIDDEN = outdated.MadeFrom("hidden", "", False)  # the volume is hidden from renders
FAILED = outdated.MadeFrom("failed", "", False)


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
        if image is not None and (outdated.made_from(image) == made_from or backdrop_work.is_making(made_from)):
            return
        backdrop_work.stop()
        if image is None:
            image = pictures.find_or_make(
                scene, volume_object, "backdrop", *image_size(depsgraph.scene_eval.render), camera
            )
        backdrop.show(camera, image, settings.backdrop_depth)
        wish = dict(tolerance=tolerance, refuse_empty_view=False)
        if later:
            steps = render_scene.steps(plain, quality, **wish, drafts=True)
            backdrop_work.begin(_refinement(steps, Held(scene), Held(image), made_from))
            return
        _finish(scene, image, drain(render_scene.steps(plain, quality, **wish)), made_from)
    except Exception as problem:  # a handler runs for every frame: one sentence instead of many tracebacks
        _fail(scene, image, problem)


def remove_deleted(scene) -> None:
    """Remove the backdrops of deleted volumes from their cameras, with a message.

    Parameters
    ----------
    scene : bpy.types.Scene
        The scene that owns the backdrops.
    """
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
        backdrop_work.stop()
        messages.complain(settings, f"{messages.the_volume(*gone)} was deleted, so its backdrop was removed.")


def _refinement(steps, scene: Held, image: Held, made_from) -> backdrop_work.Refinement:
    """The work on a backdrop for a timer; scene and image are looked up again at each step, and may be gone."""

    def with_both(act):
        found = scene.find(), image.find()
        if None not in found:
            act(*found)

    return backdrop_work.Refinement(
        steps,
        show=lambda rendering: with_both(lambda _scene, one: pictures.show(one, rendering)),
        finish=lambda rendering: with_both(lambda one, other: _finish(one, other, rendering, made_from)),
        fail=lambda problem: with_both(lambda one, other: _fail(one, other, problem)),
        wish=made_from,
    )


def _finish(scene, image, rendering, made_from) -> None:
    """Show the finished picture and its report."""
    pictures.show(image, rendering)
    outdated.note(image, made_from)
    scene.rle_splat.message = ""
    pictures.note_report(scene.rle_splat, rendering.report)


def _hide(scene, volume_object, image) -> None:
    """Clear the backdrop of a volume that is hidden from renders, with a message."""
    if image is not None and outdated.made_from(image) != HIDDEN:
        backdrop_work.stop()
        images.clear(image)
        outdated.note(image, HIDDEN)
    _say(scene, f"{volume_object.name!r} is hidden from renders, so its backdrop is empty.")


def _fail(scene, image, problem) -> None:
    """Clear the backdrop instead of showing an outdated picture, with a message."""
    backdrop_work.stop()
    if image is not None:
        images.clear(image)
        outdated.note(image, FAILED)
    _say(scene, messages.sentence_of(problem))


def _say(scene, sentence: str) -> None:
    if scene.rle_splat.message != sentence:  # print it once, not at every redraw
        messages.complain(scene.rle_splat, sentence)
