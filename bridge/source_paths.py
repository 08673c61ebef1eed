"""Paths of volume files, relative to the .blend where they can be, and where they lead.

A relative path counts from the file that its value comes from.  That is the library for linked data, and for what an
override leaves as it is.

Blender remakes its own paths where the .blend is saved elsewhere or data change files, but not those in property
groups.  Two handlers do it on saving and one on Append.  Make Local and Duplicate tell no handler: it is remembered
where the paths of linked volumes lead, so that local copies of them find their files, and saving keeps that.
"""

import os

import bpy
from bpy.app.handlers import persistent

from . import linked

PATHS = ("filepath", "label_file")  # of a volume's properties

_leads_to: dict = {}  # (property, relative path, hash of the voxels) from a library -> absolute path
_written_here: set = set()  # (session uid, property, relative path) of volumes whose paths count from the open file
_while_saving: dict = {}  # object's session uid -> absolute paths by property, from before a save to after it


def kept_path(path: str, blend_file: str) -> str:
    """``path`` (absolute) as kept in a .blend at ``blend_file``; absolute while that is "" or on another drive."""
    if not blend_file:
        return path
    try:
        return bpy.path.relpath(path, start=os.path.dirname(blend_file))
    except ValueError:  # Windows: no relative path leads to another drive
        return path


def resolved_path(owner, name: str = "filepath") -> str:
    """The absolute path of a volume object's file, or of another that the property ``name`` holds."""
    path = getattr(owner.rle_splat, name)
    key = (name, path, owner.rle_splat.data_key)
    library = linked.library_of(owner, name)
    if library is None and (owner.session_uid, name, path) not in _written_here:
        path = _leads_to.get(key, path)
    found = os.path.normpath(bpy.path.abspath(path, library=library))
    if library is not None and path.startswith("//"):
        _leads_to[key] = found
    return found


def write_path(owner, name: str, path: str, blend_file: str) -> None:
    """Set a path property of a volume that is not linked to ``path`` (absolute), as kept in ``blend_file``."""
    kept = kept_path(path, blend_file)
    if owner.override_library is not None and kept.startswith("//"):
        kept = "//./" + kept[2:]  # never the library's text, which Blender would take for no override at all
    if kept != getattr(owner.rle_splat, name):
        setattr(owner.rle_splat, name, kept)
    _written_here.add((owner.session_uid, name, kept))


def _volumes() -> list:
    return [o for o in bpy.data.objects if o.rle_splat.is_volume]


def _own_paths(owner) -> list[str]:
    """The path properties of a volume that are set, and whose values come from the open file."""
    return [name for name in PATHS if getattr(owner.rle_splat, name) and linked.library_of(owner, name) is None]


def _remember(owner) -> None:
    """Remember which paths of a volume count from the open file, and where those from libraries lead."""
    own = _own_paths(owner)
    _written_here.update((owner.session_uid, name, getattr(owner.rle_splat, name)) for name in own)
    for name in set(PATHS) - set(own):
        resolved_path(owner, name)


@persistent
def before_save(blend_file, *_):
    """Make every path of this file's own relative to the file about to be written."""
    if not blend_file:  # the startup file
        return
    for owner in _volumes():
        if owner.library is None:
            paths = _while_saving[owner.session_uid] = {n: resolved_path(owner, n) for n in _own_paths(owner)}
            for name, path in paths.items():
                write_path(owner, name, path, blend_file)


@persistent
def after_save(*_):
    """The file that is open now may be another than the one written (Save Copy)."""
    for owner in _volumes():
        for name, path in _while_saving.get(owner.session_uid, {}).items():
            write_path(owner, name, path, bpy.data.filepath)
    _while_saving.clear()


@persistent
def after_load(*_):
    """Of the file just opened, remember every path; forget those of the last one."""
    _leads_to.clear()
    _written_here.clear()
    for owner in _volumes():
        _remember(owner)


@persistent
def after_import(imported, *_):
    """File > Append and Link: an appended path is remade from the file it comes from, a linked one remembered."""
    for item in imported.import_items:
        owner = item.id
        if item.id_type != "OBJECT" or owner is None or not owner.rle_splat.is_volume:
            continue
        if owner.library is not None:
            _remember(owner)
        elif item.append_action in ("MAKE_LOCAL", "COPY_LOCAL"):
            for name in _own_paths(owner):
                path = bpy.path.abspath(getattr(owner.rle_splat, name), library=item.source_library)
                write_path(owner, name, os.path.normpath(path), bpy.data.filepath)


HANDLERS = (
    ("save_pre", before_save), ("save_post", after_save), ("save_post_fail", after_save), ("load_post", after_load),
    ("blend_import_post", after_import),
)


def register():
    for event, function in HANDLERS:
        getattr(bpy.app.handlers, event).append(function)


def unregister():
    for event, function in HANDLERS:
        getattr(bpy.app.handlers, event).remove(function)
