"""Pictures for panels, kept as icons: they belong to the session, not to the .blend, and are drawn anew when what
they show has changed."""

import bpy.utils.previews

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


def histogram_icons(volume_object) -> list[int]:
    """Icon ids of the tiles, left to right, of the object's histogram with its transfer function over it.

    Empty when there is nothing to show.  Reads only what is kept on the object, so a panel may call it on every
    redraw.
    """
    if not _collections:
        return []
    properties = volume_object.rle_splat
    try:
        transfer_function = read_transfer(volume_object)
    except RleSplatError:
        return []
    name = str(volume_object.session_uid)
    window = window_of(properties)
    shown = (transfer_function.classification_key, window, hash(properties.histogram))
    collection = _collections[-1]
    tiles = [f"{name} {i}" for i in range(histogram_picture.TILES)]
    for tile in tiles:
        if tile not in collection:
            collection.new(tile)
            _drawn.pop(name, None)
    if _drawn.get(name) != shown:
        picture = histogram_picture.draw(facts.stored_histogram(properties), transfer_function, *window)
        for tile, part in zip(tiles, histogram_picture.tiles_of(picture)):
            collection[tile].image_size = part.shape[1::-1]
            collection[tile].image_pixels_float.foreach_set(part.ravel())
        _drawn[name] = shown
    return [collection[tile].icon_id for tile in tiles]
