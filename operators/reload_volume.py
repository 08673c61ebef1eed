"""Reload Volume: read the file of a volume again, with the options of the import or with others."""

import bpy
from bpy.app.translations import pgettext_tip
from bpy.props import BoolProperty

from ..bridge.data import source_options
from ..bridge.data.automatic import draw_number
from ..bridge.held import Held
from ..bridge.volumes import new_volume, volumes
from ..bridge.volumes.import_source import found_steps
from ..bridge.volumes.source_paths import resolved_path
from .reading import ReadsFiles
from .refusal import has_editable_volume

AS_BEFORE = "Read the volume's file again with the same options"
WITH_OTHERS = "Read the volume's file again with other options, such as spacing, unit, orientation and flips"


class RLE_SPLAT_OT_reload_volume(ReadsFiles, source_options.SourceOptions, bpy.types.Operator):
    """Read the volume's file again: Reload with the same options, Edit with others"""

    bl_idname = "rle_splat.reload_volume"
    bl_label = "Reload Volume"

    operator_again = "reload_volume"

    use_dialog: BoolProperty(
        name="Dialog", description="Ask for spacing, unit, orientation and flips before reading", default=False,
        options={"SKIP_SAVE", "HIDDEN"})  # fmt: skip

    poll = classmethod(has_editable_volume)

    @classmethod
    def description(cls, _context, properties):
        return pgettext_tip(WITH_OTHERS if properties.use_dialog else AS_BEFORE)

    def invoke(self, context, _event):
        if not self.use_dialog:
            return self.begin(context)
        source_options.copy(volumes.volume_object(context).rle_splat, self)
        self.found_spacing = volumes.volume_object(context).rle_splat.found_spacing
        self.is_confirmed = True
        return context.window_manager.invoke_props_dialog(
            self, title="Edit and Reload", confirm_text="Reload", width=340
        )

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        source_options.draw_place(layout, self)
        owner = volumes.volume_object(context)
        if owner is not None and owner.rle_splat.level >= 0:
            draw_number(layout, self, "level", "use_fitting_level")
        if owner is not None and owner.rle_splat.frame_count > 1:
            layout.label(text="Set the time point in File > Time", icon="INFO")
        layout.separator()
        for name in ("modality", "value_unit"):
            layout.prop(self, name)
        source_options.draw_calibration(layout, self)

    def options_again(self) -> dict:
        return {"use_dialog": False}

    def prepare(self, context):
        owner = volumes.volume_object(context)
        self._owner, self._options = Held(owner), source_options.PlainOptions()
        source_options.copy(owner.rle_splat, self._options)
        given = source_options.PlainOptions()
        source_options.copy(self, given)
        for name in source_options.NAMES:
            if self.properties.is_property_set(name):
                setattr(self._options, name, getattr(given, name))
        read = self._options if owner.rle_splat.frame_count < 2 else source_options.at_frame(
            self._options, owner.rle_splat.data_frame)  # fmt: skip
        return self.with_thumbnails(found_steps(resolved_path(owner), read))

    def commit(self, context, found):
        owner = self._owner.get()
        source_options.keep_level(self._options, found.volume)
        source_options.copy(self._options, owner.rle_splat)
        new_volume.fill_volume(context.scene, owner, found)
