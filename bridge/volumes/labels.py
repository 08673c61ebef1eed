"""The labels of a volume object: the label file, and one row per label with its appearance.

Like a volume's voxels, the label file stays outside the .blend and is read when it is first needed.
"""

import os
from typing import NamedTuple

import bpy
import numpy as np

from ...rle_splat.classify.anatomy import find_appearance
from ...rle_splat.classify.label_styles import LabelStyle, distinct_color, style_labels
from ...rle_splat.read.formats import RAW, format_of
from ...rle_splat.read.labels import changes_with_time, read_label_steps, remarks_beside
from ...rle_splat.runtime.steps import announce, drain, rescale
from ...rle_splat.scene import Labels, RleSplatError
from ...rle_splat.segment.label_map import BACKGROUND, MOST_LABELS, value_steps
from ...rle_splat.volume.measure import measure_steps
from ...rle_splat.volume.volume import Volume
from ..data.decimals import typed, typed_tuple
from ..data.overridable import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    StringProperty,
    evaluate_anew,
)
from ..data.playback import shown_frame
from ..look.preset_items import IMPORT_ITEMS, SUGGESTED
from ..loop import store
from . import file_changes, volumes

OWN = "OWN"
SOLID = "SOLID"
FUNCTION_ITEMS = [
    (OWN, "Same as Volume", "Use the volume's own transfer function"),
    (SOLID, "Solid", "Give all voxels of the segment one opacity, whatever their values. One Color sets their color"),
] + [item for item in IMPORT_ITEMS if item[0] != SUGGESTED]
READING, COUNTING = 0.8, 0.9  # shares of the time until a label file is read, and until its values are counted
FIRST = 0.5  # share of the time until the first of several frames is read
PURPOSE = "labels"  # see ``store.Wish``


def _give_color(row, color) -> None:
    """Show a segment in a color, also where the volume's transfer function makes its values transparent."""
    row.color, row.use_color, row.show = color, True, True
    if row.look == OWN:
        row.look = SOLID


class LabelProperties(bpy.types.PropertyGroup):
    """The appearance of one label.  ``name`` is its number as text, because library overrides find rows by name."""

    label: IntProperty(name="Number", description="Value of the segment's voxels in the segmentation file")
    label_name: StringProperty(name="Name", description="Name of the segment")
    show: BoolProperty(name="Show", description="Show the voxels of this segment", default=True, update=evaluate_anew)
    use_color: BoolProperty(
        name="One Color", description="Show this segment in the color beside its name, with the opacities of its "
        "Transfer Function. If off, its values have the colors of its Transfer Function, and with Solid those of the "
        "volume",
        default=False, update=evaluate_anew)  # fmt: skip
    color: FloatVectorProperty(
        name="Color", description="Color of the segment", subtype="COLOR", size=3, min=0.0, max=1.0,
        default=(0.8, 0.3, 0.2), update=evaluate_anew)  # fmt: skip
    look: EnumProperty(
        name="Transfer Function", description="Transfer function for the voxels of this segment", items=FUNCTION_ITEMS,
        default=OWN, update=evaluate_anew)  # fmt: skip

    opacity: FloatProperty(
        name="Opacity", description="Multiply the opacity of this segment", default=1.0, min=0.0, max=1.0,
        subtype="FACTOR", update=evaluate_anew)  # fmt: skip
    shown_color: FloatVectorProperty(
        name="Segment Color", description="Color of the segment. Choosing one turns on One Color. A segment that is "
        "Same as Volume becomes Solid, so that it shows also where the volume is transparent",
        subtype="COLOR", size=3, min=0.0, max=1.0, get=lambda row: tuple(row.color), set=_give_color)  # fmt: skip

    def plain(self) -> LabelStyle:
        return LabelStyle(
            self.label, self.label_name, not self.show,
            typed_tuple(self.color) if self.use_color else None,
            None if self.look in (OWN, SOLID) else self.look,
            opacity=typed(self.opacity), solid=self.look == SOLID,
        )  # fmt: skip


class LabelMap(NamedTuple):
    """Content of a label file: its Volume, and its different values, ascending; see ``value_steps``."""

    volume: Volume
    values: np.ndarray


class LabelFile(NamedTuple):
    """The label file of a volume object, whose name is in errors; ``frame``: of one that changes with time."""

    path: str
    owner: str
    frame: int = 1

    def key(self, volume) -> tuple:
        """Key of the file's labels on the grid of a volume; RleSplatError if the file is missing."""
        try:
            state = file_changes.state_of(self.path)
        except OSError:
            raise RleSplatError(
                f"The segmentation file of {self.owner!r} is not at {self.path}; choose the file, or clear the field."
            ) from None
        return PURPOSE, self.path, self.frame, state, volume.shape_xyz, volume.affine.tobytes(), volume.space


def file_of(owner, depsgraph=None, ahead: int = 0) -> LabelFile:
    """The label file of a volume object, with the frame that it shows; the parameters are those of ``shown_frame``."""
    frames = owner.rle_splat.label_frames
    frame = 1 if frames == 1 else min(shown_frame(owner, depsgraph, ahead), frames)
    return LabelFile(volumes.resolved_path(owner, "label_file"), owner.name, frame)


def are_used(owner) -> bool:
    """Whether a picture of a volume object shows labels."""
    return bool(owner.rle_splat.label_file) and len(owner.rle_splat.labels) > 0


def hides_rest(owner) -> bool:
    """Whether a volume object hides what is in no segment, such as the table beside a body."""
    return are_used(owner) and any(row.label == BACKGROUND and not row.show for row in owner.rle_splat.labels)


def map_at_hand(owner, volume):
    """The label map of a volume object if it is in memory, else None."""
    try:
        found = store.find(file_of(owner).key(volume))
    except RleSplatError:
        return None
    return None if found is None else found.volume


def are_at_hand(owner, volume, depsgraph=None, ahead: int = 0) -> bool:
    """Whether the labels of a volume object are in memory, or their file is missing, which ``load_steps`` says."""
    try:
        return store.find(file_of(owner, depsgraph, ahead).key(volume)) is not None
    except RleSplatError:
        return True


def load_steps(wish: store.Wish, file: LabelFile, volume):
    """Generator of Progress: the LabelMap of a file on the grid of a volume, from memory or from the file.

    Parameters
    ----------
    volume : Volume
        A raw label file is read with its shape.

    Raises
    ------
    RleSplatError
        If the file is missing, cannot be read, or a raw file has another size.
    """
    return store.steps(wish, file.key(volume), lambda: _read_steps(file, volume))


def _read_steps(file: LabelFile, volume):
    """Generator of Progress: read a LabelMap."""
    try:
        volumes.expose_modules()
        found = yield from rescale(read_label_steps(file.path, volume, file.frame), 0.0, READING)
    except RleSplatError as problem:
        if format_of(file.path) is not RAW:
            raise
        grid = " x ".join(map(str, volume.shape_xyz))
        raise RleSplatError(
            f"{file.path} does not hold one whole number for each of the volume's {grid} voxels; choose another file."
        ) from problem
    yield from rescale(measure_steps(found), READING, COUNTING)
    values = yield from announce(value_steps(found), COUNTING, 1.0, "reading labels")
    return LabelMap(found, values)


def read_labels(owner, depsgraph, volume, transfer_function, ahead: int = 0) -> Labels | None:
    """The labels of a volume object as plain data; None without a label file or rows.

    ``ahead``: frames of the timeline after the depsgraph's time.
    """
    if not are_used(owner):
        return None
    found = drain(load_steps(store.wish_of(owner, depsgraph, PURPOSE), file_of(owner, depsgraph, ahead), volume))
    return shown_as(owner, depsgraph, found.volume, volume, transfer_function)


def shown_as(owner, depsgraph, label_map, volume, transfer_function) -> Labels:
    """The labels of a map as plain data, as a volume object's rows show them in a volume."""
    properties = owner.evaluated_get(depsgraph).rle_splat
    styles = [row.plain() for row in properties.labels]
    return style_labels(label_map, volume, transfer_function, styles, properties.smooth_labels)


def listed_steps(file: LabelFile, volume, wish: store.Wish | None = None):
    """Generator of Progress: the LabelMap of a label file, with the values of all its frames.

    Parameters
    ----------
    volume : Volume
    wish : store.Wish or None
        None for an object that is not there yet: the map is then not stored.

    Raises
    ------
    RleSplatError
        If the file is no label map on the volume's grid.
    """
    first = _read_steps(file, volume) if wish is None else load_steps(wish, file, volume)
    found, numbers = yield from rescale(first, 0.0, FIRST)
    check_grid(found, volume)
    frames = found.frames if changes_with_time(found) else 1
    for frame in range(1, frames + 1):  # a segment may be in some frames only
        if frame != file.frame:
            steps, share = _read_steps(file._replace(frame=frame), volume), (1.0 - FIRST) / frames
            others = yield from rescale(steps, FIRST + share * (frame - 1), FIRST + share * frame)
            numbers = np.union1d(numbers, others.values)
    if len(numbers) > MOST_LABELS:
        raise RleSplatError(
            f"The file has {len(numbers)} different values, but at most {MOST_LABELS} labels are possible; choose a "
            "label map, not a scan."
        )
    return LabelMap(found, numbers)


def list_labels(owner, listed: LabelMap) -> tuple[int, int, tuple]:
    """Update the list of labels from the label file; rows that were listed from a file of this name stay as they are.

    Parameters
    ----------
    listed : LabelMap
        Of ``listed_steps``.

    Returns
    -------
    count : int
        Number of labels in the file.
    further : int
        Number of rows that are not in the file but belong to the library of an override, which cannot remove them.
    remarks : tuple of str
        Sentences on how the label file was brought onto the volume's grid.
    """
    (found, numbers), file = listed, file_of(owner)
    owner.rle_splat.label_frames = found.frames if changes_with_time(found) else 1
    rows, file_name = owner.rle_splat.labels, os.path.basename(file.path)
    is_other = owner.rle_splat.labels_of not in ("", file_name)  # "": listed by an earlier version
    unused = [index for index, row in enumerate(rows) if is_other or row.label not in numbers]
    stay = [rows[index].label for index in reversed(unused) if not remove_row(rows, index)]
    owner.rle_splat.labels_of = file_name
    known = {row.label: index for index, row in enumerate(rows)}
    named = {one.label: one for one in found.named_labels}
    for number in map(int, numbers):
        if number not in known:
            _describe(rows.add(), number, named.get(number))
        elif number in stay:  # of another file
            _describe(rows[known[number]], number, named.get(number))
    further = sum(number not in numbers for number in stay)
    return len(numbers), further, remarks_beside(found, owner.rle_splat.frame_count)


def _describe(row, number: int, named) -> None:
    """Give a row the appearance that a label file says, or else the first one."""
    row.name, row.label = str(number), number
    row.label_name = named.name if named else f"Segment {number}" if number else "Background"
    row.show, row.look, row.opacity = True, OWN, 1.0
    row.use_color = named is not None and named.color is not None
    row.color = named.color if row.use_color else distinct_color(number)


def show_anatomy(rows, hides_background: bool = True) -> tuple[int, int]:
    """Show the rows of segments in colors by their names, or else in those that they have, or in distinct ones.

    Parameters
    ----------
    rows : collection of LabelProperties
    hides_background : bool
        Whether what is in no segment is hidden.

    Returns
    -------
    found, count : int
        Segments whose names are known, and all of them.
    """
    found = count = 0
    for row in rows:
        if row.label == BACKGROUND:
            row.show = not hides_background
            continue
        known = find_appearance(row.label_name)
        row.shown_color = known.color if known else row.color if row.use_color else distinct_color(row.label)
        row.look, row.opacity = SOLID, known.opacity if known else 1.0
        found, count = found + bool(known), count + 1
    return found, count


def check_grid(found: Volume, volume: Volume) -> None:
    """RleSplatError if a label map has values that are not whole, or another number of voxels than a volume."""
    Labels(found)  # checks for whole numbers
    if found.shape_xyz != volume.shape_xyz:
        mine, its = (" x ".join(map(str, one.shape_xyz)) for one in (volume, found))
        raise RleSplatError(
            f"The segmentation file has {its} voxels and the volume has {mine}; choose one on the same grid."
        )


def remove_row(rows, index: int) -> bool:
    """Remove a row of a collection property; False if it belongs to the library of an override and must stay."""
    try:
        rows.remove(index)
    except TypeError:
        return False
    return True
