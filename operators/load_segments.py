"""Load Segments: list the labels in the volume's label file."""

import bpy

from ..bridge.held import Held
from ..bridge.loop import store
from ..bridge.loop.jobs import READ_BUDGET
from ..bridge.volumes import labels, loading, volumes
from .reading import TakesVoxels
from .refusal import has_editable_values, needs


class RLE_SPLAT_OT_load_segments(TakesVoxels, bpy.types.Operator):
    """Read the segments of the segmentation file into the list, where each has an eye, a color and an opacity"""

    bl_idname = "rle_splat.load_segments"
    bl_label = "Load Segments"
    bl_options = {"UNDO"}  # without REGISTER: Adjust Last Operation (F9) would read the file again

    is_new = False  # Blender pushes the undo step, for UNDO is among ``bl_options``
    time_budget = READ_BUDGET

    @classmethod
    def poll(cls, context):
        return has_editable_values(cls, context) and needs(
            cls, volumes.volume_object(context).rle_splat.label_file, "Choose a segmentation file first"
        )

    def loading(self, context):
        return loading.missing_steps(volumes.volume_object(context), with_labels=True)

    def prepare(self, context):
        owner = volumes.volume_object(context)
        self._owner = Held(owner)
        wish = store.wish_of(owner, None, labels.PURPOSE)
        return labels.listed_steps(labels.file_of(owner), volumes.load_volume(owner), wish)

    def commit(self, _context, result):
        owner = self._owner.get()
        count, further, remarks = labels.list_labels(owner, result)
        for remark in remarks:
            self.report({"INFO"}, remark)
        sentence = f"{count} segments"
        if further:
            sentence += f"; {further} rows of the library have no voxels but cannot be removed"
        if not any(row.use_color for row in owner.rle_splat.labels):  # so that the picture is as before
            sentence += "; click Color by Anatomy to see them in color"
        self.report({"INFO"}, sentence)
