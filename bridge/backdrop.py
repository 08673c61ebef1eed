"""A picture as the active camera's background image, matched to the frame pixel by pixel.

Blender stretches a background image with frame method Stretch over exactly the camera's frame, shift, sensor fit
and pixel aspect included.  Fit and Crop take the image's own aspect for square pixels and miss the frame as soon
as the pixel aspect is not 1; the default differs between versions.
"""

from __future__ import annotations

import bpy

from . import images

# What ``show`` sets of an entry, besides its source, image and offset.
RESTORED = (
    "alpha", "display_depth", "frame_method", "scale", "rotation", "use_flip_x", "use_flip_y", "show_background_image",
)


def show(camera_data, image, place: str):
    """Show ``image`` in the camera's frame, ``place`` "BACK" or "FRONT"; reuses the entry of an earlier call."""
    entry = find(camera_data) or camera_data.background_images.new()
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
    camera_data.show_background_images = True
    image.use_view_as_render = True  # the scene's view transform, so that it looks as it will in the render
    return entry


def state(camera_data) -> tuple:
    """How the camera shows a picture of ours, for ``restore``; holds no reference to a datablock."""
    entry = find(camera_data)
    if entry is None:
        return camera_data.show_background_images, None, ""
    values = {name: getattr(entry, name) for name in RESTORED}
    return camera_data.show_background_images, {**values, "offset": tuple(entry.offset)}, entry.image.name


def restore(camera_data, earlier: tuple) -> None:
    """Show what was shown when ``state`` was called, or nothing of ours."""
    background_images, values, image_name = earlier
    entry, image = find(camera_data), bpy.data.images.get((image_name, None))
    if values is None or image is None:
        hide(camera_data)
    elif entry is not None:
        for name, value in values.items():
            setattr(entry, name, value)
        entry.image = image
    camera_data.show_background_images = background_images


def hide(camera_data) -> bool:
    """Remove our entries; background images of the user's stay.  Whether there was one."""
    found = False
    while (entry := find(camera_data)) is not None:
        camera_data.background_images.remove(entry)
        found = True
    return found


def find(camera_data):
    """Our entry among the camera's background images, or None."""
    for entry in camera_data.background_images:
        if entry.source == "IMAGE" and entry.image is not None and images.MARK in entry.image:
            return entry
    return None
