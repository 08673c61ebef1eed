"""Shows images of the .blend: the draft of a picture in progress, and a finished one as Blender shows a render."""

from __future__ import annotations

import bpy

from ..held import Held
from ..loop import timer
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


SOON = 0.01  # seconds


def show_soon(image) -> None:
    """Show an image in an image editor that is open, or where Blender shows renders, once the operator has ended.

    Blender handles further events while it opens a window, and would call a modal operator in the middle of its end.
    """
    held = Held(image)

    def show():
        found = held.find()
        if found is not None:
            _show(found)

    timer.start(show, SOON)


def show_in_editor(image) -> bool:
    """Show an image in the first image editor; return whether one is open."""
    editor = _editor()
    if editor is None:
        return False
    editor.spaces.active.image = image
    editor.tag_redraw()
    return True


def image_in_editor():
    """The image that the first image editor shows; None without one."""
    editor = _editor()
    return None if editor is None else editor.spaces.active.image


def _show(image) -> None:
    if show_in_editor(image):
        return
    try:
        with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
            bpy.ops.render.view_show("INVOKE_DEFAULT")
    except RuntimeError:  # no area of the window is free for it
        return
    show_in_editor(image)


def _editor():
    """The first open area that is an image editor, or None."""
    areas = [area for window in bpy.context.window_manager.windows for area in window.screen.areas]
    return next((area for area in areas if area.type == "IMAGE_EDITOR"), None)
