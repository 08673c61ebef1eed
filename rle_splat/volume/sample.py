"""Values between the voxels of a volume, at a few points."""

import numpy as np

from .interpolate import interpolate
from .volume import Volume


def values_at(volume: Volume, indices) -> np.ndarray:
    """Interpolate a volume trilinearly.

    Parameters
    ----------
    indices : (n, 3) array_like of float
        Voxel indices (x, y, z); beyond the outermost voxel centers these count.

    Returns
    -------
    (n,) ndarray of float64
        Physical values. A neighbor with a share of zero takes no part, not even one that is NaN.
    """
    last = np.array(volume.shape_xyz) - 1
    places = np.clip(np.asarray(indices, np.float64).reshape(-1, 3), 0.0, last)
    found, _ = interpolate(volume.voxels, places.T)
    return volume.physical(found)


def labels_at(volume: Volume, indices) -> np.ndarray:
    """The labels (n,) int64 of the voxels nearest to voxel indices (n, 3)."""
    last = np.array(volume.shape_xyz) - 1
    x, y, z = np.clip(np.rint(np.asarray(indices, np.float64).reshape(-1, 3)), 0, last).astype(np.int64).T
    return volume.voxels[z, y, x].astype(np.int64)
