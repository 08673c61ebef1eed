"""Voxel records of 6 and 4 bytes, which versions 0.1 and 0.2 could store; they are opened as records of 8 bytes.

    bytes  color                       density: extinction or opacity
    6      11, 11 and 10 bits, linear  16-bit float
    4      7, 7 and 7 bits, linear     11 bits, the number of a density in the scales
"""

from __future__ import annotations

import numpy as np

from .records import decoding_of, empty_records, float_of, pack_numpy

RECORDS = {6: 8, 4: 8}  # bytes of a stored record -> bytes of the record that it is opened as
TYPES = {6: np.uint16, 4: np.uint32}  # bytes of a record -> dtype of the array
WORDS = {6: 3, 4: 1}  # numbers of a record
SCALES = {6: 4, 4: 4 + 2048}  # red, green, blue and density; then the density of each code
COLOR_STEPS = {6: (2047, 2047, 1023), 4: (127, 127, 127)}  # largest code of red, green and blue
COLOR_BITS = {6: (0, 11, 22), 4: (0, 7, 14)}  # first bit of each
DENSITY_BIT = 21  # first bit of the density in 4 bytes
AT_ONCE = 1 << 20  # records converted at once, so that their numbers are not all in memory
MOST = 1e37  # bound of any scale


def lengthen(words: np.ndarray, scales) -> tuple[np.ndarray, np.ndarray]:
    """Convert records of 6 or 4 bytes to records of 8 bytes.

    Parameters
    ----------
    words : (n, 3) ndarray of uint16, or (n,) or (n, 1) of uint32
    scales : (4,) or (2052,) ndarray of float32
        The decoding of the records.

    Returns
    -------
    voxel_data : (n,) ndarray of uint64
    decoding : (4,) ndarray of float32
        See ``records.decoding_of``.

    Raises
    ------
    ValueError
        If the scales do not fit the records.
    """
    record = {np.dtype(kind): record for record, kind in TYPES.items()}[words.dtype]
    scales, words = np.asarray(scales, np.float32), words.reshape(-1, WORDS[record])
    if scales.shape != (SCALES[record],) or not (scales.min() >= 0.0 and scales.max() <= MOST):
        raise ValueError("the scales of the voxel data are of the wrong size, or no numbers from 0 on")
    most_color = float((scales[:3] * np.array(COLOR_STEPS[record], np.float32)).max())
    decoding = decoding_of(8, float(scales[3:].max() if record == 6 else scales[4:].max()), most_color)
    voxel_data = empty_records(8, len(words))
    for first in range(0, len(words), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        pack_numpy(_numbers(words[part], record, scales), 1.0 / decoding.astype(np.float64), voxel_data[part])
    return voxel_data, decoding


def _numbers(words: np.ndarray, record: int, scales: np.ndarray) -> np.ndarray:
    """(n, 4) float32 (density * RGB, density) of records of 6 or 4 bytes."""
    if record == 6:
        density = float_of(words[:, 0]) * scales[3]
        codes = words[:, 1].astype(np.uint32) | (words[:, 2].astype(np.uint32) << np.uint32(16))
    else:
        codes = words[:, 0]
        density = scales[4:][codes >> np.uint32(DENSITY_BIT)]
    numbers = np.empty((len(words), 4), np.float32)
    for channel, (bit, steps) in enumerate(zip(COLOR_BITS[record], COLOR_STEPS[record])):
        color = ((codes >> np.uint32(bit)) & np.uint32(steps)).astype(np.float32) * scales[channel]
        numbers[:, channel] = density * color
    numbers[:, 3] = density
    return numbers
