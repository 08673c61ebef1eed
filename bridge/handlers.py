"""What happens by itself: a fresh picture for every rendered frame, a backdrop that follows, pictures packed on save.

Blender calls ``frame_change_post`` once more for each view layer of every rendered frame, stills included, with the
evaluated scene of that render and before the compositor reads any image: that is where the volume is splatted.
In a window this runs on the render's own thread.  There only the pixels of an image that the Composite operator
made beforehand are written, no datablock is created or removed, and ``use_lock_interface`` (set by that operator)
keeps the interface from drawing the image meanwhile.
"""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from ..rle_splat.scene import RleSplatError
from ..rle_splat.steps import drain
from . import compositor, following, images, pictures, render_scene, volumes
from .settings import tolerance_of

# Scenes whose volume is splatted for the frame being rendered; None while nothing is rendered (exporters change
# frames with a render's depsgraph too).  Further view layers, and the subframes that motion blur visits after the
# frame itself, use the same picture.
_splatted: set[str] | None = None


@persistent
def _on_render_pre(*_arguments):
    global _splatted
    _splatted = set()
    following.stop()


@persistent
def _on_render_end(*_arguments):
    global _splatted
    _splatted = None


@persistent
def _on_frame_change_post(scene, depsgraph=None):
    if depsgraph is None:
        return
    if depsgraph.mode == "RENDER":
        if _splatted is not None and scene.rle_splat.use_composite and scene.name not in _splatted:
            _splatted.add(scene.name)
            splat_over_render(scene, depsgraph)
    elif scene.rle_splat.backdrop_follows and scene.rle_splat.backdrop_object is not None:
        splat_backdrop(scene, depsgraph)


@persistent
def _on_save_pre(*_arguments):
    images.pack_unsaved()


@persistent
def _on_load_pre(*_arguments):
    following.stop()
    render_scene.forget_stages()
    volumes.forget_all()


HANDLERS = (
    ("render_pre", _on_render_pre),
    ("render_post", _on_render_end),
    ("render_cancel", _on_render_end),
    ("frame_change_post", _on_frame_change_post),
    ("save_pre", _on_save_pre),
    ("load_pre", _on_load_pre),
)


def splat_over_render(scene, depsgraph) -> None:
    """Bring the picture that the compositor lays over the render up to date; blank and a message on failure."""
    settings = scene.rle_splat
    image = settings.composite_image
    if image is None:
        _complain(settings, "The picture to lay over the render was deleted; press Composite into Render again.")
        return
    if not compositor.is_inserted(scene):
        _complain(settings, "The volume's nodes were taken out of the compositor; press Composite into Render again.")
        return
    _update(scene, depsgraph, settings.composite_object, image, with_meshes=settings.meshes_occlude, in_region=True)


def splat_backdrop(scene, depsgraph) -> None:
    """Bring the camera's backdrop up to date with the frame; blank and a message on failure."""
    following.stop()
    settings = scene.rle_splat
    image = bpy.data.images.get((pictures.name_of(settings.backdrop_object, "backdrop"), None))
    if image is not None:
        with_meshes = settings.meshes_occlude and settings.backdrop_depth == "FRONT"
        later = settings.use_previews and following.is_moving()
        _update(
            scene, depsgraph, settings.backdrop_object, image, with_meshes=with_meshes, in_region=False, later=later
        )


def _update(scene, depsgraph, volume_object, image, *, with_meshes: bool, in_region: bool, later: bool = False) -> None:
    """``later``: the picture may be made after the frame, and previews shown until it is there."""
    settings = scene.rle_splat
    try:
        if volume_object is None:
            raise RleSplatError("The volume was deleted; choose another, or remove it from the compositor.")
        if not render_scene.is_rendered(volume_object, depsgraph):
            images.clear(image)
            return
        plain, quality = render_scene.read_scene(
            volume_object, depsgraph, with_meshes=with_meshes, in_region=in_region
        )
        wish = dict(tolerance=tolerance_of(depsgraph.scene_eval))
        if later:
            steps = render_scene.steps(plain, quality, **wish, refuse_empty_view=False, previews=True)
            following.begin(_refinement(steps, scene.name, image.name))
            return
        _finish(settings, image, drain(render_scene.steps(plain, quality, **wish, refuse_empty_view=False)))
    except Exception as problem:  # a traceback from every frame of a render would help no one: one sentence, once
        _blank(settings, image, problem)


def _refinement(steps, scene_name: str, image_name: str) -> following.Refinement:
    """A backdrop's work for a timer: what it writes to is found by name each time, or left alone."""

    def show(rendering):
        with_both(lambda _settings, image: _show(image, rendering))

    def finish(rendering):
        with_both(lambda settings, image: _finish(settings, image, rendering))

    def fail(problem):
        with_both(lambda settings, image: _blank(settings, image, problem))

    def with_both(act):
        scene, image = bpy.data.scenes.get((scene_name, None)), bpy.data.images.get((image_name, None))
        if scene is not None and image is not None:
            act(scene.rle_splat, image)

    return following.Refinement(steps, show, finish, fail)


def _show(image, rendering) -> None:
    height, width = rendering.depth.shape
    images.write_color(images.ensure_image(image, image.name, width, height), rendering.rgba)


def _finish(settings, image, rendering) -> None:
    """Show the picture, and what it took."""
    _show(image, rendering)
    settings.message = ""
    pictures.note_report(settings, rendering.report)


def _blank(settings, image, problem) -> None:
    """Show nothing rather than what is stale, and say why."""
    images.clear(image)
    known = isinstance(problem, RleSplatError)
    _complain(settings, str(problem) if known else f"The volume was not splatted: {problem!r}.")


def _complain(settings, sentence: str) -> None:
    settings.message = sentence
    print(f"RLE Splat: {sentence}")


def register():
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)


def unregister():
    for name, handler in reversed(HANDLERS):
        getattr(bpy.app.handlers, name).remove(handler)
    following.stop()
    render_scene.forget_stages()
