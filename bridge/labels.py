"""The labels of a volume object: the file they are in, and the rows that say what each looks like.

As a volume's voxels, labels stay outside the .blend and are read when first needed.
"""

from __future__ import annotations

import os

import bpy
import numpy as np

from ..rle_splat.classify.label_styles import LabelStyle, labels_of
from ..rle_splat.read.formats import format_of
from ..rle_splat.scene import Labels, RleSplatError
from . import volumes
from .decimals import typed
from .overridable import BoolProperty, EnumProperty, FloatVectorProperty, IntProperty, StringProperty
from .preset_items import IMPORT_ITEMS, SUGGESTED

OWN = "OWN"
LOOK_ITEMS = [(OWN, "As the Volume", "By the volume's own transfer function")] + [
    item for item in IMPORT_ITEMS if item[0] != SUGGESTED
]
MOST_LABELS = 512  # rows in a panel; more are values, not labels

_kept: dict = {}  # (path, size, time, shape) of the label file used last -> its Volume


def _evaluate_anew(row, _context):
    row.id_data.update_tag()


class LabelProperties(bpy.types.PropertyGroup):
    """What the voxels of one label look like.  Its ``name`` is the number as text, by which overrides find it."""

    label: IntProperty(name="Label", description="The number that the label's voxels have")
    label_name: StringProperty(name="Name", description="What the label stands for")
    show: BoolProperty(
        name="Show", description="Whether the label's voxels are shown", default=True, update=_evaluate_anew)
    use_color: BoolProperty(
        name="Own Color", description="Give the label a colour in place of the transfer function's", default=False,
        update=_evaluate_anew)
    color: FloatVectorProperty(
        name="Color", description="Colour of the label", subtype="COLOR", size=3, min=0.0, max=1.0,
        default=(0.8, 0.3, 0.2), update=_evaluate_anew)
    look: EnumProperty(
        name="Look", description="Opacity and colours of the label's voxels", items=LOOK_ITEMS, default=OWN,
        update=_evaluate_anew)

    def plain(self) -> LabelStyle:
        return LabelStyle(
            self.label, self.label_name, not self.show,
            tuple(typed(c) for c in self.color) if self.use_color else None, None if self.look == OWN else self.look,
        )


def load_labels(owner, shape_xyz):
    """The label volume of a volume object of that shape; bare voxels are on its grid."""
    path = volumes.resolved_path(owner, "label_file")
    try:
        status = os.stat(path)
    except OSError:
        raise RleSplatError(f"The labels of {owner.name!r} are not at {path}; choose their file, or none.") from None
    key = (path, status.st_size, status.st_mtime_ns, tuple(shape_xyz))
    if key not in _kept:
        kind = format_of(path)
        bare = kind is not None and "shape" in kind.options
        try:
            found = volumes.read_file(path, {"shape": shape_xyz} if bare else {})
        except RleSplatError as problem:
            if not bare:
                raise
            grid = " x ".join(map(str, shape_xyz))
            raise RleSplatError(
                f"{path} does not hold one whole number for each of the volume's {grid} voxels; choose the file of its "
                "labels."
            ) from problem
        _kept.clear()
        _kept[key] = found
    return _kept[key]


def read_labels(owner, depsgraph, volume, transfer_function) -> Labels | None:
    """The Labels of a volume object at the depsgraph's time; None where it has no file of labels, or no rows."""
    properties = owner.evaluated_get(depsgraph).rle_splat
    if not owner.rle_splat.label_file or len(properties.labels) == 0:
        return None
    styles = [row.plain() for row in properties.labels]
    return labels_of(load_labels(owner, volume.shape_xyz), styles, volume, transfer_function)


def list_labels(owner, volume) -> tuple[int, int]:
    """Make a row for each label in the file, keeping what is said of those already listed.

    Returns how many labels there are, and how many further rows stay: an override cannot drop its library's.
    """
    found = load_labels(owner, volume.shape_xyz)
    Labels(found)  # whole numbers, or a sentence
    if found.shape_xyz != volume.shape_xyz:
        raise RleSplatError("The file of labels has another number of voxels than the volume; choose one on its grid.")
    numbers = np.unique(found.voxels)
    if len(numbers) > MOST_LABELS:
        raise RleSplatError(
            f"The file has {len(numbers)} different values; labels are at most {MOST_LABELS}, so it may be a scan."
        )
    rows = owner.rle_splat.labels
    known = [row.label for row in rows]
    unused = [index for index, label in enumerate(known) if label not in numbers]
    further = sum(not remove_row(rows, index) for index in reversed(unused))
    for number in numbers:
        if int(number) not in known:
            row = rows.add()
            row.name, row.label = str(number), int(number)
            row.label_name = "Background" if number == 0 else f"Label {number}"
    return len(numbers), further


def remove_row(rows, index: int) -> bool:
    """Remove a row of a collection property; False where the row is the library's, whose rows overrides keep."""
    try:
        rows.remove(index)
    except TypeError:
        return False
    return True
