"""The image that shows previews while a picture is made, and how it is given back when the picture does not come."""

from __future__ import annotations

import bpy

from . import images, pictures
from .held import Held

SHOWN_IN = ("VIEW_3D", "IMAGE_EDITOR", "NODE_EDITOR", "PROPERTIES")  # areas that show images or settings of ours


class Canvas:
    """A picture of a scene's, on loan: ``scene``, ``volume_object`` and ``camera`` are Held, the last may be None.

    Everything is found anew each time, since a user may undo meanwhile.
    """

    def __init__(self, scene: Held, volume_object: Held, kind: str, camera: Held | None = None):
        self._scene, self._volume, self._kind, self._camera = scene, volume_object, kind, camera
        self._image = None  # Held, once a preview was shown
        self._before = None  # what the image held, None for one that was made for the previews

    def show(self, rgba):
        """Write a preview, (H, W, 4) float32, row 0 on top; returns the image."""
        scene, volume_object = self._scene.get(), self._volume.get()
        camera = self._camera.get() if self._camera else None
        if self._image is None:
            existing = pictures.find(scene, volume_object, self._kind, camera)
            if existing is not None and existing.size[0] > 0:
                self._before = images.read(existing)
        height, width = rgba.shape[:2]
        image = pictures.find_or_make(scene, volume_object, self._kind, width, height, camera)
        self._image = Held(image)
        images.write_color(image, rgba)
        return image

    def put_back(self) -> None:
        """Leave the image as it was before the first preview, or take it away if it was not there."""
        image = self._image.find() if self._image else None
        if image is None:
            return
        if self._before is None:
            bpy.data.images.remove(image)
            return
        height, width = self._before.shape[:2]
        images.write_color(images.ensure_image(image, image.name, width, height), self._before)


def redraw(context) -> None:
    """Have every area that may show the image or its settings drawn again."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in SHOWN_IN:
                area.tag_redraw()
