"""What tells that the pixels of an image, or the nodes of a world, have changed, without reading an image from a file.

Blender sends an event for an image that is painted or reloaded, but none where a script writes pixels.  An image with
unsaved pixels is therefore known by their hash, which is taken anew after each event and before each picture.
"""

import hashlib

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..volumes import file_changes

_events: dict = {}  # session id of a world or an image -> number of its updates so far
_hashes: dict = {}  # session id of an image -> (number of its updates, hash of its pixels)


@persistent
def _on_update(_scene=None, depsgraph=None):
    if depsgraph is None or not (depsgraph.id_type_updated("WORLD") or depsgraph.id_type_updated("IMAGE")):
        return
    for update in depsgraph.updates:
        if isinstance(update.id, (bpy.types.World, bpy.types.Image)):
            uid = update.id.original.session_uid
            _events[uid] = _events.get(uid, 0) + 1


HANDLERS = (("depsgraph_update_post", _on_update),)


def events_of(one) -> int:
    """How often Blender has said that a world or an image has changed, since the file was opened.

    A world counts what happens to its nodes and to their images, too.
    """
    return _events.get(one.original.session_uid, 0)


def state_of(image, frame: int = 0) -> tuple:
    """What is the same as long as an image is, in later sessions too.

    The frame of the scene counts for movies and sequences.
    """
    image = image.original
    return (
        image.name, image.source, image.filepath, tuple(image.size), image.colorspace_settings.name, image.alpha_mode,
        image.generated_type, tuple(image.generated_color), image.source in ("MOVIE", "SEQUENCE") and frame,
        tuple(one.packed_file.size for one in image.packed_files), _file_of(image),
        _hash_of(image) if image.is_dirty else "",
    )  # fmt: skip


def look_again() -> None:
    """Read unsaved pixels again when they are asked for; before a picture is made."""
    _hashes.clear()


def forget() -> None:
    """Forget all, before another file is opened."""
    _hashes.clear()
    _events.clear()


def _file_of(image) -> tuple:
    """Size and time of an image's file; () without one."""
    if not image.filepath or image.packed_files:
        return ()
    try:
        return file_changes.state_of(bpy.path.abspath(image.filepath, library=image.library))
    except OSError:
        return ()


def _hash_of(image) -> str:
    events, found = _hashes.get(image.session_uid, (None, ""))
    if events != events_of(image):
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        found = hashlib.blake2b(pixels, digest_size=16).hexdigest()
        _hashes[image.session_uid] = events_of(image), found
    return found
