"""How often each stored value of an 8- or 16-bit volume occurs. Range, histogram and percentiles follow from it.

This module has no kernels, so that commands that only look at a file do not load the compiler.
"""

import numpy as np


def counts_values(dtype) -> bool:
    """Whether a voxel type has so few values (8 or 16 bits) that each is counted."""
    return np.dtype(dtype).kind in "iu" and np.dtype(dtype).itemsize <= 2


def list_stored_values(dtype) -> np.ndarray:
    """All stored values of an integer type, ascending; (256,) or (65536,)."""
    limits = np.iinfo(dtype)
    return np.arange(limits.min, limits.max + 1).astype(dtype)


def count_steps(voxels: np.ndarray):
    """Generator of fractions done: count the voxels of each stored value, plane by plane.

    Parameters
    ----------
    voxels : (nz, ny, nx) ndarray of an 8- or 16-bit integer dtype

    Returns
    -------
    (256,) or (65536,) ndarray of int64
        In the order of ``list_stored_values``.
    """
    unsigned = np.dtype(f"u{voxels.dtype.itemsize}")
    counts = np.zeros(1 << 16, np.int64)
    n = 1 << (8 * unsigned.itemsize)
    pairs = unsigned.itemsize == 1 and voxels[0].size % 2 == 0  # count two 8-bit voxels at once, separate them below
    for z, plane in enumerate(voxels):
        patterns = np.ascontiguousarray(plane).reshape(-1).view(np.uint16 if pairs else unsigned)
        counts += np.bincount(patterns, minlength=len(counts))
        yield (z + 1) / len(voxels)
    if pairs:
        table = counts.reshape(n, n)
        counts = table.sum(axis=0) + table.sum(axis=1)
    return np.roll(counts[:n], -np.iinfo(voxels.dtype).min)  # bit patterns of negative numbers come last
