"""The table of axis orders.

Points are (x, y, z); arrays are indexed [z, y, x]. Per principal axis (0 x, 1 y, 2 z), AXES lists the volume's axes
(along a voxel scanline, across the scanlines of a slice, across the slices). Scanlines run along x where possible,
because x is contiguous in memory.
"""

AXIS_NAMES = ("x", "y", "z")
AXES = {0: (1, 2, 0), 1: (0, 2, 1), 2: (0, 1, 2)}
