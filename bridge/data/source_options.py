"""The options for reading a volume's file, shared by volume objects, the import dialog and Relocate."""

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from ...rle_splat.volume.volume import STORED_TYPES
from .automatic import switch
from .decimals import typed, typed_tuple
from .overridable import (
    BoolProperty,
    BoolVectorProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    IntVectorProperty,
    StringProperty,
)

FILE_SAYS = ("AUTO", "From File", "Use what the file states, or a guess from its size and name")
NUMBERS = {"u": "Whole numbers without a sign", "i": "Whole numbers with a sign", "f": "Decimal numbers"}
DTYPE_ITEMS = [FILE_SAYS] + [
    (one, one, f"{NUMBERS[np.dtype(one).kind]}, {8 * np.dtype(one).itemsize} bits each") for one in STORED_TYPES
]
BYTE_ORDER_ITEMS = [
    FILE_SAYS,
    ("little", "Little Endian", "Least significant byte first, as on most computers"),
    ("big", "Big Endian", "Most significant byte first, as on some older workstations and scanners"),
]
MODALITY_ITEMS = [
    FILE_SAYS, ("CT", "CT", "Computed tomography, values in HU if the file is calibrated"),
    ("MR", "MR", "Magnetic resonance, values without a unit"), ("XA", "X-Ray Angiography", "Rotational angiography"),
    ("SMOKE", "Smoke", "Simulated density"), ("PT", "PET", "Positron emission, values in SUV if the file allows"),
    ("RTDOSE", "Dose", "Dose of a radiation plan, values in gray (Gy)"),
]  # fmt: skip

UNIT_ITEMS = [
    FILE_SAYS,
    ("um", "Micrometers", "One unit of the file is 0.001 millimeters"),
    ("mm", "Millimeters", "One unit of the file is a millimeter"),
    ("cm", "Centimeters", "One unit of the file is 10 millimeters"),
    ("m", "Meters", "One unit of the file is 1000 millimeters"),
]


@dataclass
class PlainOptions:
    """The options as plain data; the defaults leave everything to the file."""

    shape: tuple = (0, 0, 0)
    dtype: str = "AUTO"
    byte_order: str = "AUTO"
    header_bytes: int = -1
    spacing: tuple = (0.0, 0.0, 0.0)
    use_calibration: bool = False
    slope: float = 1.0
    intercept: float = 0.0
    value_unit: str = ""
    grid: str = ""
    series: int = 0
    series_key: str = ""
    frame: int = 0
    use_sequence: bool = False
    modality: str = "AUTO"
    length_unit_given: str = "AUTO"
    orientation: str = ""
    flip: tuple = (False, False, False)
    level: int = -1


ARRAYS = ("shape", "spacing", "flip")
NAMES = tuple(entry.name for entry in fields(PlainOptions))


def _choose_spacing(source, of_file: bool) -> None:
    """Take the file's spacing, or begin to edit: with that in use, where it is known."""
    if of_file:
        source.spacing = 0.0, 0.0, 0.0
    elif not any(source.spacing):
        source.spacing = source.found_spacing if all(source.found_spacing) else (1.0, 1.0, 1.0)


class SourceOptions:
    """Mix-in for property groups and operators; an option at its default is taken from the file."""

    shape: IntVectorProperty(
        name="Shape", description="Number of voxels along x, y and z; 0 uses the file's", size=3, min=0
    )
    dtype: EnumProperty(name="Type", description="Number type of a stored voxel", items=DTYPE_ITEMS)
    byte_order: EnumProperty(name="Byte Order", description="Order of the bytes in a voxel", items=BYTE_ORDER_ITEMS)
    header_bytes: IntProperty(
        name="Header Bytes", description="Number of bytes before the first voxel; -1 uses the file's", default=-1,
        min=-1)  # fmt: skip
    found_spacing: FloatVectorProperty(
        name="Spacing in Use", description="Distance between voxel centers as it was read", size=3, options={"HIDDEN"}
    )
    use_file_spacing: BoolProperty(
        name="From File", description="Use the spacing that the file states, or 1 where it states none",
        get=lambda source: not any(source.spacing), set=_choose_spacing)  # fmt: skip
    length_unit_given: EnumProperty(name="Unit", description="Unit of lengths in the file", items=UNIT_ITEMS)
    orientation: StringProperty(
        name="Orientation",
        description="Three letters: where voxel x, y and z grow in the patient, such as LPS for "
        "left, posterior (back) and superior (head). Empty uses the file's",
    )
    flip: BoolVectorProperty(
        name="Flip", description="Mirror the volume along its voxel axes x, y and z. One or three of them exchange a "
        "patient's left and right: compare with the original", size=3)  # fmt: skip
    # Without a lower limit, so that a negative spacing gets an error message instead of silently becoming zero.
    spacing: FloatVectorProperty(
        name="Spacing", description="Distance between voxel centers along x, y and z in the volume's unit; 0 uses the "
        "file's", size=3, precision=4)  # fmt: skip
    use_calibration: BoolProperty(
        name="Rescale Values", description="Compute values with this slope and intercept instead of the file's",
        default=False)  # fmt: skip
    slope: FloatProperty(name="Slope", description="Value = slope * stored number + intercept", default=1.0)
    intercept: FloatProperty(name="Intercept", description="Value of a stored 0, such as -1024 HU", default=0.0)
    value_unit: StringProperty(name="Value Unit", description="Unit of the values, such as HU; empty if they have none")
    grid: StringProperty(
        name="Grid", description="Name of the grid in a VDB file; name[1] is the second grid of that name. Empty uses "
        "the grid density, or else the first grid of numbers")  # fmt: skip
    series: IntProperty(
        name="Series", description="Number of the series, from 1, if the folder holds several; 0 reads the only one",
        default=0, min=0)  # fmt: skip
    use_only_series: BoolProperty(
        name="Single Series", description="Read the only series of the folder, or ask which one if there are several",
        **switch("series", 0, 1))  # fmt: skip
    series_key: StringProperty(
        name="Series Hash", description="Hash of the identifier of the DICOM series, by which it is found again",
        options={"HIDDEN"})  # fmt: skip
    frame: IntProperty(
        name="Time Point", description="Time point to read, from 1; 0 is the same as 1", default=0, min=0
    )
    level: IntProperty(
        name="Resolution Level", description="Level of an OME-Zarr pyramid: 0 is the finest, -1 the finest that fits "
        "into memory", default=-1, min=-1)  # fmt: skip
    use_fitting_level: BoolProperty(
        name="Finest That Fits in Memory", description="Read the finest level whose voxels fit into memory",
        **switch("level", -1, 0))  # fmt: skip
    use_first_frame: BoolProperty(
        name="First Time Point", description="Read the first time point, and show others with the timeline",
        **switch("frame", 0, 1))  # fmt: skip
    use_sequence: BoolProperty(
        name="Sequence", description="Read files whose names differ in their last number alone, such as "
        "smoke_0001.vdb, as a time series", default=False)  # fmt: skip
    modality: EnumProperty(name="Modality", description="Kind of scanner or simulation", items=MODALITY_ITEMS)


def read_options(source) -> dict:
    """The options that differ from their defaults, as keyword arguments of ``read_volume``."""
    options = {}
    if any(source.shape):
        options["shape"] = tuple(source.shape)
    if any(source.spacing):
        options["spacing"] = typed_tuple(source.spacing)
    for name in ("header_bytes", "level"):
        if getattr(source, name) >= 0:
            options[name] = getattr(source, name)
    if source.use_calibration:
        options["slope"], options["intercept"] = typed(source.slope), typed(source.intercept)
    for name in ("dtype", "byte_order", "modality"):
        if getattr(source, name) != "AUTO":
            options[name] = getattr(source, name)
    if source.length_unit_given != "AUTO":
        options["unit"] = source.length_unit_given
    if any(source.flip):
        options["flip"] = "".join(axis for axis, on in zip("xyz", source.flip) if on)
    for name in ("grid", "value_unit", "series", "series_key", "frame", "orientation"):
        if getattr(source, name):
            options[name] = getattr(source, name)
    return options


def bytes_of(source) -> int:
    """Bytes of the voxels for the given shape and type."""
    return math.prod(source.shape) * np.dtype(source.dtype).itemsize


def fill_from_guess(target, guess) -> None:
    """Set the layout of a raw file from a RawGuess, whose fields that are None leave an option unchanged."""
    if guess.shape is not None:
        target.shape = guess.shape
    if guess.dtype is not None:
        target.dtype = guess.dtype
    target.byte_order = guess.byte_order
    target.header_bytes = guess.header_bytes
    if guess.spacing is not None:
        target.spacing = guess.spacing


def copy(source, target) -> None:
    """Copy all options from ``source`` to ``target``; arrays become tuples."""
    for name in NAMES:
        value = getattr(source, name)
        setattr(target, name, tuple(value) if name in ARRAYS else value)


def keep_level(target, volume) -> None:
    """Choose the level of a pyramid that was read, so that the same one is read again whatever memory is free then."""
    if volume.holds_values and volume.shape_xyz in volume.levels:
        target.level = volume.levels.index(volume.shape_xyz)


def at_frame(source, frame: int):
    """PlainOptions that differ in the frame alone."""
    return replace(source, frame=frame)


def draw_spacing(layout, source) -> None:
    """Draw the spacing: a word where it is the file's, else three numbers."""
    column = layout.column(heading="Spacing")
    column.prop(source, "use_file_spacing")
    if not source.use_file_spacing:
        column.prop(source, "spacing", text=" ")


def draw_place(layout, source) -> None:
    """Draw what says where the voxels are: spacing, unit, orientation and flips."""
    draw_spacing(layout, source)
    layout.prop(source, "length_unit_given")
    layout.prop(source, "orientation")
    row = layout.row(heading="Flip", align=True)
    for i, axis in enumerate("XYZ"):
        row.prop(source, "flip", index=i, text=axis, toggle=True)


def draw_calibration(layout, source) -> None:
    """Draw what makes values of stored numbers."""
    layout.prop(source, "use_calibration")
    if source.use_calibration:
        column = layout.column(align=True)
        column.prop(source, "slope")
        column.prop(source, "intercept")


def clear(target) -> None:
    """Reset all options to their defaults."""
    copy(PlainOptions(), target)
