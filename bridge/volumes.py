"""Volume objects and their voxels.

Voxels stay outside the .blend.  They are read when first needed and cached in memory.  The key of the cache is the
file, its size, its modification time and the options.  No reference to a Blender datablock is stored.
"""

import os

import bpy

from ..rle_splat.read.formats import read_volume
from ..rle_splat.scene import RleSplatError
from .source_options import read_options
from .source_paths import resolved_path

_kept: dict = {}  # source key -> (Volume, hash of its voxels)


def volume_objects(scene) -> list:
    """The volume objects of a scene, sorted by name."""
    return sorted((o for o in scene.objects if o.rle_splat.is_volume), key=lambda o: o.name)


def volume_object(context):
    """The volume that an operator or a panel works on.

    Parameters
    ----------
    context : bpy.types.Context
        The context.

    Returns
    -------
    bpy.types.Object or None
        The active object if it is a volume, else the only selected volume, else the only volume of the scene.
    """
    active = context.view_layer.objects.active
    if active is not None and active.rle_splat.is_volume:
        return active
    every = volume_objects(context.scene)
    selected = [o for o in every if o.select_get(view_layer=context.view_layer)]
    for candidates in (selected, every):
        if len(candidates) == 1:
            return candidates[0]
    return None


def expose_modules() -> None:
    """Make the modules that Blender bundles importable, such as OpenVDB and OpenImageIO, which readers use."""
    bpy.utils.expose_bundled_modules()


def read_file(path: str, options: dict):
    """``read_volume`` with Blender's bundled modules."""
    expose_modules()
    return read_volume(path, **options)


def load_volume(owner, warn=None):
    """The voxels of a volume object, from memory or from its file.

    Parameters
    ----------
    owner : bpy.types.Object
        The volume object.
    warn : callable, optional
        Called with one sentence if the voxels differ from those that were imported.

    Returns
    -------
    Volume
        The voxels.

    Raises
    ------
    RleSplatError
        If the object is no volume, or its file is missing or cannot be read.
    """
    properties = owner.rle_splat
    if not properties.is_volume:
        raise RleSplatError(f"{owner.name!r} is not a volume; import one with File > Import > Volume (RLE Splat).")
    path = resolved_path(owner)
    try:
        status = os.stat(path)
    except OSError:
        raise RleSplatError(
            f"The file of {owner.name!r} is not at {path}; press Relocate in the RLE Splat tab to choose its new place."
        ) from None
    options = read_options(properties)
    key = _source_key(path, status, options)
    if key not in _kept:
        volume = read_file(path, options)
        _forget_unused()
        _kept[key] = (volume, volume.voxel_key)
    volume, voxel_hash = _kept[key]
    if warn is not None and properties.data_key and voxel_hash != properties.data_key:
        warn(f"The voxels of {owner.name!r} are not those that were imported, because {path} has changed; import it "
             "again, or press Relocate to choose the original file.")
    return volume


def is_at_hand(owner) -> bool:
    """Whether the voxels of a volume object are in memory, so that ``load_volume`` returns at once."""
    path = resolved_path(owner)
    try:
        return _source_key(path, os.stat(path), read_options(owner.rle_splat)) in _kept
    except OSError:
        return False


def keep_volume(owner, volume) -> None:
    """Cache a volume that was read for an object."""
    path = resolved_path(owner)
    _kept[_source_key(path, os.stat(path), read_options(owner.rle_splat))] = (volume, owner.rle_splat.data_key)


def forget_all() -> None:
    """Clear the cache."""
    _kept.clear()


def _source_key(path: str, status, options: dict) -> tuple:
    return path, status.st_size, status.st_mtime_ns, tuple(sorted(options.items()))


def _forget_unused() -> None:
    """Remove the voxels of files that no object uses any more."""
    used = {resolved_path(o) for o in bpy.data.objects if o.rle_splat.is_volume}
    for key in [key for key in _kept if key[0] not in used]:
        del _kept[key]
