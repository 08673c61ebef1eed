"""A volume of voxels twice as large, for pictures of volumes that are too large."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np

from ..runtime.memory import refuse_beyond
from .volume import Volume

TO_FINE = np.diag((2.0, 2.0, 2.0, 1.0))  # voxel index of the coarser volume to that of the volume
TO_FINE[:3, 3] = 0.5
LEAST_SIDE = 2  # voxels along a side of a volume that can be made coarser


def coarser_steps(volume: Volume):
    """Generator: yields fractions done; returns the volume with the means of 2 x 2 x 2 voxels.

    Parameters
    ----------
    volume : Volume
        A side of an odd number of voxels counts its last one twice; LEAST_SIDE voxels along each side at least.

    Returns
    -------
    Volume
        Stored values have the same type; means of whole numbers are rounded.

    Raises
    ------
    RleSplatError
        If the coarser volume itself needs more memory than is free.
    """
    fine = volume.voxels
    shape = tuple((n + 1) // 2 for n in fine.shape)
    needed = int(np.prod(shape)) * fine.dtype.itemsize
    refuse_beyond(needed, "The volume in voxels twice as large needs", "free some memory")
    voxels = np.empty(shape, fine.dtype)
    work_type = np.float32 if fine.dtype.itemsize <= 2 else np.float64
    for z in range(shape[0]):
        pair = np.asarray(fine[2 * z : 2 * z + 2])
        mean = pair.mean(axis=0, dtype=work_type)
        for axis in (0, 1):
            mean = _pair_means(mean, axis)
        voxels[z] = np.rint(mean) if fine.dtype.kind in "iu" else mean
        yield (z + 1) / shape[0]
    found = replace(volume, voxels=voxels, affine=volume.affine @ TO_FINE)
    # Its own voxels need not be read for a hash of them.
    vars(found)["voxel_key"] = hashlib.blake2b(f"{volume.voxel_key} coarser".encode(), digest_size=16).hexdigest()
    return found


def _pair_means(values: np.ndarray, axis: int) -> np.ndarray:
    """Means of neighboring pairs along an axis of a plane; the last of an odd number is its own mean."""
    values = np.moveaxis(values, axis, 0)
    near, far = values[0::2], values[1::2]
    if len(far) < len(near):
        far = np.concatenate((far, near[-1:]))
    return np.moveaxis(0.5 * (near + far), 0, axis)
