"""Migration of .blend files of version 0.1.0, which found pictures by name: adds the rows and owners they lack."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from . import compositor, images, pictures, volumes


@persistent
def _on_load_post(*_):
    for scene in bpy.data.scenes:
        if scene.library is None and not scene.rle_splat.scene_id:
            _adopt(scene)


HANDLERS = (("load_post", _on_load_post),)


def _adopt(scene) -> None:
    """Add rows and owners for the pictures of a scene and its cameras."""
    settings = scene.rle_splat
    if settings.backdrop_object is not None:
        for camera in (one for one in scene.objects if one.type == "CAMERA"):
            for entry in camera.data.background_images:
                if entry.source == "IMAGE":
                    _adopt_image(scene, entry.image, "backdrop", settings.backdrop_object, camera)
    for image in compositor.images_of(scene):
        pictures.own(image, scene)
    for owner in volumes.volume_objects(scene):
        for kind in ("color", "depth", "error", "shadow"):
            name = f"{owner.name[:pictures.LONGEST_NAME]} {pictures.SUFFIXES[kind]}"
            _adopt_image(scene, bpy.data.images.get((name, None)), kind, owner)


def _adopt_image(scene, image, kind: str, volume_object, camera=None) -> None:
    if image is None or image.library is not None or images.MARK not in image or pictures.OWNER in image:
        return
    pictures.own(image, scene)
    pictures.add_row(scene, kind, volume_object, camera, image)
