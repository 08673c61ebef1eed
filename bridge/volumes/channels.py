"""The channels of a volume object: further volume objects that are added to its picture.

A channel is imported like any other volume, so it has its own file, transfer function and window.  Where both files say
how they lie in the patient, its values are brought onto the grid of the volume; the objects' own places do not count.
"""

import uuid
from functools import partial

import bpy

from ...rle_splat.runtime.steps import drain
from ...rle_splat.scene import Channel, RleSplatError
from ...rle_splat.volume.regrid import on_grid_steps
from .. import linked, presence
from ..data.overridable import LiveBool, LivePointer
from ..look import transfer
from ..loop import store
from . import encoded, volumes
from .labels import remove_row


class ChannelProperties(bpy.types.PropertyGroup):
    """One channel.  ``name`` is unique, because library overrides find rows by name."""

    source: LivePointer(
        name="Volume",
        type=bpy.types.Object,
        poll=lambda row, other: can_be_added(row.id_data, other),
        description="A volume of the same region, shown with its own transfer function",
    )
    show: LiveBool(name="Show", description="Show this volume together with the active one", default=True)


def can_be_added(owner, other) -> bool:
    """Whether an object is a volume other than ``owner``, with values."""
    return other.rle_splat.is_volume and other != owner and not encoded.is_of(other)


def _key_of(channel, volume) -> tuple:
    """Key of the Volume of a channel on the grid of a volume."""
    return "channel", channel.key, channel.space, volume.shape_xyz, volume.affine.tobytes(), volume.space


def is_placed(channel, volume) -> bool:
    """Whether ``placed_steps`` takes no time for the Volume of a channel."""
    return store.find(_key_of(channel, volume)) is not None


def placed_steps(wish: store.Wish, channel, volume):
    """Generator of Progress: a channel on the grid of a volume, both Volumes; RleSplatError if it lies elsewhere."""
    if not channel.holds_values:
        raise RleSplatError(f"A channel {encoded.NO_VALUES}.")
    make_steps = partial(on_grid_steps, channel, volume, values=True)
    return (yield from store.steps(wish, _key_of(channel, volume), make_steps))


def wish_of(owner, source, depsgraph=None) -> store.Wish:
    """The wish of a volume object for one of its channels."""
    return store.wish_of(owner, depsgraph, source.session_uid)


def sources_of(owner, depsgraph=None) -> list:
    """The volume objects of the channels that are switched on, without deleted ones; ``depsgraph`` gives the time."""
    properties = owner.rle_splat if depsgraph is None else owner.evaluated_get(depsgraph).rle_splat
    sources = [row.source.original for row in properties.channels if row.show and row.source is not None]
    return [one for one in sources if not presence.is_deleted(one)]


def add_channels(owner, others) -> tuple[str, ...]:
    """Add volume objects as channels; all or, on an error, none.

    Returns
    -------
    tuple of str
        Sentences on how channels were brought onto the grid of the volume.

    Raises
    ------
    RleSplatError
        If one is a channel already, lies elsewhere, has another grid and no place in the patient, or cannot be read.
    """
    volume, remarks = volumes.load_volume(owner), []
    for other in others:
        if any(row.source == other for row in owner.rle_splat.channels):
            raise RleSplatError(f"{other.name!r} is already a channel of {owner.name!r}; choose another volume.")
        channel = volumes.load_volume(other)
        placed = drain(placed_steps(wish_of(owner, other), channel, volume))
        check_grid(other.name, placed, owner.name, volume)
        remarks += placed.remarks[len(channel.remarks) :]
    for other in others:
        row = owner.rle_splat.channels.add()
        row.name, row.source = uuid.uuid4().hex, other
    return tuple(remarks)


def check_grid(name: str, placed, owner_name: str, volume) -> None:
    """RleSplatError if the channel ``name``, the Volume ``placed``, has other voxels than the volume that it is for."""
    mine, its = (" x ".join(map(str, one.shape_xyz)) for one in (volume, placed))
    if mine != its:
        raise RleSplatError(
            f"{name!r} has {its} voxels and {owner_name!r} has {mine}; choose a volume on the same grid, "
            "or files that say how they lie in the patient."
        )


def remove_channel(owner, index: int) -> None:
    """Remove a channel; RleSplatError if there is no such row, or it belongs to the library of an override.

    Parameters
    ----------
    index : int
        Row in its list of channels, from 0.
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


def read_channels(owner, depsgraph, volume) -> tuple[Channel, ...]:
    """The channels that are switched on at the depsgraph's time, without deleted ones."""
    return tuple(
        Channel(
            drain(placed_steps(wish_of(owner, one, depsgraph), volumes.load_volume(one, depsgraph=depsgraph), volume)),
            transfer.read_transfer(one, depsgraph),
        )
        for one in sources_of(owner, depsgraph)
    )
