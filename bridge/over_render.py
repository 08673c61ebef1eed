"""The volume in every render: a fresh picture for each rendered frame, laid over the render by the compositor.

Blender calls ``frame_change_post`` once more for each view layer of every rendered frame, stills included, with the
evaluated scene of that render and before the compositor reads any image: that is where the volume is splatted.
In a window this runs on the render's own thread.  There only the pixels of an image that the Composite operator
made beforehand are written, no datablock is created or removed, and ``use_lock_interface`` (set by that operator)
keeps the interface from drawing the image meanwhile.
"""

from __future__ import annotations

from bpy.app.handlers import persistent

from ..rle_splat.scene import RleSplatError
from ..rle_splat.steps import drain
from . import compositor, following, images, messages, pictures, render_scene
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
    if depsgraph is None or depsgraph.mode != "RENDER":
        return
    if _splatted is not None and scene.rle_splat.use_composite and scene.name not in _splatted:
        _splatted.add(scene.name)
        splat_over_render(scene, depsgraph)


HANDLERS = (
    ("render_pre", _on_render_pre),
    ("render_post", _on_render_end),
    ("render_cancel", _on_render_end),
    ("frame_change_post", _on_frame_change_post),
)


def splat_over_render(scene, depsgraph) -> None:
    """Bring the picture that the compositor lays over the render up to date; blank and a message on failure."""
    settings = scene.rle_splat
    image = settings.composite_image
    if image is None:
        messages.complain(
            settings, "The picture to lay over the render was deleted; press Composite into Render again.")
        return
    if not compositor.is_inserted(scene):
        messages.complain(
            settings, "The volume's nodes were taken out of the compositor; press Composite into Render again.")
        return
    volume_object = settings.composite_object
    try:
        if volume_object is None:
            raise RleSplatError("The volume was deleted; choose another, or remove it from the compositor.")
        if not render_scene.is_rendered(volume_object, depsgraph):
            images.clear(image)
            return
        plain, quality = render_scene.read_scene(
            volume_object, depsgraph, with_meshes=settings.meshes_occlude, in_region=True)
        rendering = drain(render_scene.steps(
            plain, quality, tolerance=tolerance_of(depsgraph.scene_eval), refuse_empty_view=False))
        pictures.show(image, rendering)
        settings.message = ""
        pictures.note_report(settings, rendering.report)
    except Exception as problem:  # a traceback from every frame of a render would help no one: one sentence, once
        images.clear(image)
        messages.complain(settings, messages.sentence_of(problem))
