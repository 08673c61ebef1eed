"""Add Channel from File, Add Selected Volumes and Remove Channel: volumes shown in the picture of the active one."""

import os

import bpy
from bpy.app.translations import pgettext_tip
from bpy.props import BoolProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..bridge.data import source_options
from ..bridge.held import Held
from ..bridge.loop import store
from ..bridge.translations import translate
from ..bridge.volumes import channels, loading, new_volume, volumes
from ..rle_splat.read.channels import MOST_CHANNELS
from ..rle_splat.runtime.steps import rescale
from ..rle_splat.scene import RleSplatError
from .import_volume import LAST_SUFFIXES, ImportsVolumes
from .placing import make_active
from .reading import LoadsFirst
from .refusal import has_editable_values, has_editable_volume, needs, refuses

OTHER_FILE = "Show another file together with this volume, as a channel: a PET or a dose on a CT, or a second stain"
OF_FILE = "Show the other channels of this volume's own file together with it"


class RLE_SPLAT_OT_add_channels(LoadsFirst, bpy.types.Operator):
    """Show the other selected volumes together with the active one, such as a PET on its CT, each with its own
    transfer function"""

    bl_idname = "rle_splat.add_channels"
    bl_label = "Add Selected Volumes"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return has_editable_values(cls, context) and needs(
            cls, cls._others(context), "Select another volume of the same place, then Shift-click this volume"
        )

    def loading(self, context):
        return loading.missing_steps(volumes.volume_object(context), further=self._others(context))

    @refuses
    def execute(self, context):
        owner, others = volumes.volume_object(context), self._others(context)
        remarks = channels.add_channels(owner, others)
        for remark in remarks:
            self.report({"INFO"}, remark)
        added = "A channel was" if len(others) == 1 else f"{len(others)} channels were"
        self.report({"INFO"}, f"{added} added to {owner.name}.")
        return {"FINISHED"}

    @staticmethod
    def _others(context) -> list:
        owner = volumes.volume_object(context)
        return [one for one in context.selected_objects if channels.can_be_added(owner, one)]


class RLE_SPLAT_OT_import_channel(ImportsVolumes, bpy.types.Operator, ImportHelper):
    """Show another file, or the other channels of this volume's own file, together with this volume: a PET or a dose
    on a CT, or a second stain"""

    bl_idname = "rle_splat.import_channel"
    bl_label = "Add Channel from File"
    bl_options = {"UNDO"}

    filter_glob: StringProperty(default=";".join("*" + suffix for suffix in LAST_SUFFIXES), options={"HIDDEN"})
    of_file: BoolProperty(
        name="Other Channels of This File", description="Add the other channels in the file of this volume",
        options={"SKIP_SAVE", "HIDDEN"})  # fmt: skip

    use_dialog: BoolProperty(
        name="Dialog", description="Ask for the file", default=True, options={"SKIP_SAVE", "HIDDEN"}
    )

    nothing_chosen = "No file was chosen; set filepath."
    is_channel = True
    operator_again = "import_channel"

    @classmethod
    def poll(cls, context):
        return super().poll(context) and has_editable_values(cls, context)

    @classmethod
    def description(cls, _context, properties):
        return pgettext_tip(OF_FILE if properties.of_file else OTHER_FILE)

    def invoke(self, context, _event):
        if self.of_file or not self.use_dialog:
            return self.begin(context)
        source_options.clear(self)
        self.is_confirmed = True
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, _context):
        pass  # nothing is asked for but the file

    def paths(self) -> list[str]:
        return [bpy.path.abspath(self.filepath)] if self.filepath else []

    def loading(self, context):
        return loading.missing_steps(volumes.volume_object(context))

    def prepare(self, context):
        owner = volumes.volume_object(context)
        self._owner, options = Held(owner), source_options.PlainOptions()
        if self.of_file:
            source_options.copy(owner.rle_splat, options)
            numbers = [n for n in range(1, owner.rle_splat.frame_count + 1) if n != owner.rle_splat.data_frame]
            if not 0 < len(numbers) < MOST_CHANNELS:
                raise RleSplatError(
                    f"The file of {owner.name!r} holds {owner.rle_splat.frame_count} volumes; 2 to {MOST_CHANNELS} can "
                    "be shown as channels."
                )
            path = volumes.resolved_path(owner)
            sources = [(path, source_options.at_frame(options, number)) for number in numbers]
        elif self.paths():
            source_options.copy(self, options)
            sources = [(path, options) for path in self.paths()]
        else:
            raise RleSplatError(self.nothing_chosen)
        wish = store.wish_of(owner, None, self.bl_idname)
        return self.with_thumbnails(self._placed_steps(sources, owner.name, volumes.load_volume(owner), wish))

    def _placed_steps(self, sources, name: str, volume, wish):
        """Generator of Progress: as ``_one_steps`` for each (path, options), and each on the grid of the volume."""
        read = []
        for i, (path, options) in enumerate(sources):
            begin, end = i / len(sources), (i + 1) / len(sources)
            read.append((yield from rescale(self._one_steps(path, options), begin, end)))
            channel = read[-1][0].volume
            placed = yield from rescale(channels.placed_steps(wish, channel, volume), end, end)
            channels.check_grid(os.path.basename(path), placed, name, volume)
        return read

    def commit(self, context, results):
        owner, added = self._owner.get(), []
        for found, options, transfer_function, reason, _ in results:
            other, remark = new_volume.add_volume(context, found, options, transfer_function)
            added.append(other)
            for sentence in filter(None, (*found.remarks, remark)):
                self.report({"WARNING"}, translate(sentence))
            self.report({"INFO"}, translate(reason))
        for remark in channels.add_channels(owner, added):
            self.report({"INFO"}, translate(remark))
        make_active(self, context, owner, "shows the channels")


class RLE_SPLAT_OT_remove_channel(bpy.types.Operator):
    """Remove this channel from the list. Its volume stays in the scene"""

    bl_idname = "rle_splat.remove_channel"
    bl_label = "Remove Channel"
    bl_options = {"REGISTER", "UNDO"}

    index: IntProperty(name="Number", description="Row in the list of channels, from 0", min=0)

    poll = classmethod(has_editable_volume)

    @refuses
    def execute(self, context):
        channels.remove_channel(volumes.volume_object(context), self.index)
        return {"FINISHED"}
