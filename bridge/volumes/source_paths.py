"""Paths of volume files: absolute in memory, relative in a saved .blend if possible.

Undo restores the text of a path, but not the place of the .blend that a relative path was meant for: after Save As it
could lead to another patient's file of the same name.  So handlers make the paths of the open file absolute on loading,
on Append and after saving, and relative only while a file is written.  A datablock whose path Blender itself remaps,
such as a Volume or an Image, would not do: undo after Save As brings back its old text, which then leads nowhere.

A relative path in memory is relative to the file that its value comes from: the library, for linked data and for
properties that an override leaves unchanged.  Make Local and Duplicate call no handler.  So the resolved paths of
linked volumes are remembered: local copies find their files.
"""

import os

import bpy
from bpy.app.handlers import persistent

from ...rle_splat.read.sequence import sequence_of
from ...rle_splat.scene import RleSplatError
from .. import linked

PATHS = ("filepath", "label_file")  # properties of a volume

_leads_to: dict = {}  # (property, relative path, hash of the voxels) from a library -> absolute path
_while_saving: dict = {}  # session id -> absolute paths by property, during a save


def kept_path(path: str, blend_file: str) -> str:
    """The form of a path that is stored in a .blend: relative to it.

    The absolute path before the first save, when ``blend_file`` is "", or for another drive.
    """
    if not blend_file:
        return path
    try:
        return bpy.path.relpath(path, start=os.path.dirname(blend_file))
    except ValueError:  # on Windows there is no relative path to another drive
        return path


def resolved_path(owner, name: str = "filepath") -> str:
    """The absolute path of a volume object's file, from the property ``name``, one of PATHS."""
    paths = _while_saving.get(owner.session_uid, {})
    if name in paths:
        return paths[name]
    path = getattr(owner.rle_splat, name)
    key = (name, path, owner.rle_splat.data_key)
    library = linked.library_of(owner, name)
    if library is None:
        path = _leads_to.get(key, path)
    found = os.path.normpath(bpy.path.abspath(path, library=library))
    if library is not None and path.startswith("//"):
        _leads_to[key] = found
    return found


def check_is_no_scan(path) -> None:
    """Refuse to write to a file that a volume or its labels are read from.

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


def make_absolute(properties, name: str) -> None:
    """Make a path that a user has typed or chosen absolute; ``name``: one of PATHS."""
    path, owner = getattr(properties, name), properties.id_data
    if path.startswith("//") and owner.library is None and owner.session_uid not in _while_saving:
        setattr(properties, name, os.path.normpath(bpy.path.abspath(path)))


def _volumes() -> list:
    return [o for o in bpy.data.objects if o.rle_splat.is_volume]


def _own_paths(owner) -> list[str]:
    """The path properties of a volume that are set and whose values come from the open file."""
    return [name for name in PATHS if getattr(owner.rle_splat, name) and linked.library_of(owner, name) is None]


def _remember(owner) -> None:
    """Make the paths of a volume that come from the open file absolute, and remember where the others lead."""
    own = _own_paths(owner)
    for name in PATHS:
        path = resolved_path(owner, name)
        if name in own:
            setattr(owner.rle_splat, name, path)


@persistent
def before_save(blend_file, *_):
    """Handler: make the paths of local volumes relative to the file that is being written."""
    if not blend_file:  # the startup file
        return
    for owner in _volumes():
        if owner.library is None:
            paths = {name: resolved_path(owner, name) for name in _own_paths(owner)}
            _while_saving[owner.session_uid] = paths
            for name, path in paths.items():
                kept = kept_path(path, blend_file)
                if owner.override_library is not None and kept.startswith("//"):
                    kept = "//./" + kept[2:]  # must differ from the library's text, or Blender drops the override
                setattr(owner.rle_splat, name, kept)


@persistent
def after_save(*_):
    """Handler: make the paths absolute again."""
    for owner in _volumes():
        for name, path in _while_saving.get(owner.session_uid, {}).items():
            setattr(owner.rle_splat, name, path)
    _while_saving.clear()


@persistent
def after_load(*_):
    """Handler: forget the paths of the previous file, and make those of the opened one absolute."""
    _leads_to.clear()
    for owner in _volumes():
        _remember(owner)


@persistent
def after_import(imported, *_):
    """Handler: make the paths of appended volumes absolute, and remember those of linked volumes."""
    for item in imported.import_items:
        owner = item.id
        if item.id_type != "OBJECT" or owner is None or not owner.rle_splat.is_volume:
            continue
        if owner.library is not None:
            _remember(owner)
        elif item.append_action in ("MAKE_LOCAL", "COPY_LOCAL"):
            for name in _own_paths(owner):
                path = bpy.path.abspath(getattr(owner.rle_splat, name), library=item.source_library)
                setattr(owner.rle_splat, name, os.path.normpath(path))


HANDLERS = (
    ("save_pre", before_save), ("save_post", after_save), ("save_post_fail", after_save), ("load_post", after_load),
    ("blend_import_post", after_import),
)  # fmt: skip
