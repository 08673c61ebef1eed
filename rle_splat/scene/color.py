"""Colors in files are sRGB; those of the program are scene-linear (IEC 61966-2-1)."""

import numpy as np
from numpy.typing import ArrayLike


def linear(color) -> tuple | None:
    """Convert an sRGB color, numbers from 0 to 1, to scene-linear RGB; None stays None."""
    if color is None:
        return None
    return tuple(decode_srgb(color).tolist())


def decode_srgb(encoded: ArrayLike) -> np.ndarray:
    """Convert sRGB values to scene-linear ones.

    Parameters
    ----------
    encoded : array_like
        Any shape, from 0 to 1.

    Returns
    -------
    ndarray of float64
        Of the same shape.
    """
    encoded = np.asarray(encoded, dtype=np.float64)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def to_display(colors) -> np.ndarray:
    """Convert scene-linear colors to sRGB.

    Parameters
    ----------
    colors : array_like
        Any shape; what lies outside 0 to 1 is clipped.

    Returns
    -------
    ndarray
        Of the same shape and type, from 0 to 1.
    """
    colors = np.clip(colors, 0.0, 1.0)
    return np.where(colors <= 0.0031308, 12.92 * colors, 1.055 * colors ** (1.0 / 2.4) - 0.055)
