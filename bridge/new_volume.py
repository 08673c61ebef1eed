"""From a volume that was read to an object in the scene."""

import os

import bpy

from . import box, linked, source_options, source_paths, volumes
from .facts import write_facts
from .settings import scene_scale_of
from .transfer import write_transfer


def add_volume(context, path: str, volume, options, transfer_function, at_cursor: bool = False):
    """A new volume object, active and selected alone.  Returns (object, remark on the transfer function or "").

    ``options``: anything with the SourceOptions with which the file was read.  ``at_cursor``: move the middle of
    the box to the 3D cursor instead of keeping the file's own coordinates.
    """
    name = os.path.basename(path).split(".")[0] or "Volume"
    owner = bpy.data.objects.new(name, None)
    properties = owner.rle_splat
    source_options.copy(options, properties)
    remark = fill_volume(context.scene, owner, path, volume)
    remark = write_transfer(owner, transfer_function) or remark
    home = context.collection if linked.is_own(context.collection) else context.scene.collection
    home.objects.link(owner)
    if at_cursor:
        corners = box.corners_of(volume.shape_xyz, volume.affine)
        middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0)) * scene_scale_of(context.scene, volume.unit)
        owner.location = [c - m for c, m in zip(context.scene.cursor.location, middle)]
    context.view_layer.update()  # until then the layer does not list the new object
    for other in context.view_layer.objects.selected[:]:
        other.select_set(False)
    if owner.name in context.view_layer.objects:  # not so when the active collection is excluded from the layer
        owner.select_set(True)
        context.view_layer.objects.active = owner
    return owner, remark


def fill_volume(scene, owner, path: str, volume) -> None:
    """Point a volume object at a file that was read into ``volume``: path, hash, facts, box, voxels in memory."""
    properties = owner.rle_splat
    properties.is_volume = True
    source_paths.write_path(owner, "filepath", os.path.abspath(path), bpy.data.filepath)
    properties.data_key = volume.voxel_key
    write_facts(owner, volume)
    box.give_box(owner, volume.shape_xyz, volume.affine, scene_scale_of(scene, volume.unit))
    volumes.keep_volume(owner, volume)
