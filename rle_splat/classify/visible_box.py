"""The box around the voxels that a transfer function shows."""

import numpy as np

from .reference import find_seen
from .visible import Visibility


def visible_box(volume, tf) -> tuple[np.ndarray, np.ndarray] | None:
    """The smallest box of voxel centers that holds every visible voxel.

    Parameters
    ----------
    volume : Volume
    tf : TransferFunction

    Returns
    -------
    first, last : (3,) ndarray of int64
        Voxel indices (x, y, z), both included. None in place of both if no voxel is visible.
    """
    shown = Visibility(volume, tf)
    rows = np.zeros(volume.voxels.shape[1], bool)
    columns = np.zeros(volume.voxels.shape[2], bool)
    planes = np.zeros(volume.voxels.shape[0], bool)
    for z, plane in enumerate(volume.voxels):
        seen = find_seen(shown, np.ascontiguousarray(plane).view(shown.pattern_type))
        rows |= seen.any(axis=1)
        across = seen.any(axis=0)
        columns |= across
        planes[z] = across.any()
    if not planes.any():
        return None
    found = [np.flatnonzero(along) for along in (columns, rows, planes)]
    return np.array([along[0] for along in found]), np.array([along[-1] for along in found])
