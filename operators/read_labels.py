"""Read Labels: list the labels in the volume's label file."""

import bpy

from ..bridge.volumes import labels, loading, volumes
from ..rle_splat.scene import RleSplatError
from .reading import LoadsFirst
from .refusal import has_editable_values, refuse


class RLE_SPLAT_OT_read_labels(LoadsFirst, bpy.types.Operator):
    """List the segments in the label file. Each can be hidden, or get its own color and opacity"""

    bl_idname = "rle_splat.read_labels"
    bl_label = "Read Segments"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        if not has_editable_values(cls, context):
            return False
        if not volumes.volume_object(context).rle_splat.label_file:
            cls.poll_message_set("Choose a label file first")
            return False
        return True

    def loading(self, context):
        return loading.missing_steps(volumes.volume_object(context), with_labels=True)

    def execute(self, context):
        owner = volumes.volume_object(context)
        try:
            count, further, remarks = labels.list_labels(owner, volumes.load_volume(owner))
        except RleSplatError as problem:
            return refuse(self, problem)
        for remark in remarks:
            self.report({"INFO"}, remark)
        self.report({"INFO"}, f"{count} segments" + (
            f"; {further} rows of the library have no voxels but cannot be removed" if further else ""))
        return {"FINISHED"}


CLASSES = (RLE_SPLAT_OT_read_labels,)
