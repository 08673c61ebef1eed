"""Voxel records of 16 and 8 bytes (algorithm.md 1.11).

    bytes  color                                         density: extinction or opacity
    16     3 float32, times the density                  float32
    8      3 16-bit floats, times the density            16-bit float

The 16-bit floats are not IEEE half floats: no sign, 5 bits of exponent, 11 of mantissa, relative to the largest value.
The rounding error is at most 2^-12 of a value, and only values below 2^-30 of the largest become zero. A shift and a
product convert them to float32.
"""

from __future__ import annotations

import numpy as np

from ..runtime.buffer_pool import empty
from ..runtime.jit import kernel

TYPES = {16: np.float32, 8: np.uint64}  # bytes of a record -> dtype of the array
WORDS = {16: (4,), 8: ()}  # entries of a record; () for a single number
SCALES = 4  # of coded records: red, green, blue and density
LEAST_SCALE = 1e-37  # scales are kept above it, because their inverse must be finite

SHIFT = np.uint32(12)  # float32 has 12 more bits of mantissa than a code
BIAS = np.uint32(96 << 23)  # maps exponent 127, that of 1, to 31, the largest of 5 bits
LEAST_BITS = np.uint32(97 << 23)  # 2^-30, the smallest number with a code
UNBIAS = np.float32(2.0**96)
HALF = np.uint32(1 << 11)


def record_bytes(voxel_data) -> int:
    """Bytes of a voxel record, from the dtype of its array."""
    return {np.dtype(kind): record for record, kind in TYPES.items()}[voxel_data.dtype]


def empty_records(record: int, count: int) -> np.ndarray:
    """Allocate ``count`` records: (count, 4) float32 or (count,) uint64."""
    return empty((count, *WORDS[record]), TYPES[record])


def words_of(voxel_data) -> np.ndarray:
    """View of records as (m, w) integers or floats, for copying."""
    return voxel_data if voxel_data.ndim == 2 else voxel_data.reshape(-1, 1)


def decoding_of(record: int, most_density: float, most_color: float) -> np.ndarray | None:
    """Scales that convert the codes of short records to numbers.

    Parameters
    ----------
    record : {16, 8}
        Bytes of a voxel record.
    most_density : float
        Upper bound of the density.
    most_color : float
        Upper bound of any channel of an unassociated color.

    Returns
    -------
    ndarray of float32 or None
        (SCALES,) for red, green, blue and density. None for 16 bytes, which are not coded.
    """
    if record == 16:
        return None
    density, color = max(most_density, LEAST_SCALE), max(most_color, LEAST_SCALE)
    color = max(density * color, LEAST_SCALE)
    return np.array((color, color, color, density), np.float32)


def unpack(voxel_data, decoding) -> np.ndarray:
    """Decode records to (n, 4) float32 (density * RGB, density), with the arithmetic of the splatting kernels."""
    if record_bytes(voxel_data) == 16:
        return voxel_data
    codes = (voxel_data[:, None] >> np.arange(0, 64, 16, dtype=np.uint64)).astype(np.uint16)
    return float_of(codes) * decoding


# --- codes ----------------------------------------------------------------------------------------------------


def float_of(codes) -> np.ndarray:
    """Decode 16-bit floats to float32, relative to their scale."""
    return (codes.astype(np.uint32) << SHIFT).view(np.float32) * UNBIAS


@kernel(inline="always", exact=True)
def code_of(relative):
    """Round a float64 value in [0, 1] to a 16-bit float, as uint32."""
    bits = np.float32(relative).view(np.uint32)
    return np.uint32((bits - BIAS + HALF) >> SHIFT) if bits >= LEAST_BITS else np.uint32(0)
