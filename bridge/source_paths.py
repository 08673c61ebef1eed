"""Paths of volume files: stored relative to the .blend if possible, and resolved to absolute paths.

A relative path is relative to the file that its value comes from.  For linked data and for properties that an override
leaves unchanged that file is the library.

Blender adapts its own paths when the .blend is saved elsewhere or data move between files, but not paths in property
groups.  Two handlers adapt them on saving and one on Append.  Make Local and Duplicate call no handler.  So the
resolved paths of linked volumes are remembered: local copies find their files, and saving then stores the path.
"""

import os

import bpy
from bpy.app.handlers import persistent

from ..rle_splat.read.sequence import sequence_of
from ..rle_splat.scene import RleSplatError
from . import linked

PATHS = ("filepath", "label_file")  # properties of a volume

_leads_to: dict = {}  # (property, relative path, hash of the voxels) from a library -> absolute path
_written_here: set = set()  # (session id, property, path) of paths that are relative to the open file
_while_saving: dict = {}  # session id -> absolute paths by property, during a save


def kept_path(path: str, blend_file: str) -> str:
    """The form of a path that is stored in a .blend.

    Parameters
    ----------
    path : str
        Absolute path.
    blend_file : str
        Path of the .blend, or "" before its first save.

    Returns
    -------
    str
        A path relative to the .blend; the absolute path before the first save or for another drive.
    """
    if not blend_file:
        return path
    try:
        return bpy.path.relpath(path, start=os.path.dirname(blend_file))
    except ValueError:  # on Windows there is no relative path to another drive
        return path


def resolved_path(owner, name: str = "filepath") -> str:
    """The absolute path of a volume object's file.

    Parameters
    ----------
    owner : bpy.types.Object
        The volume object.
    name : str
        The property that holds the path, one of PATHS.

    Returns
    -------
    str
        Absolute path.
    """
    path = getattr(owner.rle_splat, name)
    key = (name, path, owner.rle_splat.data_key)
    library = linked.library_of(owner, name)
    if library is None and (owner.session_uid, name, path) not in _written_here:
        path = _leads_to.get(key, path)
    found = os.path.normpath(bpy.path.abspath(path, library=library))
    if library is not None and path.startswith("//"):
        _leads_to[key] = found
    return found


def check_is_no_scan(path) -> None:
    """Refuse to write to a file that a volume or its labels are read from.

    Parameters
    ----------
    path : str or Path
        Absolute path of the file to write.

    Raises
    ------
    RleSplatError
        If a volume of the open file is read from it.
    """
    if not os.path.exists(path):
        return
    for owner in _volumes():
        for source in _files_of(owner):
            if os.path.exists(source) and os.path.samefile(source, path):
                raise RleSplatError(
                    f"{path} is the file that {owner.name!r} is read from, and is never overwritten; give another name."
                )


def _files_of(owner) -> list:
    """The files of a volume and of its labels; of a folder the folder alone."""
    found = [resolved_path(owner, name) for name in PATHS if getattr(owner.rle_splat, name)]
    numbered = sequence_of(resolved_path(owner)) if owner.rle_splat.use_sequence else None
    return found if numbered is None else [*found, *numbered.files.values()]


def write_path(owner, name: str, path: str, blend_file: str) -> None:
    """Set a path property of a local or overridden volume.

    Parameters
    ----------
    owner : bpy.types.Object
        The volume object.
    name : str
        One of PATHS.
    path : str
        Absolute path.
    blend_file : str
        The .blend that the stored path is relative to.
    """
    kept = kept_path(path, blend_file)
    if owner.override_library is not None and kept.startswith("//"):
        kept = "//./" + kept[2:]  # must differ from the library's text, or Blender drops the override
    if kept != getattr(owner.rle_splat, name):
        setattr(owner.rle_splat, name, kept)
    _written_here.add((owner.session_uid, name, kept))


def _volumes() -> list:
    return [o for o in bpy.data.objects if o.rle_splat.is_volume]


def _own_paths(owner) -> list[str]:
    """The path properties of a volume that are set and whose values come from the open file."""
    return [name for name in PATHS if getattr(owner.rle_splat, name) and linked.library_of(owner, name) is None]


def _remember(owner) -> None:
    """Remember which paths of a volume are relative to the open file, and the absolute paths of the others."""
    own = _own_paths(owner)
    _written_here.update((owner.session_uid, name, getattr(owner.rle_splat, name)) for name in own)
    for name in set(PATHS) - set(own):
        resolved_path(owner, name)


@persistent
def before_save(blend_file, *_):
    """Handler: make the paths of local volumes relative to the file that is being written."""
    if not blend_file:  # the startup file
        return
    for owner in _volumes():
        if owner.library is None:
            paths = _while_saving[owner.session_uid] = {n: resolved_path(owner, n) for n in _own_paths(owner)}
            for name, path in paths.items():
                write_path(owner, name, path, blend_file)


@persistent
def after_save(*_):
    """Handler: make the paths relative to the open file again, which Save Copy does not change."""
    for owner in _volumes():
        for name, path in _while_saving.get(owner.session_uid, {}).items():
            write_path(owner, name, path, bpy.data.filepath)
    _while_saving.clear()


@persistent
def after_load(*_):
    """Handler: forget the paths of the previous file and remember those of the opened one."""
    _leads_to.clear()
    _written_here.clear()
    for owner in _volumes():
        _remember(owner)


@persistent
def after_import(imported, *_):
    """Handler: adapt the paths of appended volumes to the open file, and remember those of linked volumes."""
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
