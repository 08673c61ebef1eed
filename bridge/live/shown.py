"""Which volumes a viewport shows, and the stamp that tells when anything may have changed.

Whether volumes are shown live is the viewport's own switch for volumes among Blender's object type filters.  It belongs
to the 3D view, so Blender saves it with the screen, copies it when an area is split and keeps it through undo.  A
property of ours could only be stored in the scene or the screen by the number of an area, which changes with every area
that is joined or split, or by an address in memory, which another file gives to another view.
"""

from typing import NamedTuple

import numpy as np
from bpy.app.handlers import persistent

from ..loop import index
from ..scene import placements
from ..volumes import volumes

SWITCH = "show_object_viewport_volume"  # of a SpaceView3D


class _Instance(NamedTuple):
    """Key of an instance of a volume: those of the volume and of the instancer, and the matrix row by row."""

    owner: index.Key
    instancer: index.Key
    matrix: tuple


class _Now:
    """The number of events so far, and the instances of each view layer as of one of them."""

    stamp = 0
    instances: dict = {}  # (session id of a scene, name of a view layer) -> (stamp, tuple of _Instance)


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


def has_volumes(scene) -> bool:
    """Whether a scene shows volumes, or instances of volumes."""
    found = index.of(scene)
    return bool(found.volumes) or found.has_instances


def _instance_keys(scene, view_layer) -> tuple:
    if view_layer.depsgraph is None or not index.of(scene).has_instances:
        return ()
    of = scene.session_uid, view_layer.name
    at, found = _Now.instances.get(of, (None, ()))
    if at != _Now.stamp:
        placed = [one for one in placements.placements(view_layer.depsgraph) if one.instancer is not None]
        found = tuple(
            _Instance(index.key_of(one.owner), index.key_of(one.instancer), tuple(one.matrix.ravel().tolist()))
            for one in placed
        )
        _Now.instances[of] = _Now.stamp, found
    return found


def find(key):
    """The volume object of a key, None if it is gone."""
    return index.find(key.owner if isinstance(key, _Instance) else key)


def matrix_of(key) -> np.ndarray | None:
    """(4, 4) matrix of the key of an instance; None for the key of a volume itself."""
    return np.array(key.matrix).reshape(4, 4) if isinstance(key, _Instance) else None


def visible_volumes(scene, view_layer, space) -> tuple:
    """Keys of the volumes that a viewport shows; its local view, collections and object type filters count."""
    if not is_on(space):
        return ()
    found = []
    shown_by = [(owner, index.key_of(owner)) for owner in volumes.volume_objects(scene)]
    shown_by += [(index.find(key.instancer), key) for key in _instance_keys(scene, view_layer)]
    for one, key in shown_by:
        if one is not None and one.visible_get(view_layer=view_layer, viewport=space):
            found.append(key)
    if len(found) > 1:
        added = placements.as_channels([find(key) for key in found])
        found = [key for key in found if find(key) not in added]
    return tuple(found)


def is_on(space) -> bool:
    """Whether a viewport shows volumes."""
    return getattr(space, SWITCH)


def switch_all(window, on: bool) -> None:
    """Let all viewports of a window show volumes, or none."""
    for area in window.screen.areas:
        if area.type == "VIEW_3D":
            setattr(area.spaces.active, SWITCH, on)


def forget() -> None:
    """Forget all scenes, before another file is opened."""
    _Now.instances.clear()
