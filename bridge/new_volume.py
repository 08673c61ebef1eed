"""Create the object of a volume that was read."""

import os

import bpy

from ..rle_splat.read.formats import format_of
from . import box, linked, source_options, source_paths, volumes
from .facts import write_facts
from .settings import scene_scale_of
from .transfer import write_transfer


def add_volume(context, path: str, volume, options, transfer_function, at_cursor: bool = False):
    """Add a volume object to the scene; it becomes the active and only selected object.

    Parameters
    ----------
    context : bpy.types.Context
        Gives scene, collection, view layer and 3D cursor.
    path : str
        The file that was read.
    volume : Volume
        Its voxels.
    options : SourceOptions or PlainOptions
        The options with which the file was read.
    transfer_function : TransferFunction
        Its first transfer function.
    at_cursor : bool
        Whether to place the center of the box at the 3D cursor instead of keeping the file's coordinates.

    Returns
    -------
    owner : bpy.types.Object
        The volume object.
    remark : str
        What of the transfer function could not be stored exactly, or "".
    """
    kind = format_of(path)
    named = volume.name if kind is not None and kind.names_volume else os.path.basename(os.path.normpath(path))
    name = named.split(".")[0] or "Volume"
    owner = bpy.data.objects.new(name, None)
    properties = owner.rle_splat
    source_options.copy(options, properties)
    fill_volume(context.scene, owner, path, volume)
    remark = write_transfer(owner, transfer_function)
    home = context.collection if linked.is_own(context.collection) else context.scene.collection
    home.objects.link(owner)
    if at_cursor:
        corners = box.corners_of(volume.shape_xyz, volume.affine)
        middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0)) * scene_scale_of(context.scene, volume.unit)
        owner.location = [c - m for c, m in zip(context.scene.cursor.location, middle)]
    context.view_layer.update()  # otherwise the layer does not list the new object yet
    for other in context.view_layer.objects.selected[:]:
        other.select_set(False)
    if owner.name in context.view_layer.objects:  # False if the active collection is excluded from the layer
        owner.select_set(True)
        context.view_layer.objects.active = owner
    return owner, remark


def fill_volume(scene, owner, path: str, volume) -> None:
    """Set the path, hash, facts and box of a volume object, and keep its voxels in memory.

    Parameters
    ----------
    scene : bpy.types.Scene
        Gives the scene scale.
    owner : bpy.types.Object
        The volume object.
    path : str
        The file that was read.
    volume : Volume
        Its voxels.
    """
    properties = owner.rle_splat
    properties.is_volume = True
    source_paths.write_path(owner, "filepath", os.path.abspath(path), bpy.data.filepath)
    properties.data_key = volume.voxel_key
    write_facts(owner, volume)
    box.give_box(owner, volume.shape_xyz, volume.affine, scene_scale_of(scene, volume.unit))
    volumes.keep_volume(owner, volume)
