"""The picture of the histogram for the panel, as an icon of the session that is redrawn when its content changes."""

import bpy.utils.previews

from ...rle_splat.scene import RleSplatError
from ..volumes import facts
from . import histogram_picture
from .transfer import read_transfer, window_of

_collections: list = []  # the one preview collection while the extension is registered
_drawn: dict = {}  # object's session uid -> what its picture shows


def register():
    _collections.append(bpy.utils.previews.new())


def unregister():
    bpy.utils.previews.remove(_collections.pop())
    _drawn.clear()


def histogram_icon(volume_object, share: float) -> int:
    """The icon of a volume's histogram, ``histogram_picture.draw``; 0 without a transfer function or a window.

    It reads only properties of the object, so a panel may call it at every redraw.  ``share``: height of the curve,
    which the histogram is to fill, over the icon's width.
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
    height = min(round(histogram_picture.WIDTH * share), histogram_picture.WIDTH)
    shown = (transfer_function.classification_key, window, hash(properties.histogram), height)
    collection = _collections[-1]
    if name not in collection:
        collection.new(name)
        _drawn.pop(name, None)
    if _drawn.get(name) != shown:
        icon = histogram_picture.draw(facts.stored_histogram(properties), transfer_function, *window, height)
        collection[name].image_size = icon.shape[1::-1]
        collection[name].image_pixels_float.foreach_set(icon.ravel())
        _drawn[name] = shown
    return collection[name].icon_id
