"""Load and Save Transfer Function: JSON files that the command line reads too."""

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ExportHelper, ImportHelper

from ..bridge import transfer, volumes
from ..rle_splat.classify.transfer_function import TransferFunction
from ..rle_splat.scene import RleSplatError
from .refusal import has_editable_volume, has_volume, refuse


class RLE_SPLAT_OT_load_transfer(bpy.types.Operator, ImportHelper):
    """Read the volume's transfer function from a JSON file"""

    bl_idname = "rle_splat.load_transfer"
    bl_label = "Load Transfer Function"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})

    @classmethod
    def poll(cls, context):
        return has_editable_volume(cls, context)

    def execute(self, context):
        try:
            transfer_function = TransferFunction.from_json(bpy.path.abspath(self.filepath))
        except RleSplatError as problem:
            return refuse(self, problem)
        remark = transfer.write_transfer(volumes.volume_object(context), transfer_function)
        if remark:
            self.report({"WARNING"}, remark)
        return {"FINISHED"}


class RLE_SPLAT_OT_save_transfer(bpy.types.Operator, ExportHelper):
    """Write the volume's transfer function at the current frame to a JSON file"""

    bl_idname = "rle_splat.save_transfer"
    bl_label = "Save Transfer Function"

    filename_ext = ".json"
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})

    @classmethod
    def poll(cls, context):
        return has_volume(cls, context)

    def execute(self, context):
        owner = volumes.volume_object(context)
        try:
            transfer.read_transfer(owner, context.evaluated_depsgraph_get()).save(bpy.path.abspath(self.filepath))
        except RleSplatError as problem:
            return refuse(self, problem)
        return {"FINISHED"}


CLASSES = (RLE_SPLAT_OT_load_transfer, RLE_SPLAT_OT_save_transfer)
