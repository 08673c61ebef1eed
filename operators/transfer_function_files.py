"""Load and Save Transfer Function: JSON files that the command line reads too, and files of other programs."""

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ExportHelper, ImportHelper

from ..bridge.look import transfer
from ..bridge.volumes import volumes
from ..rle_splat.classify.presets import RELATIVE
from ..rle_splat.classify.transfer_files import choose_function, fit_function, read_transfer_functions
from .choose_transfer_function import FILES, choose
from .refusal import has_editable_values, has_volume, refuses


class RLE_SPLAT_OT_load_transfer_function(bpy.types.Operator, ImportHelper):
    """Read the volume's transfer function from a file of RLE Splat, 3D Slicer, niivue or FSL"""

    bl_idname = "rle_splat.load_transfer_function"
    bl_label = "Load Transfer Function"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(default=FILES, options={"HIDDEN"})
    name: StringProperty(
        name="Name", description="Which transfer function of a file that holds several", options={"SKIP_SAVE"}
    )

    poll = classmethod(has_editable_values)

    @refuses
    def execute(self, context):
        owner = volumes.volume_object(context)
        path = bpy.path.abspath(self.filepath)
        found = read_transfer_functions(path)
        if len(found) > 1 and not self.name and context.window is not None and not bpy.app.background:
            return choose(path, found)
        one = choose_function(found, self.name or None, path, "Name")
        function = one.function
        if function.unit == RELATIVE:
            function = fit_function(function, volumes.load_volume(owner))
        for remark in filter(None, (*one.remarks, transfer.write_transfer(owner, function))):
            self.report({"WARNING"}, remark)
        return {"FINISHED"}


class RLE_SPLAT_OT_save_transfer_function(bpy.types.Operator, ExportHelper):
    """Write the volume's transfer function at the current frame to a JSON file"""

    bl_idname = "rle_splat.save_transfer_function"
    bl_label = "Save Transfer Function"

    filename_ext = ".json"
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})

    poll = classmethod(has_volume)

    @refuses
    def execute(self, context):
        owner = volumes.volume_object(context)
        transfer.read_transfer(owner, context.evaluated_depsgraph_get()).save(bpy.path.abspath(self.filepath))
        return {"FINISHED"}
