"""The channels of a volume object: further volume objects on the same grid, added to its picture.

Each is imported as any volume is, so its file, its transfer function and its window are its own object's.
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
    """One further volume.  Its ``name``, by which overrides find it, is like no other."""

    source: PointerProperty(
        name="Volume", type=bpy.types.Object, poll=lambda row, other: can_be_added(row.id_data, other),
        description="A volume object on the same grid; it adds to the picture by its own transfer function",
        update=_evaluate_anew)
    show: BoolProperty(name="Show", description="Whether the channel is added", default=True, update=_evaluate_anew)


def can_be_added(owner, other) -> bool:
    """Whether an object is another volume."""
    return other.rle_splat.is_volume and other != owner


def add_channels(owner, others) -> None:
    """Add volume objects; raises RleSplatError, adding none, where one is added already or on another grid."""
    grid = volumes.load_volume(owner).shape_xyz
    for other in others:
        if any(row.source == other for row in owner.rle_splat.channels):
            raise RleSplatError(f"{other.name!r} is a channel of {owner.name!r} already; choose another volume.")
        mine, its = (" x ".join(map(str, shape)) for shape in (grid, volumes.load_volume(other).shape_xyz))
        if mine != its:
            raise RleSplatError(
                f"{other.name!r} has {its} voxels and {owner.name!r} {mine}; choose a volume on the same grid."
            )
    for other in others:
        row = owner.rle_splat.channels.add()
        row.name, row.source = uuid.uuid4().hex, other


def remove_channel(owner, index: int) -> None:
    """Take a channel away; raises RleSplatError where there is none of that number, or it must stay."""
    rows = owner.rle_splat.channels
    if index >= len(rows):
        raise RleSplatError(f"There are {len(rows)} channels and none of number {index}; choose one of them.")
    if not remove_row(rows, index):
        library = linked.file_name(owner.override_library.reference.library)
        raise RleSplatError(
            f"Channel {index} of {owner.name!r} comes from {library}, and a library override cannot drop it; switch it "
            "off instead."
        )
    owner.update_tag()


def read_channels(owner, depsgraph) -> tuple[Channel, ...]:
    """The channels that are shown at the depsgraph's time; deleted ones are not."""
    rows = owner.evaluated_get(depsgraph).rle_splat.channels
    sources = [row.source.original for row in rows if row.show and row.source is not None]
    sources = [one for one in sources if not presence.is_deleted(one)]
    return tuple(Channel(volumes.load_volume(one), transfer.read_transfer(one, depsgraph)) for one in sources)
