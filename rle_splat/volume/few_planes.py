"""A few planes of a large volume, for what only looks at it: its range, its histogram, a transfer function for it."""

from dataclasses import replace

import numpy as np

from .volume import Volume

LARGE = 1 << 30  # bytes from which a volume is large: smaller ones are counted in about two seconds
MOST_BYTES = 1 << 27  # of the planes, which are read at once from a disk, and held


def few_planes(volume: Volume) -> Volume:
    """A volume of evenly spread planes of a large one.

    Parameters
    ----------
    volume : Volume
        Possibly mapped from its file, so that only the planes that are taken are read.

    Returns
    -------
    Volume
        The volume itself if it is small. Else planes of at most MOST_BYTES (one at least) with a remark that says so,
        in the same place: its spacing along z is larger.
    """
    count = len(volume.voxels)
    if volume.voxels.nbytes <= LARGE:
        return volume
    step = -(-volume.voxels.nbytes // MOST_BYTES)
    chosen = np.ascontiguousarray(volume.voxels[min(step, count) // 2 :: step])
    matrix = np.diag((1.0, 1.0, float(step), 1.0))
    matrix[2, 3] = float(min(step, count) // 2)
    remark = f"The volume is large, so its values are those of {len(chosen)} of its {count} planes."
    return replace(volume, voxels=chosen, affine=volume.affine @ matrix, remarks=(*volume.remarks, remark))
