"""Voxels in a type that compiled kernels travel for, where one of them holds all values exactly.

Scans are often stored in more bits than their values need.  In fewer, they take less memory as well.
"""

from dataclasses import replace

import numpy as np

from ..runtime.memory import available_bytes
from ..runtime.steps import Progress
from ..volume.mapped_files import is_mapped
from ..volume.volume import Volume

KERNEL_TYPES = ("uint8", "int16", "uint16", "float32")  # those of ``pipeline.prepare``; integers from the narrowest on
WHOLE_FLOATS = 2**24  # float32 holds all whole numbers up to it
DOING = "converting voxels"


def narrow_steps(volume: Volume):
    """Generator of Progress: the volume in the first of KERNEL_TYPES that holds all of its stored values exactly.

    Integers come as the narrowest that holds them, float64 as float32.  A volume stays as it is if no type does, if it
    lies in a mapped file, which would have to be read into memory, or if memory does not suffice for both.
    """
    voxels = volume.voxels
    if voxels.dtype.name in KERNEL_TYPES or is_mapped(voxels):
        return volume
    kind = "float32" if voxels.dtype.kind == "f" else (yield from _integer_type_steps(voxels))
    if kind is None or voxels.size * np.dtype(kind).itemsize > available_bytes():
        return volume
    narrow = np.empty(voxels.shape, kind)
    for z, plane in enumerate(voxels):
        with np.errstate(over="ignore"):  # seen by the comparison
            narrow[z] = plane
        if voxels.dtype.kind == "f" and not np.array_equal(narrow[z], plane, equal_nan=True):
            return volume
        yield Progress((z + 1) / len(voxels), DOING)
    return replace(volume, voxels=narrow)


def _integer_type_steps(voxels: np.ndarray):
    """Generator of Progress: the first of KERNEL_TYPES that holds all of these integers, or None."""
    low = high = int(voxels[0, 0, 0])
    for z, plane in enumerate(voxels):
        low, high = min(low, int(plane.min())), max(high, int(plane.max()))
        yield Progress(z / len(voxels), DOING)
    for kind in KERNEL_TYPES[:-1]:
        if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max:
            return kind
    return "float32" if max(-low, high) <= WHOLE_FLOATS else None
