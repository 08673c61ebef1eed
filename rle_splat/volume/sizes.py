"""Sizes of blocks of voxels and of pieces of work; nothing here loads a compiler."""

# Voxels of a block along each axis: small enough to follow a surface, and a whole number of cache lines along x.
BLOCK_Z, BLOCK_Y, BLOCK_X = 8, 8, 32
VOXELS_AT_ONCE = 1 << 25  # voxels between two progress reports, at which a user can cancel: some hundredths of a second
