"""The one table of axis orders.

People say x, y, z; arrays are indexed [z, y, x].  Per principal axis (0 x, 1 y, 2 z) the volume's axes take
three parts: along the voxel scanline, counting the scanlines of a slice, counting the slices.  Scanlines run
along x wherever they can, because x is contiguous in memory.
"""

AXIS_NAMES = ("x", "y", "z")
AXES = {0: (1, 2, 0), 1: (0, 2, 1), 2: (0, 1, 2)}
