"""The image that shows previews while a picture is made, and how it is given back when the picture does not come."""

from __future__ import annotations

import bpy

from . import images, pictures, render_scene

SHOWN_IN = ("VIEW_3D", "IMAGE_EDITOR", "NODE_EDITOR")  # areas that images of ours are looked at in


class Canvas:
    """A volume's image of one kind, a key of ``pictures.SUFFIXES``, on loan.

    Everything is found by name each time: no reference to a datablock survives undo, which a user may do meanwhile.
    """

    def __init__(self, volume_name: str, kind: str):
        self._volume_name, self._kind = volume_name, kind
        self._image_name = ""  # once a preview was shown
        self._before = None  # what the image held, None for one that was made for the previews
        self._was_packed = False

    def show(self, rgba):
        """Write a preview, (H, W, 4) float32, row 0 on top; returns the image."""
        volume_object = render_scene.still_there(self._volume_name)
        if not self._image_name:
            existing = pictures.find(volume_object, self._kind)
            if existing is not None and existing.size[0] > 0:
                self._before = images.read(existing)
                self._was_packed = existing.packed_file is not None and not existing.is_dirty
        height, width = rgba.shape[:2]
        image = pictures.find_or_make(volume_object, self._kind, width, height)
        self._image_name = image.name
        images.write_color(image, rgba)
        return image

    def put_back(self) -> None:
        """Leave the image as it was before the first preview, or take it away if it was not there."""
        image = bpy.data.images.get((self._image_name, None))
        if image is None:
            return
        if self._before is None:
            bpy.data.images.remove(image)
            return
        height, width = self._before.shape[:2]
        images.write_color(images.ensure_image(image, image.name, width, height), self._before)
        if self._was_packed:
            images.pack(image)


def redraw(context) -> None:
    """Have every area that may show the image drawn again."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in SHOWN_IN:
                area.tag_redraw()
