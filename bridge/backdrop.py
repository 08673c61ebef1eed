"""A picture as a camera's background image, matched to the frame pixel by pixel.

Blender stretches a background image with frame method Stretch over exactly the camera's frame, shift, sensor fit
and pixel aspect included.  Fit and Crop take the image's own aspect for square pixels and miss the frame as soon
as the pixel aspect is not 1; the default differs between versions.
"""

from __future__ import annotations

import bpy

from . import pictures
from .held import Held

# What ``show`` sets of an entry, besides its source, image and offset.
RESTORED = (
    "alpha", "display_depth", "frame_method", "scale", "rotation", "use_flip_x", "use_flip_y", "show_background_image",
)


def show(camera, image, place: str):
    """Show ``image`` in the camera's frame, ``place`` "BACK" or "FRONT"; reuses the entry of an earlier call."""
    entry = _find_of_any_scene(camera) or camera.data.background_images.new()
    entry.source = "IMAGE"
    entry.image = image
    entry.alpha = 1.0
    entry.display_depth = place
    entry.frame_method = "STRETCH"
    entry.offset = (0.0, 0.0)
    entry.scale = 1.0
    entry.rotation = 0.0
    entry.use_flip_x = entry.use_flip_y = False
    entry.show_background_image = True
    camera.data.show_background_images = True
    image.use_view_as_render = True  # the scene's view transform, so that it looks as it will in the render
    camera.data.update_tag()  # or views go on drawing what the evaluated camera had
    return entry


def state(scene, camera) -> tuple:
    """How the camera shows a picture of ours, for ``restore``; holds no reference to a datablock."""
    entry = find(scene, camera)
    if entry is None:
        return camera.data.show_background_images, None, None
    values = {name: getattr(entry, name) for name in RESTORED}
    return camera.data.show_background_images, {**values, "offset": tuple(entry.offset)}, Held(entry.image)


def restore(scene, camera, earlier: tuple) -> None:
    """Show what was shown when ``state`` was called, or nothing of ours."""
    background_images, values, held = earlier
    entry, image = find(scene, camera), held.find() if held else None
    if values is None or image is None:
        hide(scene, camera)
    elif entry is not None:
        for name, value in values.items():
            setattr(entry, name, value)
        entry.image = image
    camera.data.show_background_images = background_images
    camera.data.update_tag()


def hide(scene, camera) -> bool:
    """Remove the scene's entry; background images of the user's stay.  Whether there was one."""
    entry = find(scene, camera)
    if entry is not None:
        camera.data.background_images.remove(entry)
        camera.data.update_tag()
    return entry is not None


def find(scene, camera):
    """The entry among the camera's background images that shows a backdrop of the scene's, or None."""
    shown = {row.image for row in scene.rle_splat.pictures if row.kind == "backdrop"}
    for entry in camera.data.background_images:
        if entry.source == "IMAGE" and entry.image in shown and pictures.owned_by(entry.image, scene):
            return entry
    return None


def _find_of_any_scene(camera):
    """As ``find``, for any scene: scenes that share a camera take turns with one entry."""
    found = (find(scene, camera) for scene in bpy.data.scenes)
    return next((entry for entry in found if entry is not None), None)
