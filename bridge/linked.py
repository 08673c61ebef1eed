"""Linked data and library overrides: which file a value comes from, and whether edits of it are kept."""

from __future__ import annotations

import os


def is_own(block) -> bool:
    """Whether all edits of a datablock are kept in the open file: it is neither linked nor an override."""
    return block.library is None and block.override_library is None


def own_copy(block):
    """A copy of a datablock that is neither linked nor an override."""
    copy = block.copy()
    return copy if copy.override_library is None else copy.make_local(clear_liboverride=True)


def own_action(block) -> None:
    """Exchange the action of a datablock for a copy where it takes no keyframes, being another file's."""
    animation = block.animation_data
    if animation is not None and animation.action is not None and not is_own(animation.action):
        animation.action = own_copy(animation.action)


def file_name(library) -> str:
    """The name of a library's file, without its folder."""
    return os.path.basename(library.filepath.replace("\\", "/"))


def why_not_editable(owner) -> str:
    """A clause on why edits of an object are lost, and what to do; "" where they are kept."""
    if owner.library is None:
        return ""
    return (f"{owner.name!r} is linked from {file_name(owner.library)}; make a library override (Object > Library "
            "Override > Make) or make it local (Object > Relations > Make Local)")


def library_of(owner, name: str):
    """The library that the value of the volume's property ``name`` comes from; None for the open file."""
    while owner.override_library is not None and not _is_overridden(owner, name):
        owner = owner.override_library.reference
    return owner.library


def _is_overridden(owner, name: str) -> bool:
    override = owner.override_library
    if override.reference.is_missing:  # the library's file is away
        return any(entry.rna_path == f"rle_splat.{name}" for entry in override.properties)
    # Blender lists an edit only when it saves, by the same comparison.
    return getattr(override.reference.rle_splat, name) != getattr(owner.rle_splat, name)
