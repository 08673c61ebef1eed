"""Memory that classifying takes, told before it is taken; nothing here loads a compiler."""

from __future__ import annotations

import math

PROPERTY_BYTES = 20  # bytes of a voxel's extinction, opacity and color, where it has its own
ROW = 28  # bytes of a row of visible voxels: where it starts, its pieces, and what counting these takes
LARGEST_TABLE = 65536  # columns that two bytes tell apart
# Voxels kept for scalar sheets, corners of cells that are shown, for each visible one: 1.25 to 1.85 in scans.
TYPICAL_NEAR = 1.5
MIXED_AT_ONCE = 1 << 20  # voxels of labels and channels whose float64 properties still fit into the cache
MIXED_VOXEL = 180  # bytes of such a voxel meanwhile, measured: 95 with lookup tables, 178 without
TYPICAL_PIECE = 4  # visible voxels side by side in a row of a scan, where nothing but a histogram is known


def row_bytes(shape_xyz) -> int:
    """Bytes of the rows of visible voxels, however few these are."""
    return ROW * shape_xyz[1] * shape_xyz[2]


def voxel_bytes(shape_xyz, itemsize: int) -> int:
    """Bytes of a visible voxel: its column and its value."""
    return (2 if shape_xyz[0] <= LARGEST_TABLE else 4) + itemsize


def mark_bytes(shape_xyz) -> int:
    """Bytes of the marks of kept voxels, a bit each, and of bricks with any of them."""
    voxels = math.prod(shape_xyz)
    return voxels // 8 + voxels // 64


def mixed_work_bytes(shape_xyz) -> int:
    """Bytes taken while voxels of labels and channels are classified, some planes at a time."""
    return MIXED_VOXEL * min(max(MIXED_AT_ONCE, shape_xyz[0] * shape_xyz[1]), math.prod(shape_xyz))
