"""Choose from a file that holds several transfer functions, or keep all of them as presets of the user."""

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..bridge.look import own_presets
from ..bridge.pictures.canvas import redraw_sidebars
from ..bridge.translations import filled
from ..rle_splat.classify.transfer_files import SUFFIXES, read_transfer_functions
from .refusal import refuses

FILES = ";".join(f"*{suffix}" for suffix in SUFFIXES)
WIDTH = 360  # pixels at interface scale 1
EVERY = ("*", "All, as User Presets", "Keep all of them beside the presets of the extension")

_items: list = []  # of the file that is chosen from; Blender keeps no reference to their texts


def choose(path: str, found) -> set:
    """Show the dialog for the transfer functions ``found`` in the file ``path``; the result for ``execute``."""
    names = [one.function.name for one in found]
    _items[:] = [EVERY] + [(name, name, "Apply this one to the volume") for name in names]
    bpy.ops.rle_splat.choose_transfer_function("INVOKE_DEFAULT", filepath=path)
    return {"CANCELLED"}  # nothing has changed yet


def _choices(_operator, _context):
    return _items or [EVERY]


class RLE_SPLAT_OT_choose_transfer_function(bpy.types.Operator):
    """Choose which transfer function of a file to apply, or keep all as presets"""

    bl_idname = "rle_splat.choose_transfer_function"
    bl_label = "Choose a Transfer Function"
    bl_options = {"INTERNAL"}

    filepath: StringProperty(name="File", description="The file", options={"HIDDEN", "SKIP_SAVE"})
    choice: EnumProperty(name="Use", description="What to take from the file", items=_choices, options={"SKIP_SAVE"})
    overwrite: BoolProperty(
        name="Replace Presets of the Same Name", description="Replace user presets that have the same names",
        default=False, options={"SKIP_SAVE"})  # fmt: skip

    def invoke(self, context, _event):
        return context.window_manager.invoke_props_dialog(self, width=WIDTH)

    def draw(self, _context):
        layout = self.layout
        layout.label(text=f"The file holds {len(_items) - 1} transfer functions")
        layout.prop(self, "choice")
        row = layout.row()
        row.active = self.choice == EVERY[0]
        row.prop(self, "overwrite")

    def execute(self, _context):
        if self.choice == EVERY[0]:
            return bpy.ops.rle_splat.import_presets(filepath=self.filepath, overwrite=self.overwrite)
        return bpy.ops.rle_splat.load_transfer_function("EXEC_DEFAULT", True, filepath=self.filepath, name=self.choice)


class RLE_SPLAT_OT_import_presets(bpy.types.Operator, ImportHelper):
    """Add all transfer functions of a file, such as 3D Slicer's presets.xml, to your presets"""

    bl_idname = "rle_splat.import_presets"
    bl_label = "Import Presets"

    filter_glob: StringProperty(default=FILES, options={"HIDDEN"})
    overwrite: BoolProperty(
        name="Replace Presets of the Same Name", description="Replace user presets that have the same names",
        default=False, options={"SKIP_SAVE"})  # fmt: skip

    @refuses
    def execute(self, context):
        found = read_transfer_functions(bpy.path.abspath(self.filepath))
        own_presets.save_all([one.function for one in found], self.overwrite)
        for remark in sorted({remark for one in found for remark in one.remarks}):
            names = ", ".join(one.function.name for one in found if remark in one.remarks)
            self.report({"WARNING"}, f"{names}: {remark}")
        self.report({"INFO"}, filled("User presets added: {count}.", count=len(found)))
        redraw_sidebars(context)
        return {"FINISHED"}
