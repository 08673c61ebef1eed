"""How a volume's file is read: the same properties on a volume object, on the import dialog and on Relocate."""

import math
from dataclasses import dataclass, fields

import numpy as np

from ..rle_splat.volume.volume import STORED_TYPES
from .decimals import typed, typed_tuple
from .overridable import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    IntVectorProperty,
    StringProperty,
)

FILE_SAYS = ("AUTO", "As the File Says", "Taken from the file, or guessed from its size and name")
DTYPE_ITEMS = [FILE_SAYS] + [(name, name, "") for name in STORED_TYPES]
BYTE_ORDER_ITEMS = [
    FILE_SAYS, ("little", "Little Endian", "Least significant byte first, as on most machines"),
    ("big", "Big Endian", "Most significant byte first, as on older workstations and scanners"),
]
MODALITY_ITEMS = [
    FILE_SAYS, ("CT", "CT", "Computed tomography, values in HU where the file is calibrated"),
    ("MR", "MR", "Magnetic resonance, values without a unit"), ("XA", "X-Ray Angiography", "Rotational angiography"),
    ("SMOKE", "Smoke", "Simulated density"),
]

@dataclass
class PlainOptions:
    """The options as plain data, with the defaults that leave everything to the file."""

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
    modality: str = "AUTO"


NAMES = tuple(entry.name for entry in fields(PlainOptions))


class SourceOptions:
    """Mixed into property groups and operators; what is left at its default the file says itself."""

    shape: IntVectorProperty(
        name="Shape", description="Voxels along x, y and z; zero where the file says it", size=3, min=0)
    dtype: EnumProperty(name="Type", description="How a voxel is stored", items=DTYPE_ITEMS)
    byte_order: EnumProperty(name="Byte Order", description="Order of a voxel's bytes", items=BYTE_ORDER_ITEMS)
    header_bytes: IntProperty(
        name="Header Bytes", description="Bytes before the first voxel; -1 where the file says it", default=-1, min=-1)
    # No lower limit here: a negative spacing is refused in a sentence, not silently made zero.
    spacing: FloatVectorProperty(
        name="Spacing", description="Distance of voxel centers along x, y and z in the volume's unit; "
        "zero where the file says it", size=3, precision=4)
    use_calibration: BoolProperty(
        name="Calibrate", description="Use slope and intercept in place of what the file says", default=False)
    slope: FloatProperty(name="Slope", description="Physical value of one stored unit", default=1.0)
    intercept: FloatProperty(name="Intercept", description="Physical value of a stored zero", default=0.0)
    value_unit: StringProperty(
        name="Value Unit", description="Unit of the physical values, such as HU; empty if they have none")
    grid: StringProperty(
        name="Grid", description="Name of the grid inside a VDB file; name[1] for the second grid of that name; "
        "empty for density, or else the first grid of numbers")
    modality: EnumProperty(name="Modality", description="What made the data", items=MODALITY_ITEMS)


def read_options(source) -> dict:
    """The options of ``read_volume`` that are set on anything with these properties."""
    options = {}
    if any(source.shape):
        options["shape"] = tuple(source.shape)
    if any(source.spacing):
        options["spacing"] = typed_tuple(source.spacing)
    if source.header_bytes >= 0:
        options["header_bytes"] = source.header_bytes
    if source.use_calibration:
        options["slope"], options["intercept"] = typed(source.slope), typed(source.intercept)
    for name in ("dtype", "byte_order", "modality"):
        if getattr(source, name) != "AUTO":
            options[name] = getattr(source, name)
    for name in ("grid", "value_unit"):
        if getattr(source, name):
            options[name] = getattr(source, name)
    return options


def bytes_of(source) -> int:
    """The memory that the voxels of a stated shape and type take."""
    return math.prod(source.shape) * np.dtype(source.dtype).itemsize


def fill_from_guess(target, guess) -> None:
    """Set the layout of a raw file from a ``RawGuess``; what it does not know stays."""
    if guess.shape is not None:
        target.shape = guess.shape
    if guess.dtype is not None:
        target.dtype = guess.dtype
    target.byte_order = guess.byte_order
    target.header_bytes = guess.header_bytes
    if guess.spacing is not None:
        target.spacing = guess.spacing


def copy(source, target) -> None:
    """Everything from one bearer of these options to another; arrays become tuples."""
    for name in NAMES:
        value = getattr(source, name)
        setattr(target, name, tuple(value) if name in ("shape", "spacing") else value)


def clear(target) -> None:
    """Back to what the file says."""
    copy(PlainOptions(), target)
