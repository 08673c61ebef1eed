"""One level of a pyramid from the level below it."""

from __future__ import annotations

import numpy as np


def pooled(values: np.ndarray, join) -> np.ndarray:
    """Join neighbors in pairs along z, y and x by a ufunc ``join``; values beyond the far ends count as zero."""
    for axis in range(3):
        values = np.moveaxis(values, axis, 0)
        near, far = values[0::2], values[1::2]
        if len(far) < len(near):
            far = np.concatenate((far, np.zeros_like(near[:1])))
        values = np.moveaxis(join(near, far), 0, axis)
    return values
