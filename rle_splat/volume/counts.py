"""How often each stored value of an 8- or 16-bit volume occurs: range, histogram and percentiles follow from it.

Without kernels: what only looks at a file does not wait for a compiler to load.
"""

from __future__ import annotations

import numpy as np


def counts_values(dtype) -> bool:
    """Whether volumes of this type have so few values that each is counted."""
    return np.dtype(dtype).kind in "iu" and np.dtype(dtype).itemsize <= 2


def stored_values(dtype) -> np.ndarray:
    """(256 or 65536,) every stored value of a type, ascending."""
    limits = np.iinfo(dtype)
    return np.arange(limits.min, limits.max + 1).astype(dtype)


def count_values(voxels: np.ndarray) -> np.ndarray:
    """(256 or 65536,) int64: how many voxels hold each of ``stored_values``; plane by plane, in one pass."""
    unsigned = np.dtype(f"u{voxels.dtype.itemsize}")
    counts = np.zeros(1 << 16, np.int64)
    n = 1 << (8 * unsigned.itemsize)
    pairs = unsigned.itemsize == 1 and voxels[0].size % 2 == 0  # two 8-bit voxels counted at a time, then apart
    for plane in voxels:
        patterns = np.ascontiguousarray(plane).reshape(-1).view(np.uint16 if pairs else unsigned)
        counts += np.bincount(patterns, minlength=len(counts))
    if pairs:
        table = counts.reshape(n, n)
        counts = table.sum(axis=0) + table.sum(axis=1)
    return np.roll(counts[:n], -np.iinfo(voxels.dtype).min)  # bit patterns of negative numbers come last
