"""Histogram pictures for the panel, as icons that belong to the session and are redrawn when their content changes."""

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
    """The icons of a volume's histogram.

    It reads only properties of the object, so a panel may call it at every redraw.

    Parameters
    ----------
    volume_object : bpy.types.Object
        The volume object.

    Returns
    -------
    list of int
        Icon ids of the tiles, left to right; empty without a transfer function.
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
