"""Paths of volume files, relative to the .blend where they can be, and kept right when the .blend is saved elsewhere.

Blender remaps its own paths on saving but not those in property groups, so two handlers do it.
"""

import os

import bpy
from bpy.app.handlers import persistent

from . import volumes


def kept_path(path: str, blend_file: str) -> str:
    """``path`` (absolute) as kept in a .blend at ``blend_file``; absolute while that is "" or on another drive."""
    if not blend_file:
        return path
    try:
        return bpy.path.relpath(path, start=os.path.dirname(blend_file))
    except ValueError:  # Windows: no relative path leads to another drive
        return path


_while_saving: dict = {}  # object's session uid -> absolute paths by property, from before a save to after it
PATHS = ("filepath", "label_file")


def _local_volumes() -> list:
    return [
        o for o in bpy.data.objects if o.rle_splat.is_volume and o.library is None and o.override_library is None
    ]


@persistent
def before_save(blend_file, *_):
    """Make every path relative to the file about to be written."""
    if not blend_file:  # the startup file
        return
    for owner in _local_volumes():
        paths = _while_saving[owner.session_uid] = {}
        for name in PATHS:
            if getattr(owner.rle_splat, name):
                paths[name] = volumes.resolved_path(owner, name)
                setattr(owner.rle_splat, name, kept_path(paths[name], blend_file))


@persistent
def after_save(*_):
    """The file that is open now may be another than the one written (Save Copy)."""
    for owner in _local_volumes():
        for name, path in _while_saving.get(owner.session_uid, {}).items():
            setattr(owner.rle_splat, name, kept_path(path, bpy.data.filepath))
    _while_saving.clear()


HANDLERS = (
    ("save_pre", before_save), ("save_post", after_save), ("save_post_fail", after_save),
)


def register():
    for event, function in HANDLERS:
        getattr(bpy.app.handlers, event).append(function)


def unregister():
    for event, function in HANDLERS:
        getattr(bpy.app.handlers, event).remove(function)
