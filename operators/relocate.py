"""Relocate Volume: choose the file of a volume that was moved."""

import os

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ..bridge import new_volume, source_options, volumes
from ..rle_splat.scene import RleSplatError
from ..rle_splat.volume.checks import check_values
from .import_volume import LAST_SUFFIXES
from .refusal import has_editable_volume, refuse


class RLE_SPLAT_OT_relocate(bpy.types.Operator, ImportHelper):
    """Choose the volume's file at its new place. It is read with the options of the import"""

    bl_idname = "rle_splat.relocate"
    bl_label = "Relocate Volume"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(default=";".join("*" + suffix for suffix in LAST_SUFFIXES), options={"HIDDEN"})

    @classmethod
    def poll(cls, context):
        return has_editable_volume(cls, context)

    def execute(self, context):
        owner = volumes.volume_object(context)
        path = os.path.abspath(bpy.path.abspath(self.filepath))
        before = owner.rle_splat.data_key
        try:
            volume = volumes.read_file(path, source_options.read_options(owner.rle_splat))
            check_values(volume)
        except RleSplatError as problem:
            return refuse(self, problem)
        new_volume.fill_volume(context.scene, owner, path, volume)
        if before and before != owner.rle_splat.data_key:
            self.report({"WARNING"}, f"The voxels of {os.path.basename(path)} differ from those that were imported; "
                                     "undo if this is the wrong file.")
        return {"FINISHED"}


CLASSES = (RLE_SPLAT_OT_relocate,)
