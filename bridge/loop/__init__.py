"""What is done later or because something changed: voxels in memory, and the queue by which they are read."""
