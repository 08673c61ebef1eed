"""The image that shows a draft while a picture is made, and its restoration when the work is canceled."""

import bpy

from ..held import Held
from . import images, pictures

SHOWN_IN = ("VIEW_3D", "IMAGE_EDITOR", "NODE_EDITOR", "PROPERTIES")  # areas that show our images or settings


class ProgressImage:
    """The image of a picture in progress.

    Datablocks are looked up again for the draft and at the end, since the user may undo in between.

    Parameters
    ----------
    kind : str
        A key of ``pictures.SUFFIXES``.
    """

    def __init__(self, scene: Held, volume_object: Held, kind: str, camera: Held | None = None):
        self._scene, self._volume, self._kind, self._camera = scene, volume_object, kind, camera
        self._image = None  # Held, once a draft is shown
        self._before = None  # the image's pixels before the draft; None if the image is new

    def show(self, rgba):
        """Write a draft into the image: (H, W, 4) premultiplied scene-linear colors, row 0 on top."""
        scene, volume_object = self._scene.get(), self._volume.get()
        camera = self._camera.get() if self._camera else None
        existing = pictures.find(scene, volume_object, self._kind, camera)
        if existing is not None and existing.size[0] > 0:
            self._before = images.read(existing)
        height, width = rgba.shape[:2]
        image = pictures.find_or_make(scene, volume_object, self._kind, width, height, camera)
        self._image = Held(image)
        images.write_color(image, rgba)
        return image

    def put_back(self) -> None:
        """Restore the image as it was before the draft, or remove it if it is new."""
        image = self._image.find() if self._image else None
        if image is None:
            return
        if self._before is None:
            bpy.data.images.remove(image)
            return
        height, width = self._before.shape[:2]
        images.write_color(images.ensure_image(image, image.name, width, height), self._before)


def redraw(context) -> None:
    """Redraw every area that may show our images or settings."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in SHOWN_IN:
                area.tag_redraw()


def redraw_sidebars(context) -> None:
    """Redraw the sidebars of 3D views alone, which show progress, and not the views."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()
