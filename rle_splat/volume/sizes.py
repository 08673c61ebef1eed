"""Sizes of blocks of voxels; nothing here loads a compiler."""

# Voxels of a block along each axis: small enough to follow a surface, and a whole number of cache lines along x.
BLOCK_Z, BLOCK_Y, BLOCK_X = 8, 8, 32
BLOCK_VOXELS = BLOCK_Z * BLOCK_Y * BLOCK_X
