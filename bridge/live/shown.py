"""Which volumes a viewport shows, and the stamp that tells when anything may have changed.

Whether volumes are shown live is the viewport's own switch for volumes among Blender's object type filters.  It belongs
to the 3D view, so Blender saves it with the screen, copies it when an area is split and keeps it through undo.  A
property of ours could only be stored in the scene or the screen by the number of an area, which changes with every area
that is joined or split, or by an address in memory, which another file gives to another view.
"""

from __future__ import annotations

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..scene import placements
from ..volumes import volumes

SWITCH = "show_object_viewport_volume"  # of a SpaceView3D


class _Now:
    """The number of events so far, and the volumes of each scene as of one of them."""

    stamp = 0
    known: dict = {}  # session id of a scene -> (stamp, keys of its volume objects)
    instancers: dict = {}  # session id of a scene -> (stamp, whether it shows instances of volumes)
    instances: dict = {}  # (session id of a scene, name of a view layer) -> (stamp, keys of instances of volumes)


@persistent
def _on_event(*_arguments):
    _Now.stamp += 1


@persistent
def _on_update(_scene=None, depsgraph=None):
    if depsgraph is None or depsgraph.mode != "RENDER":
        _Now.stamp += 1


HANDLERS = (
    ("depsgraph_update_post", _on_update),
    ("frame_change_post", _on_update),
    ("undo_post", _on_event),
    ("redo_post", _on_event),
    ("load_post", _on_event),
)


def stamp() -> int:
    """A number that differs after every event that may have changed a scene."""
    return _Now.stamp


def volume_keys(scene) -> tuple:
    """Keys of the volume objects of a scene, for ``find``; looked up once after each event."""
    at, found = _Now.known.get(scene.session_uid, (None, ()))
    if at != _Now.stamp:
        found = tuple(_key(owner) for owner in volumes.volume_objects(scene))
        _Now.known[scene.session_uid] = _Now.stamp, found
    return found


def has_volumes(scene) -> bool:
    """Whether a scene shows volumes, or instances of volumes."""
    return bool(volume_keys(scene)) or _has_instances(scene)


def _has_instances(scene) -> bool:
    at, found = _Now.instancers.get(scene.session_uid, (None, False))
    if at != _Now.stamp:
        found = any(_shows_volume(one, set()) for one in scene.objects if one.instance_type == "COLLECTION")
        _Now.instancers[scene.session_uid] = _Now.stamp, found
    return found


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


def _instance_keys(scene, view_layer) -> tuple:
    """Keys of the instances of volumes: that of the volume, the instancer's, and the matrix."""
    if view_layer.depsgraph is None or not _has_instances(scene):
        return ()
    of = scene.session_uid, view_layer.name
    at, found = _Now.instances.get(of, (None, ()))
    if at != _Now.stamp:
        placed = [one for one in placements.placements(view_layer.depsgraph) if one.instancer is not None]
        found = tuple(
            (*_key(one.owner), _key(one.instancer), tuple(one.matrix.ravel().tolist())) for one in placed
        )
        _Now.instances[of] = _Now.stamp, found
    return found


def find(key: tuple):
    """The object of a key, None if it is gone."""
    name, library = key[:2]
    return bpy.data.objects.get(name if library is None else (name, library))


def matrix_of(key: tuple) -> np.ndarray | None:
    """(4, 4) matrix of the key of an instance; None for the key of a volume itself."""
    return np.array(key[3]).reshape(4, 4) if len(key) > 2 else None


def visible_volumes(scene, view_layer, space) -> tuple:
    """Keys of the volumes that a viewport shows.

    Parameters
    ----------
    scene : bpy.types.Scene
        The scene.
    view_layer : bpy.types.ViewLayer
        Its view layer.
    space : bpy.types.SpaceView3D
        The viewport, whose local view, collections and object type filters count.

    Returns
    -------
    tuple
    """
    if not is_on(space):
        return ()
    found = []
    for key in volume_keys(scene):
        owner = find(key)
        if owner is not None and owner.visible_get(view_layer=view_layer, viewport=space):
            found.append(key)
    for key in _instance_keys(scene, view_layer):
        instancer = find(key[2])
        if instancer is not None and instancer.visible_get(view_layer=view_layer, viewport=space):
            found.append(key)
    if len(found) > 1:
        added = [_key(one) for one in placements.as_channels([find(key) for key in found])]
        found = [key for key in found if key[:2] not in added]
    return tuple(found)


def is_on(space) -> bool:
    """Whether a viewport shows volumes."""
    return getattr(space, SWITCH)


def switch_all(window, on: bool) -> None:
    """Let all viewports of a window show volumes, or none.

    Parameters
    ----------
    window : bpy.types.Window
    on : bool
    """
    for area in window.screen.areas:
        if area.type == "VIEW_3D":
            setattr(area.spaces.active, SWITCH, on)


def forget() -> None:
    """Forget all scenes, before another file is opened."""
    for held in (_Now.known, _Now.instancers, _Now.instances):
        held.clear()


def _key(owner) -> tuple:
    return owner.name, None if owner.library is None else owner.library.filepath
