"""Import Volume and Import DICOM Series: the entries in File > Import, their dialogs, and files that are dropped."""

import os
import textwrap

import bpy
import numpy as np
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper, poll_file_object_drop

from ..bridge.data import preferences, source_options
from ..bridge.data.automatic import draw_number
from ..bridge.data.volume_properties import SHOWN_AGAIN, TABLE
from ..bridge.live import shown
from ..bridge.look.preset_items import IMPORT_ITEMS, chosen_transfer_steps
from ..bridge.scene import first_light, viewports
from ..bridge.translations import filled, translate, with_ellipsis
from ..bridge.volumes import box, encoded, labels, new_volume, segments, volumes
from ..bridge.volumes.import_source import found_steps
from ..rle_splat.read.formats import FORMATS, RAW, format_named, format_of, suffixes
from ..rle_splat.read.guess import guess_raw, guess_raw_steps
from ..rle_splat.read.header import CT_ASSUMED, MM_ASSUMED, frame_remark
from ..rle_splat.read.sequence import sequence_of
from ..rle_splat.read.tiff import is_page
from ..rle_splat.runtime.memory import bytes_text
from ..rle_splat.runtime.steps import Progress, rescale
from ..rle_splat.scene import RleSplatError
from .reading import ReadsFiles
from .refusal import needs

# Blender filters by the last suffix only, so .raw.gz is listed as .gz; the format is checked when the file is opened.
LAST_SUFFIXES = tuple(dict.fromkeys("." + suffix.rpartition(".")[2] for suffix in (*suffixes(), encoded.SUFFIX)))
# Without the suffixes of pictures and other files that Blender itself or other add-ons take when they are dropped.
DROPPED_SUFFIXES = (*dict.fromkeys(
    "." + suffix.rpartition(".")[2] for entry in FORMATS if entry.is_dropped for suffix in entry.suffixes),
    encoded.SUFFIX)  # fmt: skip
CHOOSING, BODY = 0.8, 0.85  # shares of the time until the transfer function is chosen, and the body is sought
HIDDEN = "All but the body is hidden; the eye of Background shows it."
DICOM, TIFF = (next(entry for entry in FORMATS if entry.name == name) for name in ("DICOM", "TIFF"))
# Options that are numbers, and the switch that leaves each to the file.
NUMBERS = (("series", "use_only_series"), ("frame", "use_first_frame"), ("level", "use_fitting_level"))
MOST_WITHIN = 0.05  # share of a scan's voxels; segments that have more are shown without the rest of it
ENCODED = "encoded"  # in place of the name of a format
# What a dialog proposes to users, and no script gets without asking.
PROPOSED = ("use_headlight", "use_segments", "hide_table")
LETTERS = 38  # characters in a line of the dialog, since labels do not wrap
DIALOG_GUESS_LIMIT = 1 << 26  # bytes unpacked to find a file's size while the dialog opens; about 0.2 s


def _shared_format(paths):
    """The format of all files, by their content; None if there are several formats, or no files."""
    kinds = {format_of(path) if os.path.isfile(path) else None for path in paths}
    return kinds.pop() if len(kinds) == 1 else None


def _are_pages(paths, kind) -> bool:
    """Whether files of a shared format are TIFF files, of which the first has a single page: they are a stack."""
    return kind is TIFF and is_page(paths[0])


def _sequence_among(paths, kind) -> tuple[str, bool]:
    """What the dialog says about numbered files, "" if there are none, and whether it proposes to read them as frames.

    It does for OpenVDB, whose numbered files are simulations, and where all chosen files are of one sequence. Files of
    one page are slices and no frames.
    """
    if _are_pages(paths, kind):
        return "", False
    numbered = [sequence_of(path) for path in paths]
    if not numbered or None in numbered or any(one.first != numbered[0].first for one in numbered):
        return "", False
    is_vdb = all(path.lower().endswith(".vdb") for path in paths)
    return f"{numbered[0].count} frames from {numbered[0].first.name}", is_vdb or len(paths) > 1


def _show_segments(owner, volume, made) -> str:
    """Show the body that was found, or the segments of a file; return what was done, for the report.

    Few segments, such as tumors, are shown within the scan, and many without it.
    """
    if made.number is not None:
        segments.show(owner, volume, made, "BACKGROUND")
        return filled(HIDDEN)
    segments.show(owner, volume, made)
    share = np.count_nonzero(made.found.volume.voxels) / made.found.volume.voxels.size
    labels.show_anatomy(owner.rle_splat.labels, hides_background=share > MOST_WITHIN)
    return filled("Loaded segments from {file}.", file=os.path.basename(made.path))


def _draw_text(layout, text: str) -> None:
    for line in textwrap.wrap(text, LETTERS):
        layout.label(text=line)


class ImportsVolumes(ReadsFiles, source_options.SourceOptions):
    """Mix-in: read the volumes at ``paths()`` and add an object for each."""

    nothing_chosen = "No file was chosen; set filepath, or directory and files."
    guesses: tuple = ()  # warnings about files whose layout was guessed
    is_channel = False  # whether the volumes are added to the picture of another one

    preset: EnumProperty(
        name="Preset", description="Initial colors and opacities", items=IMPORT_ITEMS, options={"SKIP_SAVE"}
    )
    at_cursor: BoolProperty(
        name="Center at Cursor", description="Place the center of the volume at the 3D cursor instead of keeping the "
        "coordinates of the file", default=False)  # fmt: skip
    use_framing: BoolProperty(
        name="Frame and Open Sidebar", description="Move the view so that all of the volume is seen, and open the "
        "tab RLE Splat in the sidebar. Camera views are not changed", default=True)  # fmt: skip
    use_headlight: BoolProperty(
        name="Use Headlight if Dark", description="Set Light Source in Lighting to Headlight for the first volume of a "
        "scene, if the scene's lights leave a side of it dark",
        default=False, options={"SKIP_SAVE"})  # fmt: skip
    use_segments: BoolProperty(
        name="Load Segments", description="Show the segmentation that lies beside the scan, colored by anatomy: a "
        "DICOM SEG or RTSTRUCT in its folder or the one above, or a label map or a folder of masks whose name has the "
        "word seg, label or segmentation", default=False, options={"SKIP_SAVE"})  # fmt: skip
    hide_table: BoolProperty(
        name="Hide Table", description=f"{TABLE} if the transfer function shows it. {SHOWN_AGAIN}",
        default=False, options={"SKIP_SAVE"})  # fmt: skip

    @classmethod
    def poll(cls, context):
        return needs(cls, context.mode == "OBJECT", "Switch to Object Mode first")

    def options_again(self) -> dict:
        options = source_options.PlainOptions()
        source_options.copy(self, options)
        (path,) = self.paths()  # of several, none would be asked about
        given = {name: value for name, value in vars(options).items() if name != "series"}
        return {**given, "filepath": path, "preset": self.preset, "at_cursor": self.at_cursor,
                "use_framing": self.use_framing, "use_headlight": self.use_headlight,
                "use_segments": self.use_segments, "hide_table": self.hide_table, "use_dialog": False}  # fmt: skip

    def ask(self) -> None:
        """Before a dialog: switch on what it proposes."""
        self.is_confirmed = True
        for name in PROPOSED:
            if not self.properties.is_property_set(name):
                setattr(self, name, True)

    def _draw_placing(self, layout):
        for name in ("at_cursor", "use_framing", *PROPOSED):
            layout.prop(self, name)

    def prepare(self, context):
        paths = self.paths()
        if not paths:
            raise RleSplatError(self.nothing_chosen)
        return self.with_thumbnails(self._steps(paths))

    def commit(self, context, results):
        owners, corners, sentences, warnings, notes = [], [], [], list(self.guesses), []
        for found, options, transfer_function, reason, made in results:
            owner, remark = new_volume.add_volume(context, found, options, transfer_function, at_cursor=self.at_cursor)
            harmless = {CT_ASSUMED, MM_ASSUMED}
            if found.frames > 1:
                harmless.update(frame_remark(found.frame, found.frames, found.volume.frame_axis))
            for sentence in filter(None, (*found.remarks, remark)):
                (notes if sentence in harmless else warnings).append(translate(sentence))
            owners.append(owner)
            corners.append(box.world_corners(owner))
            sentences += [filled("Imported {volume}.", volume=owner.name), translate(reason)]
            if made is not None:
                sentences.append(_show_segments(owner, found.volume, made))
        self._show(context, len(corners))
        if self.use_framing and not bpy.app.background:
            viewports.open_tab(context.window)
            viewports.frame(context.window, corners)
        eyes = [None, *viewports.eyes_of(None if bpy.app.background else context.window)]
        warnings += dict.fromkeys(
            viewports.hiding_sentence(context.view_layer, one, eye) for one in corners for eye in eyes
        )
        if self.use_headlight and corners:
            sentences.append(first_light.light_if_dark(context, owners, corners[0]))
        # Together, since of several messages a window shows the last one alone, and of a long one its beginning.
        said = " ".join(filter(None, (*sentences, *warnings, *notes)))
        self.report({"WARNING" if any(warnings) else "INFO"}, said)

    def _show(self, context, added: int) -> None:
        """Open the eyes of the window's viewports, or close them for a scene's first volumes, as the user prefers."""
        if self.was_in_window and preferences.value("show_imported"):
            shown.switch_all(context.window, True)
        elif self.was_in_window and len(volumes.volume_objects(context.scene)) == added:
            shown.switch_all(context.window, False)

    def _steps(self, paths):
        """Generator of Progress: ReadSource, options, TransferFunction or None, reason for it, and MadeSegment or None,
        of each path."""
        read = []
        for i, path in enumerate(paths):
            options = source_options.PlainOptions()
            if len(paths) == 1:
                source_options.copy(self, options)
            options.use_sequence = self.use_sequence
            read.append((yield from rescale(self._one_steps(path, options), i / len(paths), (i + 1) / len(paths))))
        return read

    def _one_steps(self, path: str, options):
        path = encoded.place_of(path)
        if os.path.isfile(path) and format_of(path) is RAW:
            yield from self._completed_steps(path, options)
        found = yield from rescale(found_steps(path, options), 0.0, CHOOSING)
        if not found.volume.holds_values:
            return found, options, None, encoded.STORED_VALUES, None
        source_options.keep_level(options, found.volume)
        transfer_function, reason = yield from rescale(
            chosen_transfer_steps(self.preset, found.volume, self.is_channel), CHOOSING, BODY
        )
        made = None
        if self.use_segments:
            made, problem = yield from rescale(segments.beside_steps(path, found.volume), BODY, 1.0)
            self.guesses += (problem,)
        if made is None and self.hide_table and found.frames == 1:
            steps = segments.body_steps(found.volume, transfer_function, new_volume.name_of(path, found.volume))
            made = yield from rescale(steps, BODY, 1.0)
        yield Progress(1.0, "adding the volume")  # in a slice of its own
        return found, options, transfer_function, reason, made

    def _completed_steps(self, path: str, options):
        """Generator of Progress: guess the missing layout of a raw file and report it.

        RleSplatError if nothing fits its size.
        """
        if any(options.shape) and options.dtype != "AUTO":
            return
        known = {name: value for name, value in source_options.read_options(options).items()
                 if name in ("shape", "dtype", "byte_order", "header_bytes")}  # fmt: skip
        guess = yield from guess_raw_steps(path, **known)
        if guess.shape is None or guess.dtype is None or not guess.candidates:
            size = "many" if guess.size is None else guess.size
            raise RleSplatError(
                f"No shape and type can be guessed for {os.path.basename(path)} from its {size} bytes; "
                "set Shape and Type in the import dialog."
            )
        if not guess.certain:
            self.guesses += (
                f"{os.path.basename(path)} is guessed to be {guess.candidates[0]}; if it looks wrong, import it again "
                "with its Shape and Type.",
            )
        spacing = tuple(options.spacing)
        source_options.fill_from_guess(options, guess)
        if any(spacing):
            options.spacing = spacing


class RLE_SPLAT_OT_import_volume(ImportsVolumes, bpy.types.Operator, ImportHelper):
    """Import a CT, MR, PET, microscopy, smoke or other volume. The .blend stores only its path"""

    bl_idname = "rle_splat.import_volume"
    bl_label = "Import Volume"
    bl_options = {"UNDO", "PRESET"}

    filter_glob: StringProperty(default=";".join("*" + suffix for suffix in LAST_SUFFIXES), options={"HIDDEN"})
    directory: StringProperty(
        name="Folder", description="Folder of the files", subtype="DIR_PATH", options={"SKIP_SAVE", "HIDDEN"}
    )
    files: CollectionProperty(
        name="Files", description="Several files of the folder, in place of filepath, each with its name",
        type=bpy.types.OperatorFileListElement, options={"SKIP_SAVE", "HIDDEN"})  # fmt: skip
    use_dialog: BoolProperty(
        name="Dialog", description="Ask for options before reading", default=True, options={"SKIP_SAVE", "HIDDEN"}
    )
    guessed_for: StringProperty(options={"SKIP_SAVE", "HIDDEN"})
    guess_text: StringProperty(options={"SKIP_SAVE", "HIDDEN"})
    sequence_text: StringProperty(options={"SKIP_SAVE", "HIDDEN"})
    format_name: StringProperty(options={"SKIP_SAVE", "HIDDEN"})

    def chosen_paths(self) -> list[str]:
        """Absolute paths of the files chosen in the dialog or dropped, else ``filepath``."""
        names = [entry.name for entry in self.files if entry.name]
        if self.directory and names:
            return [os.path.join(self.directory, name) for name in names]
        return [bpy.path.abspath(self.filepath)] if self.filepath else []

    def invoke(self, context, event):
        if not self.use_dialog:
            return self.begin(context)
        source_options.clear(self)  # Blender keeps the options of the last import, guesses included
        self.check(context)
        self.ask()
        return self.invoke_popup(context)

    def paths(self) -> list[str]:
        """Absolute paths to import: of files that are read together, such as those of a series, one path."""
        chosen = self.chosen_paths()
        if len(chosen) < 2:
            return chosen
        kind = _shared_format(chosen)
        if kind is DICOM:
            return list(dict.fromkeys(map(os.path.dirname, chosen)))
        if not self.use_sequence and not _are_pages(chosen, kind):
            return chosen
        first = {}
        for path in chosen:
            numbered = sequence_of(path)
            first.setdefault(str(numbered.first) if numbered else path, path)
        return list(first.values())

    def check(self, _context):
        """Guess layout and sequence when other files are picked; return whether the dialog changed."""
        paths = self.chosen_paths()
        path = paths[0] if len(paths) == 1 else ""
        if "\n".join(paths) == self.guessed_for:
            return False
        self.guessed_for, self.guess_text = "\n".join(paths), ""
        source_options.clear(self)
        kind = _shared_format(paths)
        self.sequence_text, self.use_sequence = _sequence_among(paths, kind)
        self.format_name = kind.name if kind else ""
        if paths and all(encoded.is_encoded(encoded.place_of(one)) for one in paths):
            self.format_name = ENCODED
        if kind is RAW and path:
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
        paths = self.chosen_paths()
        kind = self._kind(paths)
        if self.format_name == ENCODED:
            _draw_text(layout, f"{encoded.STORED_VALUES}.")
            self._draw_placing(layout)
            return
        if len(paths) > 1:
            together = {DICOM: "the series in their folder is read", RAW: "each layout is guessed",
                        TIFF: "numbered pages are one stack"}  # fmt: skip
            _draw_text(layout, f"{len(paths)} files; {together.get(kind, 'each is read as a volume')}")
        elif kind is None or "shape" in kind.options:
            self._draw_raw(layout)
        else:
            if "grid" in kind.options:
                layout.prop(self, "grid")
            for name, automatic in NUMBERS:
                if name in kind.options:
                    draw_number(layout, self, name, automatic)
            if "spacing" in kind.options:
                source_options.draw_spacing(layout, self)
        if self.sequence_text:
            layout.prop(self, "use_sequence")
            layout.label(text=self.sequence_text, icon="SEQUENCE")
        layout.separator()
        layout.prop(self, "modality")
        layout.prop(self, "value_unit")
        source_options.draw_calibration(layout, self)
        layout.separator()
        self._draw_placing(layout)

    def _kind(self, paths):
        """The format that ``check`` found, else that of the suffix: drawing opens no file."""
        found = next((entry for entry in FORMATS if entry.name == self.format_name), None)
        return found or (format_named(paths[0]) if paths else None)

    def _draw_raw(self, layout):
        for name in ("shape", "dtype", "byte_order", "header_bytes"):
            layout.prop(self, name)
        if any(self.spacing):
            layout.prop(self, "spacing")
        else:
            row = layout.row(heading="Spacing")
            row.alert = bool(self.paths())
            row.prop(self, "use_file_spacing", text="Enter Spacing", toggle=True)
        layout.prop(self, "length_unit_given")
        if all(self.shape) and self.dtype != "AUTO":
            size = bytes_text(source_options.bytes_of(self))
            layout.label(text=filled("In memory: {size}", size=size), icon="MEMORY")
        if self.guess_text:
            box = layout.box().column(align=True)
            box.scale_y = 0.8
            for sentence in self.guess_text.split("\n"):
                _draw_text(box, sentence)


class RLE_SPLAT_OT_import_dicom_series(ImportsVolumes, bpy.types.Operator):
    """Import a DICOM series from a folder and its subfolders. If there are several, a dialog asks which one"""

    bl_idname = "rle_splat.import_dicom_series"
    bl_label = "Import DICOM Series"
    bl_options = {"UNDO"}

    directory: StringProperty(
        name="Folder", description="Folder of the files", subtype="DIR_PATH", options={"SKIP_SAVE", "HIDDEN"}
    )
    filter_folder: BoolProperty(default=True, options={"HIDDEN"})

    nothing_chosen = "No folder was chosen; set directory."

    def paths(self) -> list[str]:
        return [os.path.normpath(bpy.path.abspath(self.directory))] if self.directory else []

    def invoke(self, context, _event):
        source_options.clear(self)
        self.ask()
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, _context):
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        source_options.draw_spacing(layout, self)
        layout.prop(self, "modality")
        self._draw_placing(layout)


class RLE_SPLAT_FH_volume(bpy.types.FileHandler):
    """Import volumes that are dropped into the 3D view or the outliner"""

    bl_label = "Volume (RLE Splat)"
    bl_import_operator = "rle_splat.import_volume"
    bl_file_extensions = ";".join(DROPPED_SUFFIXES)

    @classmethod
    def poll_drop(cls, context):
        return poll_file_object_drop(context)


def draw_menu_entry(menu, _context):
    text = "Volume (.nii/.nrrd/.dcm/.tif/.vdb/.raw)"  # of all suffixes the menu would be too wide
    menu.layout.operator(RLE_SPLAT_OT_import_volume.bl_idname, text=text)
    menu.layout.operator(RLE_SPLAT_OT_import_dicom_series.bl_idname, text="DICOM Series (.dcm)")


def draw_add_entry(menu, _context):
    """Draw the entry of Add > Volume, whose own entries add without asking."""
    layout = menu.layout.column()
    layout.operator_context = "INVOKE_DEFAULT"
    text = with_ellipsis(RLE_SPLAT_FH_volume.bl_label)
    layout.operator(RLE_SPLAT_OT_import_volume.bl_idname, text=text, icon="IMPORT")
