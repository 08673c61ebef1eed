"""Create the object of a volume that was read."""

import os

import bpy

from ...rle_splat.read.formats import format_of
from .. import linked
from ..data import source_options
from ..data.playback import FIXED, HOLD
from ..data.settings import scene_scale_of
from ..look.transfer import write_transfer
from ..loop import store
from . import box, volumes
from .facts import write_facts
from .import_source import ReadSource


def add_volume(context, found: ReadSource, options, transfer_function, at_cursor: bool = False):
    """Add a volume object to the scene; it becomes the active and only selected object.

    Parameters
    ----------
    context : bpy.types.Context
        Gives scene, collection, view layer and 3D cursor.
    transfer_function : TransferFunction or None
        Its first transfer function; None for encoded voxels, which have their own.
    at_cursor : bool
        Whether to place the center of the box at the 3D cursor instead of keeping the file's coordinates.

    Returns
    -------
    owner : bpy.types.Object
        The volume object.
    remark : str
        What of the transfer function could not be stored exactly, or "".
    """
    path, volume = found.path, found.volume
    owner = bpy.data.objects.new(name_of(path, volume), None)
    properties = owner.rle_splat
    for first in volumes.volume_objects(context.scene)[:1]:
        properties.lighting = first.rle_splat.lighting  # volumes of a scene are lit alike until a user changes one
    source_options.copy(options, properties)
    properties.playback = HOLD if found.is_in_time and not options.frame else FIXED
    fill_volume(context.scene, owner, found)
    remark = "" if transfer_function is None else write_transfer(owner, transfer_function)
    linked.put_into_scene(context, owner)
    if at_cursor:
        corners = box.corners_of(volume.shape_xyz, volume.affine)
        middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0)) * scene_scale_of(context.scene, volume.unit)
        owner.location = [c - m for c, m in zip(context.scene.cursor.location, middle)]
    context.view_layer.update()  # otherwise the layer does not list the new object yet
    if context.mode != "OBJECT":
        return owner, remark  # the user has begun to edit another object meanwhile
    for other in context.view_layer.objects.selected[:]:
        other.select_set(False)
    if owner.name in context.view_layer.objects:  # False if the active collection is excluded from the layer
        owner.select_set(True)
        context.view_layer.objects.active = owner
    return owner, remark


def name_of(path: str, volume) -> str:
    """The name of the object of a volume that was read from a path."""
    kind = format_of(path)
    named = volume.name if kind is not None and kind.names_volume else os.path.basename(os.path.normpath(path))
    return named.split(".")[0] or "Volume"


def fill_volume(scene, owner, found: ReadSource) -> None:
    """Set the path, hashes, frames, facts and box of a volume object, and keep its voxels in memory."""
    properties, volume = owner.rle_splat, found.volume
    properties.is_volume = True
    owner.rle_splat.filepath = os.path.abspath(found.path)
    properties.data_key = volumes.hash_of(volume)
    properties.series_key = volume.series if volume.holds_values else ""
    properties.frame_count, properties.data_frame = found.frames, found.frame
    write_facts(owner, volume, found.counted)
    properties.remarks = "\n".join(found.remarks)
    properties.files_digest = volumes.files_digest(owner)
    box.give_box(owner, volume.shape_xyz, volume.affine, scene_scale_of(scene, volume.unit))
    store.put(store.wish_of(owner, None, volumes.PURPOSE), volumes.source_of(owner, found.frame).key, volume)
