"""How much of its work a stage handles at a time; ``pipeline.memory_estimate`` counts the memory for it.

They are apart from the stages because what only looks at a file loads no compiler.
"""

MIXED_AT_ONCE = 1 << 20  # voxels of labels and channels whose float64 properties still fit into the cache
RECORDS_AT_ONCE = 1 << 19  # visible voxels whose records are made between two chances to cancel, 5 to 20 ms
SMOOTHED_AT_ONCE = 1 << 20  # voxels that are smoothed between two chances to cancel, 20 ms on one core
PLACED_AT_ONCE = 1 << 18  # voxels whose surfaces are placed between two chances to cancel, 15 ms on one core
RAYS_AT_ONCE = 512  # single rays between two chances to cancel, 15 ms
MESH_SAMPLES = 16  # rays per pixel on which meshes are searched for
BRICK_SIDE = 8  # cells of a brick of extinction: it has 1.4 times as many corners, with 4 cells it would have 2
