"""Import Volume: the entry in File > Import, the import dialog, and files dropped into the window."""

import os
import textwrap

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper, poll_file_object_drop

from ..bridge import facts, new_volume, source_options, volumes
from ..bridge.preset_items import IMPORT_ITEMS, chosen_transfer
from ..rle_splat.read.formats import FORMATS, RAW, format_named, format_of, suffixes
from ..rle_splat.read.guess import guess_raw
from ..rle_splat.scene import RleSplatError
from ..rle_splat.volume.checks import check_values
from .refusal import refuse

# Blender filters by the last suffix only, so .raw.gz is listed as .gz; the format is checked when the file is opened.
LAST_SUFFIXES = tuple(dict.fromkeys("." + suffix.rpartition(".")[2] for suffix in suffixes()))
# Without the suffixes of pictures and other files that Blender itself or other add-ons take when they are dropped.
DROPPED_SUFFIXES = tuple(dict.fromkeys(
    "." + suffix.rpartition(".")[2] for entry in FORMATS if entry.is_dropped for suffix in entry.suffixes))
LETTERS = 46  # characters in a line of the dialog, since labels do not wrap
DIALOG_GUESS_LIMIT = 1 << 28  # bytes unpacked to find a file's size while the dialog opens; about a second


class RLE_SPLAT_OT_import_volume(source_options.SourceOptions, bpy.types.Operator, ImportHelper):
    """Import a volume for RLE Splat. Its voxels stay in the file"""

    bl_idname = "rle_splat.import_volume"
    bl_label = "Import Volume"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    filter_glob: StringProperty(default=";".join("*" + suffix for suffix in LAST_SUFFIXES), options={"HIDDEN"})
    directory: StringProperty(subtype="DIR_PATH", options={"SKIP_SAVE", "HIDDEN"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"SKIP_SAVE", "HIDDEN"})
    preset: EnumProperty(
        name="Transfer Function", description="Initial colors and opacities", items=IMPORT_ITEMS)
    at_cursor: BoolProperty(
        name="Center at Cursor", description="Place the center of the volume at the 3D cursor instead of keeping the "
        "coordinates of the file", default=False)
    guessed_for: StringProperty(options={"SKIP_SAVE", "HIDDEN"})
    guess_text: StringProperty(options={"SKIP_SAVE", "HIDDEN"})

    @classmethod
    def poll(cls, context):
        if context.mode != "OBJECT":
            cls.poll_message_set("Switch to Object Mode first")
            return False
        return True

    def paths(self) -> list[str]:
        """Absolute paths to import: the files chosen in the dialog or dropped, else ``filepath``."""
        names = [entry.name for entry in self.files if entry.name]
        if self.directory and names:
            return [os.path.join(self.directory, name) for name in names]
        return [bpy.path.abspath(self.filepath)] if self.filepath else []

    def invoke(self, context, event):
        source_options.clear(self)  # Blender keeps the options of the last import, guesses included
        self.check(context)
        return self.invoke_popup(context)

    def check(self, _context):
        """Guess the raw layout when another file is picked; return whether the dialog changed."""
        paths = self.paths()
        path = paths[0] if len(paths) == 1 else ""
        if path == self.guessed_for:
            return False
        self.guessed_for, self.guess_text = path, ""
        source_options.clear(self)
        if path and os.path.isfile(path) and format_of(path) is RAW:
            try:
                guess = guess_raw(path, limit=DIALOG_GUESS_LIMIT)
            except RleSplatError as problem:
                self.guess_text = str(problem)
            else:
                source_options.fill_from_guess(self, guess)
                self.guess_text = "\n".join(guess.reasons)
        return True

    def draw(self, _context):
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        paths = self.paths()
        kind = format_named(paths[0]) if paths else None
        if len(paths) > 1:
            layout.label(text=f"{len(paths)} files; each layout is guessed")
        elif kind is None or "shape" in kind.options:
            self._draw_raw(layout)
        else:
            for name in ("grid", "series", "frame", "spacing"):
                if name in kind.options:
                    layout.prop(self, name)
        layout.separator()
        layout.prop(self, "modality")
        layout.prop(self, "value_unit")
        layout.prop(self, "use_calibration")
        column = layout.column(align=True)
        column.active = self.use_calibration
        column.prop(self, "slope")
        column.prop(self, "intercept")
        layout.separator()
        layout.prop(self, "preset")
        layout.prop(self, "at_cursor")

    def _draw_raw(self, layout):
        for name in ("shape", "dtype", "byte_order", "header_bytes", "spacing"):
            layout.prop(self, name)
        if all(self.shape) and self.dtype != "AUTO":
            layout.label(text=f"In memory: {facts.memory_text(source_options.bytes_of(self))}", icon="MEMORY")
        if self.guess_text:
            box = layout.box().column(align=True)
            box.scale_y = 0.8
            for sentence in self.guess_text.split("\n"):
                for line in textwrap.wrap(sentence, LETTERS):
                    box.label(text=line)

    def execute(self, context):
        paths = self.paths()
        if not paths:
            return refuse(self, "No file was chosen; set filepath, or directory and files.")
        explicit = len(paths) == 1
        try:
            read = [self._read(path, explicit) for path in paths]
        except RleSplatError as problem:
            return refuse(self, problem)
        for path, options, volume, transfer_function, reason in read:
            owner, remark = new_volume.add_volume(
                context, path, volume, options, transfer_function, at_cursor=self.at_cursor)
            for sentence in (*volume.remarks, remark):
                if sentence:
                    self.report({"WARNING"}, sentence)
            self.report({"INFO"}, " ".join(filter(None, (f"Imported {owner.name}.", reason))))
        return {"FINISHED"}

    def _read(self, path: str, explicit: bool):
        """Return (path, options, Volume, TransferFunction, reason for it) without changing the .blend."""
        options = source_options.PlainOptions()
        if explicit:
            source_options.copy(self, options)
        if os.path.isfile(path) and format_of(path) is RAW:
            self._complete(path, options)
        volume = volumes.read_file(path, source_options.read_options(options))
        check_values(volume)
        transfer_function, reason = chosen_transfer(self.preset, volume)
        return path, options, volume, transfer_function, reason

    def _complete(self, path: str, options) -> None:
        """Guess the missing layout of a raw file and report it; raise RleSplatError when nothing fits its size."""
        if any(options.shape) and options.dtype != "AUTO":
            return
        known = {name: value for name, value in source_options.read_options(options).items()
                 if name in ("shape", "dtype", "byte_order", "header_bytes")}
        guess = guess_raw(path, **known)
        if guess.shape is None or guess.dtype is None or not guess.candidates:
            size = "too many" if guess.size is None else guess.size
            raise RleSplatError(
                f"No shape and type can be guessed for {os.path.basename(path)} from its {size} bytes; "
                "set Shape and Type in the import dialog.")
        if not guess.certain:
            self.report({"WARNING"}, f"{os.path.basename(path)} was read as {guess.candidates[0]}. This is a guess; "
                                     "if it looks wrong, import it again with its Shape and Type.")
        spacing = tuple(options.spacing)
        source_options.fill_from_guess(options, guess)
        if any(spacing):
            options.spacing = spacing


class RLE_SPLAT_FH_volume(bpy.types.FileHandler):
    """Import volumes that are dropped into the 3D view or the outliner"""

    bl_idname = "RLE_SPLAT_FH_volume"
    bl_label = "Volume (RLE Splat)"
    bl_import_operator = "rle_splat.import_volume"
    bl_file_extensions = ";".join(DROPPED_SUFFIXES)

    @classmethod
    def poll_drop(cls, context):
        return poll_file_object_drop(context)


def draw_menu_entry(menu, _context):
    names = ", ".join(entry.name for entry in FORMATS)
    menu.layout.operator(RLE_SPLAT_OT_import_volume.bl_idname, text=f"Volume (RLE Splat) ({names})")


CLASSES = (RLE_SPLAT_OT_import_volume, RLE_SPLAT_FH_volume)
