"""The meaning of stored voxels: bits, sign, slope and intercept, padding. Pure functions on arrays."""

import numpy as np

from .pictures import ImageFrame, Storage

SIZES = (8, 16, 32)


def choose_dtype(storage: Storage) -> np.dtype:
    """Type that holds the stored voxels of a file."""
    if storage.kind != "integer":
        return np.dtype(np.float32 if storage.kind == "float" else np.float64)
    bits = next(size for size in SIZES if storage.stored <= size)
    return np.dtype(f"{'i' if storage.signed else 'u'}{bits // 8}")


def common_dtype(pictures) -> np.dtype:
    """Type that holds the stored voxels of all pictures."""
    found = np.result_type(*{choose_dtype(picture.storage) for picture in pictures})
    return np.dtype(np.float64) if found == np.int64 else found  # of signed and unsigned ones of 32 bits


def extract_stored_values(words: np.ndarray, bits: int, high: int, signed: bool, dtype: np.dtype) -> np.ndarray:
    """Stored voxels from allocated words: bits ``high - bits + 1`` to ``high``, the sign extended.

    DICOM PS3.5, section 8.1.1. (x ^ s) - s extends the sign bit s.

    Parameters
    ----------
    words : ndarray of an unsigned integer
        May hold overlays or junk in other bits.
    bits, high : int
        BitsStored and HighBit.
    dtype : dtype
        Of the result; holds ``bits`` bits.

    Returns
    -------
    ndarray
        A view of ``words`` where nothing has to be changed.
    """
    size = 8 * words.dtype.itemsize
    if bits == size:
        return words.view(dtype)
    if high + 1 > bits:
        words = words >> (high + 1 - bits)
    words = words & words.dtype.type((1 << bits) - 1)
    if signed:
        sign = words.dtype.type(1 << (bits - 1))
        words = ((words ^ sign) - sign).view(f"i{words.dtype.itemsize}")
    return words.astype(dtype, copy=False)


def common_mapping(pictures) -> tuple[float, float] | None:
    """(slope, intercept) if all pictures have the same, and no table; else None, and their values become float32."""
    if any(picture.series.table is not None for picture in pictures):
        return None
    pairs = {(picture.slope, picture.intercept) for picture in pictures}
    return pairs.pop() if len(pairs) == 1 else None


def padding_of(picture: ImageFrame) -> tuple | None:
    """Smallest and largest stored value of padding, as numbers of the stored type."""
    if picture.padding is None or picture.storage.kind != "integer" or picture.series.table is not None:
        return None  # a table says what padding looks like
    storage = picture.storage
    found = []
    for value in picture.padding:
        if storage.signed and value >= 1 << (storage.stored - 1):  # written as an unsigned word
            value -= 1 << (8 * choose_dtype(storage).itemsize if value >= 1 << storage.stored else storage.stored)
        found.append(value)
    return min(found), max(found)


def physical(stored: np.ndarray, picture: ImageFrame) -> np.ndarray:
    """Physical values, float32: those of the table, or slope * stored + intercept, computed in float64."""
    if picture.series.table is not None:
        return picture.series.table.physical(stored)
    return (stored * np.float64(picture.slope) + np.float64(picture.intercept)).astype(np.float32)


def lowest_real(plane: np.ndarray, padding: tuple | None):
    """The lowest value of a slice that is no padding; None if there is none."""
    if padding is not None:
        plane = plane[(plane < padding[0]) | (plane > padding[1])]
    return plane.min() if plane.size else None


def lower_padding(plane: np.ndarray, padding: tuple, lowest) -> int:
    """Set padding above ``lowest`` to it, in place; returns the number of voxels changed."""
    above = (plane >= padding[0]) & (plane <= padding[1]) & (plane > lowest)
    plane[above] = lowest
    return int(np.count_nonzero(above))


def blend(first: np.ndarray, second: np.ndarray, weight: float) -> np.ndarray:
    """(1 - weight) * first + weight * second, rounded if the type is an integer."""
    mixed = first * (1.0 - weight) + second * weight
    return np.rint(mixed).astype(first.dtype) if first.dtype.kind in "iu" else mixed.astype(first.dtype)
