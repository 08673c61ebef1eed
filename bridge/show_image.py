"""Shows an image of the .blend to the user, as Blender shows a render."""

import bpy


def show(context, image) -> bool:
    """Show an image in an image editor that is open, or where Blender shows renders.

    Parameters
    ----------
    context : bpy.types.Context
        Of an operator in a window.
    image : bpy.types.Image
        The image.

    Returns
    -------
    bool
        Whether an editor shows it.
    """
    if _show_in_editor(context, image):
        return True
    try:
        bpy.ops.render.view_show("INVOKE_DEFAULT")
    except RuntimeError:  # no area of the window is free for it
        return False
    return _show_in_editor(context, image)


def _show_in_editor(context, image) -> bool:
    areas = [area for window in context.window_manager.windows for area in window.screen.areas]
    editor = next((area for area in areas if area.type == "IMAGE_EDITOR"), None)
    if editor is None:
        return False
    editor.spaces.active.image = image
    return True
