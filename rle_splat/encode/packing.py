"""Coding of records of 8 bytes."""

from __future__ import annotations

import numpy as np

from ..runtime.jit import compiled, kernel, parallel_call
from ..runtime.parallel import share_out
from . import reference
from .records import code_of


def pack(records, decoding, voxel_data, *, threads: int = 0) -> None:
    """Code records of 8 bytes.

    Parameters
    ----------
    records : (n, 4) ndarray of float32
        (density * RGB, density).
    decoding : ndarray of float32
        As of ``decoding_of``.
    voxel_data : ndarray
        Output; see ``empty_records``.
    threads : int
        0 for one per core.
    """
    arguments = (records, 1.0 / decoding.astype(np.float64), voxel_data)
    if not compiled():
        reference.pack(*arguments)
        return
    with parallel_call(threads):
        _pack(*arguments)


@kernel
def _pack(records, inverse, voxel_data):
    """Kernel of ``pack``; ``inverse`` (4,) float64: one over the scale of each channel."""
    share_out(_pack_some, voxel_data.size, (records, inverse, voxel_data))


@kernel(exact=True, inner=True)
def _pack_some(begin, end, records, inverse, voxel_data):
    """``_pack`` for records [begin, end)."""
    made, codes = records[begin:end], voxel_data[begin:end]  # slices start at zero, so the loop becomes SIMD
    red, green, blue, density = inverse[0], inverse[1], inverse[2], inverse[3]
    for i in range(codes.size):
        low = code_of(made[i, 0] * red) | (code_of(made[i, 1] * green) << np.uint32(16))
        high = code_of(made[i, 2] * blue) | (code_of(made[i, 3] * density) << np.uint32(16))
        codes[i] = np.uint64(low) | (np.uint64(high) << np.uint64(32))
