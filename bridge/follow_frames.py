"""The backdrop that follows the timeline: a fresh picture whenever the frame changes outside a render."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from ..rle_splat.scene import RleSplatError
from ..rle_splat.steps import drain
from . import following, images, messages, pictures, render_scene
from .settings import tolerance_of


@persistent
def _on_frame_change_post(scene, depsgraph=None):
    if depsgraph is None or depsgraph.mode == "RENDER":
        return
    if scene.rle_splat.backdrop_follows and scene.rle_splat.backdrop_object is not None:
        splat_backdrop(scene, depsgraph)


HANDLERS = (("frame_change_post", _on_frame_change_post),)


def splat_backdrop(scene, depsgraph) -> None:
    """Bring the camera's backdrop up to date with the frame; blank and a message on failure."""
    following.stop()
    settings = scene.rle_splat
    volume_object = settings.backdrop_object
    image = bpy.data.images.get((pictures.name_of(volume_object, "backdrop"), None))
    if image is None:
        return
    try:
        if not render_scene.is_rendered(volume_object, depsgraph):
            images.clear(image)
            return
        with_meshes = settings.meshes_occlude and settings.backdrop_depth == "FRONT"
        plain, quality = render_scene.read_scene(volume_object, depsgraph, with_meshes=with_meshes)
        wish = dict(tolerance=tolerance_of(depsgraph.scene_eval), refuse_empty_view=False)
        if settings.use_previews and following.is_moving():
            steps = render_scene.steps(plain, quality, **wish, previews=True)
            following.begin(_refinement(steps, scene.name, image.name))
            return
        _finish(settings, image, drain(render_scene.steps(plain, quality, **wish)))
    except Exception as problem:  # a traceback from every frame would help no one: one sentence
        _blank(settings, image, problem)


def _refinement(steps, scene_name: str, image_name: str) -> following.Refinement:
    """A backdrop's work for a timer: what it writes to is found by name each time, or left alone."""

    def show(rendering):
        with_both(lambda _settings, image: pictures.show(image, rendering))

    def finish(rendering):
        with_both(lambda settings, image: _finish(settings, image, rendering))

    def fail(problem):
        with_both(lambda settings, image: _blank(settings, image, problem))

    def with_both(act):
        scene, image = bpy.data.scenes.get((scene_name, None)), bpy.data.images.get((image_name, None))
        if scene is not None and image is not None:
            act(scene.rle_splat, image)

    return following.Refinement(steps, show, finish, fail)


def _finish(settings, image, rendering) -> None:
    """Show the picture, and what it took."""
    pictures.show(image, rendering)
    settings.message = ""
    pictures.note_report(settings, rendering.report)


def _blank(settings, image, problem) -> None:
    """Show nothing rather than what is stale, and say why."""
    images.clear(image)
    messages.complain(settings, messages.sentence_of(problem))
