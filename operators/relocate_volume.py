"""Relocate Volume: choose the file or the folder of a volume that was moved."""

import os

import bpy
from bpy.props import BoolProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..bridge.data import source_options
from ..bridge.held import Held
from ..bridge.volumes import encoded, new_volume, volumes
from ..bridge.volumes.import_source import found_steps
from .import_volume import LAST_SUFFIXES
from .reading import ReadsFiles
from .refusal import has_editable_volume


class RLE_SPLAT_OT_relocate_volume(ReadsFiles, bpy.types.Operator, ImportHelper):
    """Choose the volume's file at its new place, or open its folder. It is read with the options of the import"""

    bl_idname = "rle_splat.relocate_volume"
    bl_label = "Relocate Volume"

    operator_again = "relocate_volume"

    filter_glob: StringProperty(default=";".join("*" + suffix for suffix in LAST_SUFFIXES), options={"HIDDEN"})
    series: IntProperty(
        name="Series", description="Number of the series, from 1, if the folder holds several; 0 uses that of the "
        "import",
        default=0, min=0, options={"SKIP_SAVE", "HIDDEN"})  # fmt: skip
    use_dialog: BoolProperty(
        name="Dialog", description="Ask for the file before reading", default=True, options={"SKIP_SAVE", "HIDDEN"}
    )

    poll = classmethod(has_editable_volume)

    def invoke(self, context, event):
        if not self.use_dialog:
            return self.begin(context)
        self.is_confirmed = True
        return ImportHelper.invoke(self, context, event)

    def options_again(self) -> dict:
        return {"filepath": self.filepath, "use_dialog": False}

    def prepare(self, context):
        owner = volumes.volume_object(context)
        self._owner, self._options = Held(owner), source_options.PlainOptions()
        source_options.copy(owner.rle_splat, self._options)
        if self.series:  # chosen by hand
            self._options.series, self._options.series_key = self.series, ""
        if owner.rle_splat.frame_count > 1:
            self._options.frame = owner.rle_splat.data_frame
        path = encoded.place_of(os.path.abspath(bpy.path.abspath(self.filepath)))
        return self.with_thumbnails(found_steps(path, self._options))

    def commit(self, context, found):
        owner = self._owner.get()
        before, series = owner.rle_splat.data_key, owner.rle_splat.series_key
        owner.rle_splat.series = self._options.series
        new_volume.fill_volume(context.scene, owner, found)
        if series and series != found.volume.series:
            self.report({"WARNING"}, f"{os.path.basename(found.path)} does not hold the series that was imported; "
                                     "another one was read. Undo if this is the wrong place.")  # fmt: skip
        elif before and before != owner.rle_splat.data_key:
            self.report({"WARNING"}, f"The voxels of {os.path.basename(found.path)} differ from those that were "
                                     "imported; undo if this is the wrong file.")  # fmt: skip
