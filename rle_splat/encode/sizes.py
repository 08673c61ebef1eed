"""Memory that run-length tables take, told before it is taken; nothing here loads a compiler."""

from __future__ import annotations

from ..volume.axes import AXES

SCANLINE = 72  # bytes of a scanline: its pointers, and what making them takes meanwhile
VOXELS_AT_ONCE = 1 << 22  # visible voxels whose records are made between two chances to cancel, some 50 ms
FULL_RECORD = 16  # bytes of a record that is not packed


def run_bytes(shape_xyz) -> int:
    """Bytes of one run."""
    return 2 if max(shape_xyz) <= 65535 else 4


def scanlines(shape_xyz) -> int:
    """The most scanlines that a principal axis has."""
    return max(shape_xyz[across] * shape_xyz[principal] for _, across, principal in AXES.values())


def work_bytes(voxels: int, record: int) -> int:
    """Bytes taken while records are made, of at most VOXELS_AT_ONCE voxels."""
    return min(voxels, VOXELS_AT_ONCE) * (FULL_RECORD + (record if record != FULL_RECORD else 0))


def scalar_record(itemsize: int, light: int) -> int:
    """Bytes of a voxel of a table of scalars, ``light`` of them its light."""
    return min(itemsize, 4) + light
