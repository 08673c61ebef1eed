"""All that was read of files: voxels, label maps, channels on a volume's grid, values of slices, the light of images.

Entries are keyed by their content.  For each purpose and in each scene an object wants the entry that it asked for
last, and an entry stays in memory while an object wants it.  Frames that were read ahead stay, too.  Beyond MOST_BYTES
these go, and what objects want that no window shows, the least recently used first.  No reference to a Blender
datablock is stored.
"""

from typing import NamedTuple

import bpy
from bpy.app.handlers import persistent

from ...rle_splat.pipeline.stage_cache import LEAST_BYTES, SHARE
from ...rle_splat.runtime.memory import total_bytes
from ...rle_splat.volume.mapped_files import is_mapped
from .. import presence

MOST_BYTES = max(LEAST_BYTES, int(SHARE * total_bytes()))


class Wish(NamedTuple):
    """One entry is wanted for each.

    Attributes
    ----------
    owner, scene : int
        Session ids of the object or the world that shows the entry, and of the scene whose time it is read for.
    purpose : object
        "voxels", "labels", "light", "thumbnails", "opaque", ("slice", whether with all pixels), (FRAME, key), or the
        session id of a channel's object.
    """

    owner: int
    scene: int
    purpose: object


ANY = 0  # in place of a scene: the entry is that of any time
FRAME = "frame"  # of the purpose (FRAME, key): a time point, or its labels, that its object may show next

_entries: dict = {}  # key -> value
_wanted: dict = {}  # Wish -> key, the least recently used first


def wish_of(owner, depsgraph, purpose) -> Wish:
    """The wish of an object; ``depsgraph`` gives the scene, None is the current one."""
    scene = bpy.context.scene if depsgraph is None else depsgraph.scene
    return Wish(owner.session_uid, scene.session_uid, purpose)


def find(key):
    """The value of a key; None if it is not in memory."""
    return _entries.get(key)


def has_any(wish: Wish) -> bool:
    """Whether the entry that was wanted last is in memory."""
    return _wanted.get(wish) in _entries


def steps(wish: Wish, key: tuple, make_steps):
    """Generator: the value of a key, from memory or made by the generator ``make_steps()``; it is now wanted."""
    value = _entries.get(key)
    if value is None:
        value = yield from make_steps()
    put(wish, key, value)
    return value


def put(wish: Wish, key: tuple, value) -> None:
    """Store a value that is now wanted in place of another one."""
    is_new = key not in _entries
    _wanted.pop(wish, None)  # to the end
    _wanted[wish] = key  # before the entry, which a render's thread might drop
    _entries[key] = value
    _drop_unwanted()
    if is_new:
        _keep_within(MOST_BYTES, wish)


def withdraw(wishes) -> None:
    """Drop what nothing but these wishes wants."""
    for wish in wishes:
        _wanted.pop(wish, None)
    _drop_unwanted()


def withdraw_others(owner, depsgraph, purposes) -> None:
    """Drop what an object wanted in a scene for other purposes than these."""
    mine = wish_of(owner, depsgraph, None)[:2]
    withdraw([wish for wish in list(_wanted) if wish[:2] == mine and wish.purpose not in purposes])


def forget_deleted() -> None:
    """Drop what only deleted objects and scenes wanted."""
    wishes = [wish for wish in _wanted if wish.owner]
    owners, scenes = {wish.owner for wish in wishes}, {ANY, *(one.session_uid for one in bpy.data.scenes)}
    held = {one.session_uid for one in bpy.data.objects if one.session_uid in owners and not presence.is_deleted(one)}
    held.update(one.session_uid for one in bpy.data.worlds)
    withdraw([wish for wish in wishes if not (wish.owner in held and wish.scene in scenes)])


def forget_all() -> None:
    """Forget everything."""
    _entries.clear()
    _wanted.clear()


def has_room(owner) -> bool:
    """Whether one more frame of a volume object, with its labels, leaves the others in memory."""
    shown = {key for wish, key in _wanted.items() if wish.owner == owner.session_uid and not _is_of_frame(wish)}
    return nbytes() + sum(_bytes_of(_entries.get(key)) for key in shown) <= MOST_BYTES


def nbytes() -> int:
    """Bytes of all entries; what lies in mapped files does not count."""
    return sum({id(value): _bytes_of(value) for value in _entries.values()}.values())


def _bytes_of(value) -> int:
    volume = getattr(value, "volume", value)  # of a label map
    if not hasattr(volume, "holds_values"):  # of slices; the light of an image is a few numbers
        return sum(map(_bytes_of, value)) if isinstance(value, tuple) else getattr(value, "nbytes", 0)
    if volume.holds_values:
        return 0 if is_mapped(volume.voxels) else volume.voxels.nbytes
    return volume.nbytes


def _drop_unwanted() -> None:
    wanted = set(_wanted.copy().values())
    for key in [key for key in list(_entries) if key not in wanted]:
        _entries.pop(key, None)


def _keep_within(most: int, newest: Wish) -> None:
    """Drop what no window shows, while there are more bytes: of other objects, and other frames; not the newest."""
    if nbytes() <= most or bpy.app.background or bpy.app.is_job_running("RENDER"):
        return
    shown = {*_shown_objects(), newest.owner}
    for wish in list(_wanted):
        if nbytes() <= most:
            break
        if wish.owner not in shown or (_is_of_frame(wish) and wish != newest):
            withdraw([wish])


def _is_of_frame(wish: Wish) -> bool:
    return isinstance(wish.purpose, tuple) and wish.purpose[0] == FRAME


def frame_wish(owner, key: tuple) -> Wish:
    """The wish for a time point of an object, or for its labels."""
    return Wish(owner.session_uid, ANY, (FRAME, key))


def _shown_objects() -> set:
    """Session ids of the objects in all windows, of what slices and backdrops there show, and of their channels."""
    shown = set()
    for window in bpy.context.window_manager.windows:
        shown.add(window.scene.rle_splat.backdrop_object)
        depsgraph = window.view_layer.depsgraph
        for instance in () if depsgraph is None else depsgraph.object_instances:
            shown |= {instance.object.original, instance.object.original.parent}
    shown.discard(None)
    sources = {row.source for one in shown for row in one.rle_splat.channels if row.source is not None}
    return {one.session_uid for one in shown | sources}


@persistent
def _on_update(_scene=None, depsgraph=None):
    """Handler: deleting, unlinking and undo change collections."""
    if _wanted and (depsgraph is None or (depsgraph.mode != "RENDER" and depsgraph.id_type_updated("COLLECTION"))):
        forget_deleted()


HANDLERS = (("depsgraph_update_post", _on_update), ("undo_post", _on_update), ("redo_post", _on_update))
