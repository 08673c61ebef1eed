"""Colors in files are sRGB; those of the program are scene-linear."""

from __future__ import annotations

import numpy as np


def decode_srgb(encoded) -> np.ndarray:
    """Convert sRGB values from 0 to 1, of any shape, to scene-linear ones (IEC 61966-2-1)."""
    encoded = np.asarray(encoded, dtype=np.float64)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def linear(color) -> tuple | None:
    """Convert an sRGB color, three numbers from 0 to 1, to scene-linear RGB; None stays None."""
    return None if color is None else tuple(decode_srgb(color).tolist())
