"""Voxel records of 16, 8, 6 and 4 bytes (algorithm.md 1.11).

    bytes  color                                         density: extinction or opacity
    16     3 float32, times the density                  float32
    8      3 16-bit floats, times the density            16-bit float
    6      11, 11 and 10 bits, linear                    16-bit float
    4      7, 7 and 7 bits, linear                       11 bits, logarithmic

The 16-bit floats are not IEEE half floats: no sign, 5 bits of exponent, 11 of mantissa, relative to the largest value.
The rounding error is at most 2^-12 of a value, and only values below 2^-30 of the largest become zero. A shift and a
product convert them to float32. The logarithmic density has a relative error of 0.24 % down to 2^-14 of the largest,
and a constant absolute error below, which suits thin media, whose optical depths add up.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from ..runtime.buffer_pool import empty
from ..runtime.jit import compiled, kernel, parallel_call
from ..runtime.parallel import share_out

TYPES = {16: np.float32, 8: np.uint64, 6: np.uint16, 4: np.uint32}  # bytes of a record -> dtype of the array
WORDS = {16: (4,), 8: (), 6: (3,), 4: ()}  # entries of a record; () for a single number
COLOR_STEPS = {6: (2047, 2047, 1023), 4: (127, 127, 127)}  # largest code of red, green and blue
COLOR_BITS = {6: (0, 11, 22), 4: (0, 7, 14)}  # first bit of each
LOG_STEPS = 2047  # largest code of a logarithmic density
LOG_BITS = 21  # its first bit
LOG_KNEE = 2.0**-14  # of the largest density: steps are relative above it, absolute below
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
    """Allocate ``count`` records: (count, 4) float32, (count,) uint64, (count, 3) uint16 or (count,) uint32."""
    return empty((count, *WORDS[record]), TYPES[record])


def words_of(voxel_data) -> np.ndarray:
    """View of records as (m, w) integers or floats, for copying."""
    return voxel_data if voxel_data.ndim == 2 else voxel_data.reshape(-1, 1)


def decoding_of(record: int, most_density: float, most_color: float) -> np.ndarray | None:
    """Scales that convert the codes of short records to numbers.

    Parameters
    ----------
    record : {16, 8, 6, 4}
        Bytes of a voxel record.
    most_density : float
        Upper bound of the density.
    most_color : float
        Upper bound of any channel of an unassociated color.

    Returns
    -------
    ndarray of float32 or None
        (4,) for red, green, blue and density; for 4 bytes followed by the density of each code, (2048,). None for 16
        bytes, which are not coded.
    """
    if record == 16:
        return None
    density, color = max(most_density, LEAST_SCALE), max(most_color, LEAST_SCALE)
    if record == 8:
        color = max(density * color, LEAST_SCALE)
        return np.array((color, color, color, density), np.float32)
    scales = [color / steps for steps in COLOR_STEPS[record]]
    if record == 6:
        return np.array((*scales, density), np.float32)
    return np.concatenate(((*scales, 1.0), density * _log_densities())).astype(np.float32)


def decoding_size(record: int) -> int:
    """Length of the result of ``decoding_of`` for records of 8, 6 or 4 bytes."""
    return 4 + (LOG_STEPS + 1 if record == 4 else 0)


def pack(records, decoding, voxel_data, *, threads: int = 0) -> None:
    """Code records.

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
    record = record_bytes(voxel_data)
    if record == 8:
        arguments = (records, 1.0 / decoding[:4].astype(np.float64), voxel_data)
        run = _pack_8 if compiled() else _pack_8_numpy
    else:
        steps = np.array(COLOR_STEPS[record], np.int64)
        density = float(decoding[3] if record == 6 else decoding[-1])
        arguments = (records, 1.0 / decoding[:3].astype(np.float64), steps, 1.0 / density)
        arguments += (voxel_data,) if record == 6 else (_log_codes(), voxel_data)
        kernels, references = {6: _pack_6, 4: _pack_4}, {6: _pack_6_numpy, 4: _pack_4_numpy}
        run = (kernels if compiled() else references)[record]
    if not compiled():
        run(*arguments)
        return
    with parallel_call(threads):
        run(*arguments)


def unpack(voxel_data, decoding) -> np.ndarray:
    """Decode records to (n, 4) float32 (density * RGB, density), with the arithmetic of the splatting kernels."""
    record = record_bytes(voxel_data)
    if record == 16:
        return voxel_data
    if record == 8:
        codes = (voxel_data[:, None] >> np.arange(0, 64, 16, dtype=np.uint64)).astype(np.uint16)
        return _float_numpy(codes) * decoding[:4]
    if record == 6:
        density = _float_numpy(voxel_data[:, 0]) * decoding[3]
        codes = voxel_data[:, 1].astype(np.uint32) | (voxel_data[:, 2].astype(np.uint32) << np.uint32(16))
    else:
        density = decoding[4:][voxel_data >> np.uint32(LOG_BITS)]
        codes = voxel_data
    records = np.empty((len(codes), 4), np.float32)
    for channel, (bit, steps) in enumerate(zip(COLOR_BITS[record], COLOR_STEPS[record])):
        color = ((codes >> np.uint32(bit)) & np.uint32(steps)).astype(np.float32) * decoding[channel]
        records[:, channel] = density * color
    records[:, 3] = density
    return records


# --- codes ----------------------------------------------------------------------------------------------------


def _float_numpy(codes) -> np.ndarray:
    """Decode 16-bit floats to float32, relative to their scale."""
    return (codes.astype(np.uint32) << SHIFT).view(np.float32) * UNBIAS


def codes_numpy(relative) -> np.ndarray:
    """Round float64 values in [0, 1] to 16-bit floats, as uint32."""
    bits = np.asarray(relative).astype(np.float32).view(np.uint32)
    return np.where(bits >= LEAST_BITS, (bits - BIAS + HALF) >> SHIFT, np.uint32(0))


@kernel(inline="always", exact=True)
def code_of(relative):
    """Round a float64 value in [0, 1] to a 16-bit float, as uint32."""
    bits = np.float32(relative).view(np.uint32)
    return np.uint32((bits - BIAS + HALF) >> SHIFT) if bits >= LEAST_BITS else np.uint32(0)


@cache
def _log_densities() -> np.ndarray:
    """(2048,) float64: density of each logarithmic code, relative to the largest."""
    return LOG_KNEE * np.expm1(np.arange(LOG_STEPS + 1) / LOG_STEPS * np.log1p(1.0 / LOG_KNEE))


@cache
def _log_codes() -> np.ndarray:
    """(65536,) uint16: logarithmic code of each 16-bit float; a lookup is faster than a logarithm."""
    relative = _float_numpy(np.arange(1 << 16, dtype=np.uint32)).astype(np.float64)
    codes = np.rint(np.log1p(np.minimum(relative, 1.0) / LOG_KNEE) * (LOG_STEPS / np.log1p(1.0 / LOG_KNEE)))
    codes = codes.astype(np.uint16)
    codes.setflags(write=False)
    return codes


# --- packing: kernels and reference implementations -------------------------------------------------------------


@kernel
def _pack_8(records, inverse, voxel_data):
    """Kernel of ``pack`` for 8 bytes; ``inverse`` (4,) float64: one over the scale of each channel."""
    share_out(_pack_some_8, voxel_data.size, (records, inverse, voxel_data))


@kernel(exact=True, inner=True)
def _pack_some_8(begin, end, records, inverse, voxel_data):
    """``_pack_8`` for records [begin, end)."""
    made, codes = records[begin:end], voxel_data[begin:end]  # slices start at zero, so the loop becomes SIMD
    red, green, blue, density = inverse[0], inverse[1], inverse[2], inverse[3]
    for i in range(codes.size):
        low = code_of(made[i, 0] * red) | (code_of(made[i, 1] * green) << np.uint32(16))
        high = code_of(made[i, 2] * blue) | (code_of(made[i, 3] * density) << np.uint32(16))
        codes[i] = np.uint64(low) | (np.uint64(high) << np.uint64(32))


def _pack_8_numpy(records, inverse, voxel_data):
    """Reference implementation of ``_pack_8``."""
    codes = codes_numpy(records * inverse).astype(np.uint64)
    voxel_data[:] = (codes << np.arange(0, 64, 16, dtype=np.uint64)).sum(axis=1, dtype=np.uint64)


@kernel(inline="always", exact=True)
def _color_code(records, i, channel, inverse, steps):
    """Linear code of one channel of a record's unassociated color."""
    density = np.float64(records[i, 3])
    if density == 0.0:
        return np.uint32(0)
    return np.uint32(min(np.int64(records[i, channel] / density * inverse[channel] + 0.5), steps[channel]))


def _color_codes_numpy(records, inverse, steps) -> np.ndarray:
    """(n, 3) uint32; reference implementation of ``_color_code``."""
    density = records[:, 3:].astype(np.float64)
    color = np.divide(records[:, :3], density, out=np.zeros((len(records), 3)), where=density != 0.0)
    return np.minimum((color * inverse + 0.5).astype(np.int64), steps).astype(np.uint32)


@kernel
def _pack_6(records, inverse, steps, inverse_density, voxel_data):
    """Kernel of ``pack`` for 6 bytes; ``inverse`` (3,) float64: codes per unit of each channel; ``steps``: largest."""
    share_out(_pack_some_6, voxel_data.shape[0], (records, inverse, steps, inverse_density, voxel_data))


@kernel(exact=True, inner=True)
def _pack_some_6(begin, end, records, inverse, steps, inverse_density, voxel_data):
    """``_pack_6`` for records [begin, end)."""
    for i in range(begin, end):
        red = _color_code(records, i, 0, inverse, steps)
        green = _color_code(records, i, 1, inverse, steps)
        blue = _color_code(records, i, 2, inverse, steps)
        code = np.uint32(red | (green << np.uint32(11)) | (blue << np.uint32(22)))
        voxel_data[i, 0] = code_of(records[i, 3] * inverse_density)
        voxel_data[i, 1] = code & np.uint32(0xFFFF)
        voxel_data[i, 2] = code >> np.uint32(16)


def _pack_6_numpy(records, inverse, steps, inverse_density, voxel_data):
    """Reference implementation of ``_pack_6``."""
    red, green, blue = _color_codes_numpy(records, inverse, steps).T
    code = red | (green << np.uint32(11)) | (blue << np.uint32(22))
    voxel_data[:, 0] = codes_numpy(records[:, 3].astype(np.float64) * inverse_density)
    voxel_data[:, 1] = code & np.uint32(0xFFFF)
    voxel_data[:, 2] = code >> np.uint32(16)


@kernel
def _pack_4(records, inverse, steps, inverse_density, log_codes, voxel_data):
    """As ``_pack_6``, for 4 bytes; ``log_codes`` (65536,) uint16: logarithmic code of each 16-bit float."""
    share_out(_pack_some_4, voxel_data.size, (records, inverse, steps, inverse_density, log_codes, voxel_data))


@kernel(exact=True, inner=True)
def _pack_some_4(begin, end, records, inverse, steps, inverse_density, log_codes, voxel_data):
    """``_pack_4`` for records [begin, end)."""
    for i in range(begin, end):
        red = _color_code(records, i, 0, inverse, steps)
        green = _color_code(records, i, 1, inverse, steps)
        blue = _color_code(records, i, 2, inverse, steps)
        density = np.uint32(log_codes[code_of(records[i, 3] * inverse_density)])
        voxel_data[i] = red | (green << np.uint32(7)) | (blue << np.uint32(14)) | (density << np.uint32(LOG_BITS))


def _pack_4_numpy(records, inverse, steps, inverse_density, log_codes, voxel_data):
    """Reference implementation of ``_pack_4``."""
    red, green, blue = _color_codes_numpy(records, inverse, steps).T
    density = log_codes[codes_numpy(records[:, 3].astype(np.float64) * inverse_density)].astype(np.uint32)
    voxel_data[:] = red | (green << np.uint32(7)) | (blue << np.uint32(14)) | (density << np.uint32(LOG_BITS))
