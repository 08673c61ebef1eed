"""Relocate Volume: choose the file of a volume that was moved."""

import os

import bpy
from bpy.props import BoolProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..bridge import new_volume, source_options, volumes
from ..bridge.held import Held
from ..bridge.jobs import StepwiseOperator
from .import_volume import LAST_SUFFIXES
from .refusal import has_editable_volume


class RLE_SPLAT_OT_relocate(StepwiseOperator, bpy.types.Operator, ImportHelper):
    """Choose the volume's file at its new place. It is read with the options of the import"""

    bl_idname = "rle_splat.relocate"
    bl_label = "Relocate Volume"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(default=";".join("*" + suffix for suffix in LAST_SUFFIXES), options={"HIDDEN"})
    in_steps: BoolProperty(
        name="In Steps", description="Begin at once, without the file browser, and keep the window alive meanwhile",
        options={"SKIP_SAVE", "HIDDEN"})
    is_new = False  # Blender makes the undo step itself, since the operator has the option UNDO

    @classmethod
    def poll(cls, context):
        return has_editable_volume(cls, context)

    def invoke(self, context, event):
        if self.in_steps:
            return StepwiseOperator.invoke(self, context, event)
        return ImportHelper.invoke(self, context, event)

    def execute(self, context):
        if not self.goes_on_in_window(context):
            return StepwiseOperator.execute(self, context)
        bpy.ops.rle_splat.relocate("INVOKE_DEFAULT", in_steps=True, filepath=self.filepath)
        return {"CANCELLED"}  # the other one goes on

    def prepare(self, context):
        owner = volumes.volume_object(context)
        self._owner, self._path = Held(owner), os.path.abspath(bpy.path.abspath(self.filepath))
        return volumes.read_file_steps(self._path, source_options.read_options(owner.rle_splat))

    def commit(self, context, volume):
        owner = self._owner.get()
        before = owner.rle_splat.data_key
        new_volume.fill_volume(context.scene, owner, self._path, volume)
        if before and before != owner.rle_splat.data_key:
            self.report({"WARNING"}, f"The voxels of {os.path.basename(self._path)} differ from those that were "
                                     "imported; undo if this is the wrong file.")


CLASSES = (RLE_SPLAT_OT_relocate,)
