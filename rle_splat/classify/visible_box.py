"""The box around the voxels that a transfer function shows."""

from functools import reduce

import numpy as np

from .reference import find_seen
from .visible import Visibility


def visible_box(volume, tf, labels=None) -> tuple[np.ndarray, np.ndarray] | None:
    """The smallest box of voxel centers that holds every visible voxel.

    Parameters
    ----------
    volume : Volume
    tf : TransferFunction
    labels : Labels, optional
        Voxels of a label are seen by its own transfer function, or not at all.

    Returns
    -------
    first, last : (3,) ndarray of int64
        Voxel indices (x, y, z), both included. None in place of both if no voxel is visible.
    """
    groups, numbers_of = ({}, ()) if labels is None else (_numbers_by_opacity(labels.functions), labels.volume.voxels)
    shown = {opacity: Visibility(volume, function) for opacity, (function, _) in groups.items() if function is not None}
    usual = Visibility(volume, tf)
    rows = np.zeros(volume.voxels.shape[1], bool)
    columns = np.zeros(volume.voxels.shape[2], bool)
    planes = np.zeros(volume.voxels.shape[0], bool)
    for z, plane in enumerate(volume.voxels):
        values = np.ascontiguousarray(plane).view(usual.pattern_type)
        seen = find_seen(usual, values)
        for opacity, (_, numbers) in groups.items():
            own = find_seen(shown[opacity], values) if opacity in shown else False
            np.copyto(seen, own, where=reduce(np.logical_or, (numbers_of[z] == number for number in numbers)))
        rows |= seen.any(axis=1)
        across = seen.any(axis=0)
        columns |= across
        planes[z] = across.any()
    if not planes.any():
        return None
    found = [np.flatnonzero(along) for along in (columns, rows, planes)]
    return np.array([along[0] for along in found]), np.array([along[-1] for along in found])


def visible_reach(volume, tf, labels=None) -> tuple[np.ndarray, np.ndarray] | None:
    """The box of ``visible_box`` and its neighbors in the volume: the picture of a voxel reaches to their centers."""
    found = visible_box(volume, tf, labels)
    return found and (np.maximum(found[0] - 1.0, 0.0), np.minimum(found[1] + 1.0, np.array(volume.shape_xyz) - 1.0))


def _numbers_by_opacity(functions: dict) -> dict:
    """Opacity points, None for hidden -> (one of the transfer functions with them, numbers of its labels)."""
    groups = {}
    for number, function in functions.items():
        groups.setdefault(function and function.opacity, (function, []))[1].append(number)
    return groups
