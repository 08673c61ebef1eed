"""A picture as a background image of a camera, aligned with the camera's frame to the pixel.

With the frame method Stretch, Blender covers exactly the camera's frame, including shift, sensor fit and pixel aspect.
Fit and Crop assume square pixels and miss the frame when the pixel aspect is not 1.  The default differs between
Blender versions, so it is always set.
"""

import bpy

from . import pictures

PLACES = [
    ("BACK", "Behind", "Show the picture behind the objects"),
    ("FRONT", "In Front", "Show the picture in front of the objects, except where a mesh hides the volume"),
]


def show(camera, image, place: str):
    """Show an image in the camera's frame, in front of the objects or behind them; ``place`` is one of PLACES.

    The background image of an earlier call is reused.
    """
    # Scenes that share a camera use one entry in turn.
    known = (find(scene, camera) for scene in bpy.data.scenes)
    entry = next(filter(None, known), None) or camera.data.background_images.new()
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
    image.use_view_as_render = True  # apply the scene's view transform, as in the render
    camera.data.update_tag()  # otherwise views keep drawing the evaluated camera's old entry
    return entry


def hide(scene, camera) -> bool:
    """Remove the scene's backdrop from the camera, not the user's images; return whether there was one."""
    entry = find(scene, camera)
    if entry is not None:
        camera.data.background_images.remove(entry)
        camera.data.update_tag()
    return entry is not None


def find(scene, camera):
    """The camera's background image that shows a backdrop of the scene, or None."""
    shown = {row.image for row in scene.rle_splat.pictures if row.kind == "backdrop"}
    for entry in camera.data.background_images:
        if entry.source == "IMAGE" and entry.image in shown and pictures.owned_by(entry.image, scene):
            return entry
    return None
