"""Add Selected Volumes and Remove Channel: volumes that are added to the picture of the active one."""

import bpy
from bpy.props import IntProperty

from ..bridge.volumes import channels, loading, volumes
from ..rle_splat.scene import RleSplatError
from .reading import LoadsFirst
from .refusal import has_editable_values, has_editable_volume, refuse


class RLE_SPLAT_OT_add_channels(LoadsFirst, bpy.types.Operator):
    """Add the other selected volumes to the picture of the active one, each with its own transfer function"""

    bl_idname = "rle_splat.add_channels"
    bl_label = "Add Selected Volumes"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        if not has_editable_values(cls, context):
            return False
        owner = volumes.volume_object(context)
        if not any(channels.can_be_added(owner, one) for one in context.selected_objects):
            cls.poll_message_set("Select another volume of the same place, then Shift-click this volume")
            return False
        return True

    def loading(self, context):
        return loading.missing_steps(volumes.volume_object(context), further=self._others(context))

    def execute(self, context):
        owner, others = volumes.volume_object(context), self._others(context)
        try:
            remarks = channels.add_channels(owner, others)
        except RleSplatError as problem:
            return refuse(self, problem)
        for remark in remarks:
            self.report({"INFO"}, remark)
        self.report({"INFO"}, f"{len(others)} channel(s) added to {owner.name}")
        return {"FINISHED"}

    @staticmethod
    def _others(context) -> list:
        owner = volumes.volume_object(context)
        return [one for one in context.selected_objects if channels.can_be_added(owner, one)]


class RLE_SPLAT_OT_remove_channel(bpy.types.Operator):
    """Remove this volume from the picture and keep its object"""

    bl_idname = "rle_splat.remove_channel"
    bl_label = "Remove Channel"
    bl_options = {"REGISTER", "UNDO"}

    index: IntProperty(name="Number", description="Row in the list of channels, from 0", min=0)

    @classmethod
    def poll(cls, context):
        return has_editable_volume(cls, context)

    def execute(self, context):
        try:
            channels.remove_channel(volumes.volume_object(context), self.index)
        except RleSplatError as problem:
            return refuse(self, problem)
        return {"FINISHED"}


CLASSES = (RLE_SPLAT_OT_add_channels, RLE_SPLAT_OT_remove_channel)
