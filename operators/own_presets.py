"""Apply, save and delete presets of the user."""

import bpy
from bpy.props import BoolProperty, StringProperty

from ..bridge.look import own_presets, transfer
from ..bridge.pictures.canvas import redraw_sidebars
from ..bridge.volumes import volumes
from ..rle_splat.runtime.steps import drain
from .applying import AppliesTransfer
from .refusal import has_volume, refuses

WIDTH = 300  # pixels at interface scale 1


class RLE_SPLAT_OT_apply_user_preset(AppliesTransfer, bpy.types.Operator):
    """Replace the volume's colors and opacities with those of this preset"""

    bl_idname = "rle_splat.apply_user_preset"
    bl_label = "Apply User Preset"

    name: StringProperty(name="Name", description="Name of the preset")

    def chosen(self, volume):
        return drain(own_presets.transfer_steps(self.name, volume))


class RLE_SPLAT_OT_save_user_preset(bpy.types.Operator):
    """Save the volume's transfer function at the current frame as a preset"""

    bl_idname = "rle_splat.save_user_preset"
    bl_label = "Save as Preset"

    name: StringProperty(name="Name", description="Name of the preset, and of its file", options={"SKIP_SAVE"})
    overwrite: BoolProperty(
        name="Replace", description="Replace a preset of the same name", default=False, options={"SKIP_SAVE"}
    )

    poll = classmethod(has_volume)

    def invoke(self, context, _event):
        if not self.name:
            self.name = own_presets.usable_name(volumes.volume_object(context).rle_splat.transfer_name)
        return context.window_manager.invoke_props_dialog(self, width=WIDTH, confirm_text="Save")

    def draw(self, _context):
        layout = self.layout
        layout.activate_init = True
        layout.prop(self, "name", text="")
        if own_presets.is_known(self.name):
            layout.prop(self, "overwrite", text=f"Replace {self.name.strip()}")

    @refuses
    def execute(self, context):
        owner = volumes.volume_object(context)
        function = transfer.read_transfer(owner, context.evaluated_depsgraph_get())
        own_presets.save(self.name, function, self.overwrite)
        self.report({"INFO"}, f"Saved the preset {self.name.strip()}")
        redraw_sidebars(context)
        return {"FINISHED"}


class RLE_SPLAT_OT_delete_user_preset(bpy.types.Operator):
    """Delete one of your presets. This cannot be undone"""

    bl_idname = "rle_splat.delete_user_preset"
    bl_label = "Delete User Preset"

    name: StringProperty(name="Name", description="Name of the preset", options={"SKIP_SAVE"})

    def invoke(self, context, event):
        return context.window_manager.invoke_confirm(
            self, event, title=f"Delete the preset {self.name}?", message="Its file is deleted for good.",
            confirm_text="Delete", icon="WARNING")  # fmt: skip

    @refuses
    def execute(self, context):
        own_presets.delete(self.name)
        self.report({"INFO"}, f"Deleted the preset {self.name}")
        redraw_sidebars(context)
        return {"FINISHED"}
