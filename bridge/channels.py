"""The channels of a volume object: further volume objects on the same grid that are added to its picture.

A channel is imported like any other volume, so it has its own file, transfer function and window.
"""

from __future__ import annotations

import uuid

import bpy

from ..rle_splat.scene import Channel, RleSplatError
from . import linked, presence, transfer, volumes
from .labels import remove_row
from .overridable import BoolProperty, PointerProperty


def _evaluate_anew(row, _context):
    row.id_data.update_tag()


class ChannelProperties(bpy.types.PropertyGroup):
    """One channel.  ``name`` is unique, because library overrides find rows by name."""

    source: PointerProperty(
        name="Volume", type=bpy.types.Object, poll=lambda row, other: can_be_added(row.id_data, other),
        description="A volume on the same grid, shown with its own transfer function", update=_evaluate_anew)
    show: BoolProperty(name="Show", description="Add this volume to the picture", default=True, update=_evaluate_anew)


def can_be_added(owner, other) -> bool:
    """Whether an object is a volume other than ``owner``."""
    return other.rle_splat.is_volume and other != owner


def add_channels(owner, others) -> None:
    """Add volume objects as channels; all or, on an error, none.

    Parameters
    ----------
    owner : bpy.types.Object
        The volume that gets the channels.
    others : list of bpy.types.Object
        Volume objects.

    Raises
    ------
    RleSplatError
        If one is a channel already, has another number of voxels, or cannot be read.
    """
    grid = volumes.load_volume(owner).shape_xyz
    for other in others:
        if any(row.source == other for row in owner.rle_splat.channels):
            raise RleSplatError(f"{other.name!r} is already a channel of {owner.name!r}; choose another volume.")
        mine, its = (" x ".join(map(str, shape)) for shape in (grid, volumes.load_volume(other).shape_xyz))
        if mine != its:
            raise RleSplatError(
                f"{other.name!r} has {its} voxels and {owner.name!r} {mine}; choose a volume on the same grid."
            )
    for other in others:
        row = owner.rle_splat.channels.add()
        row.name, row.source = uuid.uuid4().hex, other


def remove_channel(owner, index: int) -> None:
    """Remove a channel.

    Parameters
    ----------
    owner : bpy.types.Object
        The volume.
    index : int
        Row in its list of channels, from 0.

    Raises
    ------
    RleSplatError
        If there is no such row, or it belongs to the library of an override.
    """
    rows = owner.rle_splat.channels
    if index >= len(rows):
        raise RleSplatError(f"There is no channel {index}; choose a number below {len(rows)}.")
    if not remove_row(rows, index):
        library = linked.file_name(owner.override_library.reference.library)
        raise RleSplatError(
            f"Channel {index} of {owner.name!r} comes from {library}, and a library override cannot remove it; switch "
            "it off instead."
        )
    owner.update_tag()


def read_channels(owner, depsgraph) -> tuple[Channel, ...]:
    """The channels that are switched on at the depsgraph's time, without deleted ones.

    Parameters
    ----------
    owner : bpy.types.Object
        The volume.
    depsgraph : bpy.types.Depsgraph
        The evaluated scene.

    Returns
    -------
    tuple of Channel
        Volume and transfer function of each.
    """
    rows = owner.evaluated_get(depsgraph).rle_splat.channels
    sources = [row.source.original for row in rows if row.show and row.source is not None]
    sources = [one for one in sources if not presence.is_deleted(one)]
    return tuple(
        Channel(volumes.load_volume(one, depsgraph=depsgraph), transfer.read_transfer(one, depsgraph))
        for one in sources)
