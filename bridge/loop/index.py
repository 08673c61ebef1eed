"""Which volumes and slices each scene has, so that panels, gizmos, redraws and updates look at no object.

The objects of a scene are looked at once after Blender has said that collections changed: that event comes whenever an
object is linked, unlinked, deleted, excluded or instanced.  Where a script has added or removed objects and no event
has come yet, their number says so.  Entries are keys with the session ids of objects, never references.
"""

from typing import NamedTuple

import bpy
from bpy.app.handlers import persistent


class Key(NamedTuple):
    """An object: its name and its library's file find it quickly, its session id says whether it is the same one."""

    name: str
    library: str | None
    session_uid: int


class SceneIndex(NamedTuple):
    """What a scene has.

    Attributes
    ----------
    volumes, slices : tuple of Key
    has_instances : bool
        Whether it shows instances of collections with volumes.
    """

    volumes: tuple = ()
    slices: tuple = ()
    has_instances: bool = False


class _Now:
    """The scenes looked at by session id, how many objects the file had then, and how often a scene was looked at."""

    scenes: dict = {}
    count = 0
    looks = 0


def of(scene) -> SceneIndex:
    """What a scene has."""
    if _Now.count != len(bpy.data.objects):
        forget()
        _Now.count = len(bpy.data.objects)
    uid = scene.session_uid
    if uid not in _Now.scenes:
        _Now.looks += 1
        _Now.scenes[uid] = _look(scene.original)
    return _Now.scenes[uid]


def _look(scene) -> SceneIndex:
    found = [[], []]
    for one in scene.objects:
        for kind, held in zip(("is_volume", "is_slice"), found):
            if getattr(one.rle_splat, kind):
                held.append(key_of(one))
    instancers = (one for one in scene.objects if one.instance_type == "COLLECTION")
    return SceneIndex(*map(tuple, found), any(_shows_volume(one, set()) for one in instancers))


def _shows_volume(instancer, seen: set) -> bool:
    """Whether an instanced collection holds a volume, itself or in an instance."""
    collection = instancer.instance_collection
    if collection is None or collection in seen:
        return False
    seen.add(collection)
    return any(
        one.rle_splat.is_volume or (one.instance_type == "COLLECTION" and _shows_volume(one, seen))
        for one in collection.all_objects
    )


def key_of(one) -> Key:
    """The key of an object."""
    return Key(one.name, None if one.library is None else one.library.filepath, one.session_uid)


def find(key: Key):
    """The object of a key, whatever its name is now; None if it is gone."""
    found = bpy.data.objects.get(key.name if key.library is None else (key.name, key.library))
    if found is not None and found.session_uid == key.session_uid:
        return found
    return next((one for one in bpy.data.objects if one.session_uid == key.session_uid), None)


def objects(keys) -> list:
    """The objects of keys that are still there, sorted by name."""
    return sorted((one for one in map(find, keys) if one is not None), key=lambda one: one.name)


def has_any() -> bool:
    """Whether any scene has volumes, slices or instances of volumes."""
    return any(map(any, map(of, bpy.data.scenes)))


def forget() -> None:
    """Look at each scene again when it is asked for."""
    _Now.scenes.clear()


@persistent
def _on_update(_scene=None, depsgraph=None):
    if depsgraph is None or (depsgraph.mode != "RENDER" and depsgraph.id_type_updated("COLLECTION")):
        forget()


HANDLERS = tuple((event, _on_update) for event in (
    "depsgraph_update_post", "undo_post", "redo_post", "load_post", "blend_import_post"))  # fmt: skip
