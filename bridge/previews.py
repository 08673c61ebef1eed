"""Pictures for panels, kept as icons: they belong to the session, not to the .blend, and are drawn anew when what
they show has changed."""

import bpy.utils.previews
import numpy as np

from ..rle_splat.scene import RleSplatError
from . import facts, histogram_picture
from .transfer import read_transfer, window_of

_collections: list = []  # the one preview collection while the extension is registered
_drawn: dict = {}  # object's session uid -> what its picture shows


def register():
    _collections.append(bpy.utils.previews.new())


def unregister():
    bpy.utils.previews.remove(_collections.pop())
    _drawn.clear()


def histogram_icon(volume_object) -> int:
    """The icon id of the object's histogram with its transfer function over it; 0 when there is nothing to show.

    Reads only what is kept on the object, so a panel may call it on every redraw.
    """
    if not _collections:
        return 0
    properties = volume_object.rle_splat
    try:
        transfer_function = read_transfer(volume_object)
    except RleSplatError:
        return 0
    name = str(volume_object.session_uid)
    window = window_of(properties)
    shown = (transfer_function.classification_key, window, hash(properties.histogram))
    collection = _collections[-1]
    if name not in collection:
        collection.new(name)
        _drawn.pop(name, None)
    preview = collection[name]
    if _drawn.get(name) != shown:
        picture = histogram_picture.draw(facts.stored_histogram(properties), transfer_function, *window)
        preview.image_size = (histogram_picture.WIDTH, histogram_picture.HEIGHT)
        preview.image_pixels_float.foreach_set(np.ascontiguousarray(picture).ravel())
        _drawn[name] = shown
    return preview.icon_id
