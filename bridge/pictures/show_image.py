"""Shows an image of the .blend to the user, as Blender shows a render."""

import bpy

from ..held import Held
from ..loop import timer

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
