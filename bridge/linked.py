"""Linked data and library overrides: which file a value comes from, and whether edits are saved."""

import os


def is_own(block) -> bool:
    """Whether a datablock is local: neither linked nor an override, so that all edits are saved in the open file."""
    return block.library is None and block.override_library is None


def own_copy(block):
    """A local copy of a datablock, neither linked nor an override."""
    copy = block.copy()
    return copy if copy.override_library is None else copy.make_local(clear_liboverride=True)


def own_action(block) -> None:
    """Replace a linked action of a datablock by a local copy, which can get keyframes."""
    animation = block.animation_data
    if animation is not None and animation.action is not None and not is_own(animation.action):
        animation.action = own_copy(animation.action)


def put_into_scene(context, one) -> None:
    """Link a new object to the active collection, or to that of the scene if edits of the active one would be lost."""
    home = context.collection if is_own(context.collection) else context.scene.collection
    home.objects.link(one)


def file_name(library) -> str:
    """The name of a library's file, without its folder."""
    return os.path.basename(library.filepath.replace("\\", "/"))


def why_not_editable(owner) -> str:
    """Why edits of an object would be lost, and what to do: a clause without a period; "" if edits are saved."""
    if owner.library is None:
        return ""
    return (f"{owner.name!r} is linked from {file_name(owner.library)}; make a library override (Object > Library "
            "Override > Make) or make it local (Object > Relations > Make Local)")  # fmt: skip


def library_of(owner, name: str):
    """The library that a property of a volume object, linked or an override, comes from; None for the open file."""
    while owner.override_library is not None and not _is_overridden(owner, name):
        owner = owner.override_library.reference
    return owner.library


def _is_overridden(owner, name: str) -> bool:
    override = owner.override_library
    if override.reference.is_missing:  # the library file is missing
        return any(entry.rna_path == f"rle_splat.{name}" for entry in override.properties)
    # Blender lists overridden properties only on saving, by the same comparison.
    return getattr(override.reference.rle_splat, name) != getattr(owner.rle_splat, name)
